"""The paper's tables of stored results: whole, right, and in every format."""

import csv
import io
import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stored_results import EPISODES, store, store_all

from spin_rl.benchmark.metrics import wilson_interval
from spin_rl.benchmark.tables import paper
from spin_rl.config import ConfigError
from spin_rl.reproduce import state
from spin_rl.reproduce.plan import PAPER, Evaluation, read_steps
from spin_rl.reproduce.tables import table as tables
from spin_rl.reproduce.tables.depth import at_samples
from spin_rl.reproduce.tables.missing import Missing
from spin_rl.reproduce.tables.rates import Rate, difference
from spin_rl.reproduce.tables.registry import PLANS, TABLES
from spin_rl.reproduce.tables.stored import NothingStored, Stored
from spin_rl.reproduce.tables.table import NOT_SHOWN
from spin_rl.tasks.common.compose import compose

SHIPPED = read_steps(compose("reproduce")["plan"])
MEASURED = [step for step in SHIPPED.by_name.values() if isinstance(step, Evaluation)]
PAPERS = [name for name, plan in PLANS.items() if plan == PAPER]


def successes(name, cell):
    """Every method another one, hard cells worse, second seeds worse by ten."""
    hard = 20 if "hard" in cell or "dynamic" in cell else 0
    fixed = 40 if "fixcam" in name else 30 if "classical" in name else 0
    return 95 - hard - fixed - (10 if name.endswith("-2") else 0)


@pytest.fixture
def steps(tmp_path, monkeypatch):
    """The shipped plan with a result of every evaluation."""
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path)
    store_all(SHIPPED, successes)
    return SHIPPED


@pytest.mark.parametrize("name", PAPERS)
def test_every_table_is_whole_in_every_format(steps, name):
    table = TABLES[name](Stored(steps, name))
    assert table.name == name and table.rows and table.claims and table.missing is None
    for row in table.rows:
        assert len(row) == len(table.header)
        assert all(row), row
    lines = tables.markdown(table).splitlines()
    grid = [line for line in lines if line.startswith("|")]
    assert len(grid) == len(table.rows) + 2 and len({line.count("|") for line in grid}) == 1
    assert f"    spin-eval table={name}" in lines
    records = list(csv.DictReader(io.StringIO(tables.csv_text(table))))
    assert len(records) == len(table.records)
    for read, record in zip(records, table.records, strict=True):
        assert {key: read[key] for key in record} == {
            key: "" if value is None else str(value) for key, value in record.items()
        }
    kept = json.loads(tables.json_text(table))
    assert [list(row) for row in table.rows] == kept["rows"] and kept["claims"][0]["verdict"]
    assert kept["title"] == table.title
    assert tables.terminal(table).splitlines()[0] == table.title


@pytest.mark.parametrize("name", PAPERS)
def test_every_table_tells_of_budget_machine_code_intervals_and_the_paper(steps, name):
    told = tables.terminal(TABLES[name](Stored(steps, name)))
    for fact in ("a machine", "commits abc", "95 %", "paper", "spin-"):
        assert fact in told, fact
    assert "M env steps" in told or name == "dynamic"  # shipped policies: their cards tell
    orderings = {
        "1": ["CVO over FixCam on hard", "CVO over NoPointNet on hard"],
        "place": ["placing, CVO over NoPointNet"],
        "fixcam": [
            "moving over FixCam IV on hard",
            "moving over the best of the paper's poses here",
            "moving over the pose of the screening",
        ],
        "visibility": ["2 m over 5 m"],
        "dynamic": [
            "nav-room, its network alone over classical, 60 s of slack, static obstacles",
            "nav-cvo, corridors only over classical, 60 s of slack, dynamic obstacles",
        ],
        "depth": ["scandots over depth images"],
    }
    for ordering in orderings[name]:
        line = next(line for line in told.splitlines() if ordering in line)
        signed = r"[+-]\d\.\d\d"
        assert re.search(rf": {signed} \({signed} to {signed}; .*\), paper .*wanted .*: [a-z ,']+$", line), (
            line
        )


@pytest.mark.parametrize("name", PAPERS)
def test_a_table_without_any_result_is_refused_with_the_command_that_makes_it(steps, name):
    stored = Stored(steps, name)
    TABLES[name](stored)
    for file in state.RESULT_DIR.rglob("*.json"):
        file.unlink()
    empty = Stored(steps, name)
    said = rf"^table: {name}: not measured yet, \d+ results: spin-reproduce run=true "
    with pytest.raises(NothingStored, match=said) as error:
        TABLES[name](empty)
    assert "\n" not in str(error.value)
    assert empty.missing == stored.used


@pytest.mark.parametrize("name", PAPERS)
def test_a_table_has_the_rows_that_are_measured_and_says_how_to_make_the_others(steps, name):
    whole = Stored(steps, name)
    TABLES[name](whole)
    for step in whole.used:
        file = state.result_file(step.name)
        kept = file.read_text()
        file.unlink()
        line = f"not measured yet, 1 result: spin-reproduce run=true only={step.name}"
        if name == "depth":  # its rows are of all three measurements
            with pytest.raises(NothingStored, match=f"{line}$"):
                TABLES[name](Stored(steps, name))
        else:
            table = TABLES[name](Stored(steps, name))
            assert table.rows and all(all(row) for row in table.rows)
            assert tables.terminal(table).splitlines()[-1] == line
            assert tables.markdown(table).endswith(f"\n\n    {line.partition(': ')[2]}\n")
        file.write_text(kept)


@pytest.mark.parametrize("name", [name for name in PAPERS if name != "depth"])
def test_a_table_of_one_result_alone_has_no_empty_cell(steps, name, tmp_path):
    whole = Stored(steps, name)
    TABLES[name](whole)
    for one in whole.used:
        for file in tmp_path.rglob("*.json"):
            file.unlink()
        store(steps, one.name)
        table = TABLES[name](Stored(steps, name))
        assert table.rows and all(all(row) for row in table.rows) and table.missing is not None
        assert len(table.missing.names) == len(whole.used) - 1


@settings(deadline=None)
@given(st.lists(st.sampled_from(MEASURED), min_size=1, unique=True))
def test_the_command_for_what_is_missing_chooses_that_and_no_more(missing):
    only = Missing.of(SHIPPED, missing).command.partition("only=")[2].strip("'[]")
    chosen = [step for step in SHIPPED.chosen(only.split(",")) if isinstance(step, Evaluation)]
    assert {step.name for step in chosen} == {step.name for step in missing}


def test_where_nobody_came_to_the_table_no_pick_was_tried(steps):
    for training in ("dvo-1", "dvo-2"):
        file = state.result_file(f"fetch/{training}")
        stored = json.loads(file.read_text())
        stored["result"]["overall"]["pick"] = {"succeeded": 0, "tried": 0}
        file.write_text(json.dumps(stored))
    table = TABLES["place"](Stored(steps, "place"))
    row = next(row for row in table.rows if row[0] == "SPIN (DVO)")
    assert row[2] == "none tried" and row[3].startswith("0.")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda text: text[: len(text) // 2], r"reach/cvo-2\.json is no whole JSON"),
        (lambda text: "", r"is no whole JSON"),
        (lambda text: "[1]", r"is no whole JSON"),
        (lambda text: text.replace('"result"', '"other"', 1), "lacks result"),
        (lambda text: text.replace('"rows"', '"other"', 1), r"lacks result\.rows"),
        (lambda text: text.replace('"seeds"', '"other"', 1), r"lacks result\.seeds"),
        (lambda text: text.replace('"episodes"', '"other"', 1), r"lacks result\.rows\[0\]\.episodes"),
        (lambda text: text.replace('"hard"', '"easy"', 1), r"lacks result\.rows of 1 hard"),
    ],
)
def test_a_damaged_result_is_named_and_measured_again(steps, damage, said):
    file = state.result_file("reach/cvo-2")
    file.write_text(damage(file.read_text()))
    step = steps.by_name["reach/cvo-2"]
    assert state.state_of(steps, step).status == "missing"
    again = r", which 1 reads; measure it again: spin-reproduce run=true only=reach/cvo-2$"
    with pytest.raises(ConfigError, match=f"^table: .*{said}{again}") as error:
        TABLES["1"](Stored(steps, "1"))
    assert "\n" not in str(error.value)


def test_a_result_of_another_plan_is_none_of_this_one(steps):
    file = state.result_file("reach/cvo-2")
    stored = json.loads(file.read_text())
    stored["trainings"][0]["seed"] = 9
    file.write_text(json.dumps(stored))
    table = TABLES["visibility"](Stored(steps, "visibility"))
    assert table.missing is not None and table.missing.names == ("reach/cvo-2",)
    assert next(row for row in table.rows if row[0] == "2 m")[-1] == "cvo-1"


def test_results_of_an_older_commit_are_still_those_of_the_plan(steps):
    file = state.result_file("reach/cvo-2")
    stored = json.loads(file.read_text())
    stored["commit"] = stored["result"]["commit"] = "0ld"
    file.write_text(json.dumps(stored))
    assert state.state_of_result(steps, steps.by_name["reach/cvo-2"]).status == "done"
    assert "commits 0ld, abc" in tables.terminal(TABLES["1"](Stored(steps, "1")))


def test_trainings_are_pooled_and_shown_one_by_one(steps):
    table = TABLES["1"](Stored(steps, "1"))
    own = next(i for i, row in enumerate(table.rows) if row[0] == "SPIN (CVO)")
    # 75 and 65 of a hundred on hard, 95 and 85 elsewhere.
    assert table.rows[own][4].startswith("0.70 (") and table.rows[own][2].startswith("0.90 (")
    assert table.rows[own + 1][4] == "0.75 0.65" and table.rows[own + 2][4] == "0.93"
    assert table.rows[own][-1] == "cvo-1, cvo-2"
    record = next(r for r in table.records if r["method"] == "FixCam" and r["difficulty"] == "hard")
    assert record["episodes"] == 2 * EPISODES and record["paper_success_rate"] == 0.20
    claim = table.claims[0]
    assert claim.ours == pytest.approx(0.40) and claim.trainings == pytest.approx((0.30, 0.50))
    assert claim.paper == pytest.approx(0.93 - 0.23) and claim.verdict == "reproduced"
    assert [claim.verdict for claim in table.claims[1:]] == [
        "no difference shown",
        "no difference shown",
        "reproduced",  # that DVO does as well
    ]
    assert table.rows[own + 4][2:4] == ("6.24 s", "14.00 s")  # the paper's times, as it prints them


def test_budget_counts_the_phases_of_a_training(steps):
    note = TABLES["1"](Stored(steps, "1")).notes[0]
    assert "8.0 M env steps" in note and "9 to 18 min" in note and "seeds 1, 2" in note


@pytest.mark.parametrize(
    ("kind", "ones", "others", "wanted", "verdict"),
    [
        ("more", [0.9], [0.5], 0.3, "reproduced"),
        ("more", [0.9, 0.9], [0.5, 0.4], 0.3, "reproduced"),
        ("more", [0.95, 0.45], [0.3, 0.5], 0.2, NOT_SHOWN),
        ("more", [0.9], [0.8], 0.3, "same direction, less of it"),
        ("more", [0.8], [0.9], 0.0, "the other way round"),
        ("more", [0.9], [0.9], 0.0, "no difference shown"),
        ("alike", [0.9], [0.9], 0.0, "reproduced"),
        ("alike", [0.9], [0.85], 0.0, "reproduced"),
        ("alike", [0.9], [0.6], 0.0, "better"),
        ("alike", [0.6], [0.9], 0.0, "worse"),
        ("alike", [0.95, 0.5], [0.5, 0.55], 0.0, NOT_SHOWN),
        ("disputed", [0.9], [0.7], 0.0, "as the text says, against the table"),
        ("disputed", [0.7], [0.9], 0.0, "as the table says, against the text"),
        ("disputed", [0.9], [0.9], 0.0, "no difference shown"),
        ("disputed", [0.95, 0.45], [0.3, 0.5], 0.0, NOT_SHOWN),
        ("alike", [0.9, 0.5], [0.5, 0.9], 0.0, NOT_SHOWN),
        ("alike", [0.9, 0.92], [0.91, 0.88], 0.0, "reproduced"),
    ],
)
def test_verdicts(kind, ones, others, wanted, verdict):
    one, other = (trainings(*shares) for shares in (ones, others))
    claim = tables.compare("a", one, other, paper=None, wanted=wanted, kind=kind)
    assert claim.verdict == verdict and claim.line().endswith(f": {verdict}")
    assert ("no pairs of trainings" in claim.line()) == (len(ones) * len(others) == 1)


def trainings(*shares, scenes=1000):
    """So many trainings in the same scenes, each with a share of successes in other ones."""
    rng = np.random.default_rng(0)
    return Rate(np.stack([rng.permutation(scenes) < share * scenes for share in shares]))


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [
        (0.9, "reproduced"),
        (0.7, "reproduced, by less than half of the paper's"),
        (0.6, "same direction, less of it"),
    ],
)
def test_a_difference_far_below_the_papers_is_told(ours, verdict):
    claim = tables.compare("a", trainings(ours), trainings(0.5), paper=0.6, wanted=0.15)
    assert claim.verdict == verdict


def test_a_difference_far_above_the_papers_is_told():
    claim = tables.compare("a", trainings(0.9), trainings(0.5), paper=0.15, wanted=0.1)
    assert claim.verdict == "reproduced, by more than twice the paper's"


def test_few_episodes_show_neither_a_difference_nor_its_absence():
    few = (trainings(share, scenes=20) for share in (0.9, 0.85))
    claim = tables.compare("a", *few, paper=0.0, kind="alike")
    assert claim.verdict == "neither a difference nor its absence shown"


@pytest.mark.parametrize("table", PAPERS)
@pytest.mark.parametrize(("key", "value"), [("seeds", [7]), ("num_envs", 8)])
def test_rows_of_other_scenes_are_not_compared(steps, table, key, value):
    name = {"dynamic": "dynamic/nav-cvo", "place": "fetch/cvo-2"}.get(table, "reach/cvo-2")
    file = state.result_file(name)
    stored = json.loads(file.read_text())
    stored["result"][key] = value
    file.write_text(json.dumps(stored))
    with pytest.raises(ConfigError, match=r"^table: .* were measured in other scenes"):
        TABLES[table](Stored(steps, table))


def test_the_distance_has_an_interval_of_all_cells(steps):
    record = TABLES["visibility"](Stored(steps, "visibility")).records[0]
    # Six cells of +-0.1 m each, whose two trainings have the same scenes.
    assert record["final_distance_m"] == pytest.approx(0.3)
    assert record["final_distance_ci95_high"] == pytest.approx(0.3 + 0.1 / 6**0.5)


def test_rows_of_the_depth_table(steps):
    """Scandots: 8 M and 100 steps in 9 min, 1800 simulated a second; images: a quarter of the steps, 900."""
    scandots, depth = TABLES["depth"](Stored(steps, "depth")).rows
    # 95 and 85 of a hundred in four cells, 75 and 65 in the two hard ones; in training the curve's at 2 M.
    mean = f"{(4 * 0.90 + 2 * 0.70) / 6:.2f} ("
    assert scandots[:6] == ("scandots", "1,800", "50,000", f"{8_000_100 / 540:,.0f}", "8.0 M", "9 min")
    assert depth[:6] == ("depth", "900", "820", f"{2_000_100 / 540:,.0f}", "2.0 M", "9 min")
    assert scandots[6].startswith(mean) and depth[6].startswith(mean)
    assert scandots[7:] == ("not given", "0.30 at level 0.00", "cvo-1, cvo-2")
    assert depth[7] == "< 0.01" and depth[-1] == "direct_depth-1, direct_depth-2"
    for seed in (1, 2):
        store(steps, f"reach/direct_depth-{seed}", lambda cell: 25)
    claim = TABLES["depth"](Stored(steps, "depth")).claims[0]
    assert claim.text.endswith(", 8.0 M steps in 9 min and 2.0 M steps in 9 min")
    assert claim.ours == pytest.approx((4 * 0.90 + 2 * 0.70) / 6 - 0.25)


DYNAMIC = {"nav-room": 96, "alone_nav-room": 84, "nav-cvo": 42, "classical": 30} | {
    "classical_60s": 66,
    "classical_map": 20,
}
"""Successes of a hundred; ten fewer where something moves."""


def test_rows_and_claims_of_the_dynamic_table(steps):
    for policy, best in DYNAMIC.items():
        store(steps, f"dynamic/{policy}", lambda cell, best=best: best - 10 * (cell[1] == "dynamic"))
    file = state.result_file("dynamic/nav-cvo")
    stored = json.loads(file.read_text())
    for row, collisions in zip(stored["result"]["rows"], (0.1, 0.2, 0.3, 0.4), strict=True):
        row["collisions"] = collisions
    file.write_text(json.dumps(stored))
    table = TABLES["dynamic"](Stored(steps, "dynamic"))
    own = [row for row in table.rows if row[0] == "nav-cvo, corridors only"]
    assert [row[1] for row in own] == [
        "success", "success, paper's SPIN", "collisions", "collisions, paper's SPIN",
    ]  # fmt: skip
    assert " ".join(cell[:4] for cell in own[0][2:6]) == "0.42 0.32 0.42 0.32"
    assert own[1][2:6] == ("0.8", "0.6", "0.8", "0.6") and own[3][2:6] == ("1.0", "1.6", "0.8", "1.6")
    assert [cell[:4] for cell in own[2][2:6]] == ["0.10", "0.20", "0.30", "0.40"]
    told = {claim.text: (round(claim.ours, 2), round(claim.paper or 0.0, 2)) for claim in table.claims}
    own_names = ("nav-room, guard and planner", "nav-room, its network alone", "nav-cvo, corridors only")
    assert told == {
        f"{name} over classical{slack}, {obstacles} obstacles": (gap, paper)
        for obstacles, paper in (("static", 0.3), ("dynamic", 0.5))
        for slack, gaps in (
            ("", (0.66, 0.54, 0.12)),
            (", 60 s of slack", (0.30, 0.18, -0.24)),
            (", by the map alone", (0.76, 0.64, 0.22)),
        )
        for name, gap in zip(own_names, gaps, strict=True)
    }
    assert table.claims[0].text.endswith(" over classical, static obstacles")  # equal time first
    collisions = (("0.20", "0.9; Classical 0.5"), ("0.30", "1.6; Classical 1.1"))
    for note, (ours, papers) in zip(table.notes, collisions, strict=False):
        assert f"; nav-cvo, corridors only {ours}; " in note and note.endswith(f"; the paper's SPIN {papers}")


def test_parts_of_the_place_table(steps):
    table = TABLES["place"](Stored(steps, "place"))
    rows = {row[1]: row for row in table.rows if row[0] == "Mapping"}
    # 600 of 800 were picked: the interval is that of 400 fetches, since both trainings had the same.
    low, high = wilson_interval(300, 400)
    assert rows["ours"][2] == f"0.75 ({low:.2f}-{high:.2f})" and rows["each"][2] == "0.75 0.75"
    assert rows["at the table"][2] == "1.00" and rows["time"][2:4] == ("5.0 s", "9.0 s")
    assert rows["paper, time"][2] == "4.98 s"
    theirs = [row for row in table.rows if row[0] == "FixCam"]
    assert [row[1] for row in theirs] == ["paper", "paper, time"]
    assert theirs[0][2:5] == ("0.86", "1.00", "0.53")
    for seed in (1, 2):
        store(steps, f"fetch/nopointnet-{seed}", lambda cell: 20)
        store(steps, f"fetch/mapping-{seed}", lambda cell: 60)
    claims = TABLES["place"](Stored(steps, "place")).claims
    mean = (4 * 0.90 + 2 * 0.70) / 6
    assert [(claim.text, round(claim.ours, 4), claim.verdict) for claim in claims] == [
        (
            "placing, CVO over NoPointNet, all corridors",
            round(mean - 0.2, 4),
            "reproduced, by more than twice the paper's",
        ),
        (
            "placing, CVO over Mapping, all corridors",
            round(mean - 0.6, 4),
            "as the text says, against the table",
        ),
        ("placing, CVO over DVO, all corridors", 0.0, "reproduced"),
    ]


def test_claims_of_visibility_and_of_the_fixed_camera(steps):
    for seed in (1, 2):
        store(steps, f"reach/visibility_5-{seed}", lambda cell: 60)
        store(steps, f"reach/landscape_fixcam_IV-{seed}", lambda cell: 30)
    visibility = TABLES["visibility"](Stored(steps, "visibility")).claims
    gap = round((4 * 0.90 + 2 * 0.70) / 6 - 0.6, 4)
    assert [(c.text, round(c.ours, 4), round(c.paper, 2)) for c in visibility] == [
        ("2 m over 5 m", gap, 0.10),
        ("1 m over 2 m", 0.0, 0.0),
    ]
    fixcam = {c.text: round(c.ours, 2) for c in TABLES["fixcam"](Stored(steps, "fixcam")).claims}
    # Where the camera moves 75 and 65 of a hundred on hard, in the paper's poses 40 fewer.
    assert fixcam == {
        "moving over FixCam IV on hard": 0.40,
        "moving over the best of the paper's poses here (fixcam_I) on hard": 0.40,
        "moving over the pose of the screening on hard": 0.0,
        "moving over FixCam IV on hard, landscape": 0.40,
        "moving over the pose of the screening on hard, landscape": 0.0,
    }


def test_two_trainings_that_agree_are_one_as_far_as_the_interval_goes():
    one = trainings(0.8, scenes=300)
    twice, apart = Rate(np.repeat(one.wins, 2, axis=0)), trainings(0.8, 0.8, scenes=300)
    assert twice.interval == pytest.approx(wilson_interval(240, 300))
    assert apart.interval == pytest.approx(wilson_interval(480, 600), abs=4e-3)
    assert Rate(np.ones((2, 300))).interval == wilson_interval(300, 300)


def test_the_interval_of_clusters_against_the_bootstrap():
    """Scenes of which half are hard, three trainings each: scenes are drawn anew, not episodes."""
    rng = np.random.default_rng(2)
    wins = rng.random((3, 600)) < np.where(np.arange(600) % 2, 0.9, 0.3)
    means = wins.mean(axis=0)[rng.integers(600, size=(4000, 600))].mean(axis=1)
    assert Rate(wins).interval == pytest.approx(np.percentile(means, [2.5, 97.5]), abs=3e-3)


def test_a_difference_in_the_same_scenes_knows_which_are_hard():
    """Against the bootstrap over scenes; unpaired it would be 0.05 either way."""
    rng = np.random.default_rng(1)
    hard = rng.random(600) < 0.5
    better = Rate(np.stack([~hard | (rng.random(600) < 0.1) for _ in range(2)]))
    mean, low, high = difference(better, Rate(np.stack([~hard, ~hard])))
    scenes = better.wins.mean(axis=0) - ~hard
    drawn = scenes[rng.integers(600, size=(4000, 600))].mean(axis=1)
    assert mean == pytest.approx(scenes.mean())
    assert (low, high) == pytest.approx(np.percentile(drawn, [2.5, 97.5]), abs=4e-3)


def test_rows_that_do_not_tell_their_outcomes_are_no_guess():
    """Where all ended alike it is known; older results of fetches have no more."""
    rows = [[{"success_rate": 0.0, "episodes": 3}, {"success_rate": 1.0, "episodes": 1}]]
    assert Rate.of(rows).wins.tolist() == [[False, False, False, True]]
    with pytest.raises(ConfigError, match="measure it again"):
        Rate.of([[{"success_rate": 0.5, "episodes": 2}]])


def test_trainings_of_other_scenes_are_no_row():
    rows = [[{"success_rate": 1.0, "episodes": count}] for count in (2, 3)]
    with pytest.raises(ConfigError, match="other scenes"):
        Rate.of(rows)
    with pytest.raises(ConfigError, match="other scenes"):
        difference(Rate.of(rows[:1]), Rate.of(rows[1:]))


def test_success_at_equal_samples_is_that_of_the_nearest_point():
    curve = {"env_steps": [1e6, 2e6, 4e6], "success_rate": [0.1, 0.3, 0.6]}
    assert [at_samples(curve, "success_rate", count) for count in (0.0, 2.2e6, 9e6)] == [0.1, 0.3, 0.6]


def test_figures_of_the_paper():
    """Sums over the numbers of Table 1 in its source; and its two tables of FixCam agree."""

    def total(table, key):
        return sum(getattr(cell, key) for cells in table.values() for cell in cells.values())

    assert list(paper.FIXCAM["IV"]) == [cell.success_rate for cell in paper.REACH["FixCam"].values()]
    assert total(paper.REACH, "success_rate") == pytest.approx(25.85)
    assert total(paper.PLACE, "success_rate") == pytest.approx(25.47)
    assert total(paper.REACH, "duration_s") == pytest.approx(552.10)
    assert total(paper.PLACE, "duration_s") == pytest.approx(563.78)
    assert sum(cell.success_rate for cell in paper.PICK.values()) == pytest.approx(4.70)
    assert sum(cell.duration_s for cell in paper.PICK.values()) == pytest.approx(40.21)
