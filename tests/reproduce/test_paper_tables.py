"""The paper's tables of stored results: whole, right, and in every format."""

import csv
import io
import json

import pytest
from stored_results import EPISODES, store_all

from spin_rl.benchmark.tables import paper
from spin_rl.config import ConfigError
from spin_rl.reproduce import state
from spin_rl.reproduce.plan import PAPER, read_steps
from spin_rl.reproduce.tables import table as tables
from spin_rl.reproduce.tables.depth import at_samples
from spin_rl.reproduce.tables.rates import Rate, difference
from spin_rl.reproduce.tables.registry import PLANS, TABLES
from spin_rl.reproduce.tables.stored import Stored
from spin_rl.tasks.common.compose import compose

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
    steps = read_steps(compose("reproduce")["plan"])
    store_all(steps, successes)
    return steps


@pytest.mark.parametrize("name", PAPERS)
def test_every_table_is_whole_in_every_format(steps, name, tmp_path):
    table = TABLES[name](Stored(steps, name))
    assert table.name == name and table.rows and table.claims
    for row in table.rows:
        assert len(row) == len(table.header)
        assert all(cell for cell in row[2:-1]), row  # labels and trainings stand in the first row of a method
    for ending in tables.FORMATS:
        tables.write(table, tmp_path / f"table{ending}")
    lines = (tmp_path / "table.md").read_text().splitlines()
    grid = [line for line in lines if line.startswith("|")]
    assert len(grid) == len(table.rows) + 2 and len({line.count("|") for line in grid}) == 1
    records = list(csv.DictReader(io.StringIO((tmp_path / "table.csv").read_text())))
    assert len(records) == len(table.records)
    for read, record in zip(records, table.records, strict=True):
        assert {key: read[key] for key in record} == {
            key: "" if value is None else str(value) for key, value in record.items()
        }
    kept = json.loads((tmp_path / "table.json").read_text())
    assert [list(row) for row in table.rows] == kept["rows"] and kept["claims"][0]["verdict"]
    assert (tmp_path / "table.txt").read_text() == tables.terminal(table)


@pytest.mark.parametrize("name", PAPERS)
def test_a_missing_result_is_refused_with_the_command_that_makes_it(steps, name):
    stored = Stored(steps, name)
    TABLES[name](stored)
    for step in stored.used[:: max(1, len(stored.used) - 1)]:
        file = state.result_file(step.name)
        kept = file.read_text()
        file.unlink()
        with pytest.raises(ConfigError, match=f"spin-reproduce run=true only={step.name}$") as error:
            TABLES[name](Stored(steps, name))
        assert "\n" not in str(error.value)
        file.write_text(kept)


def test_a_result_of_another_plan_is_refused(steps):
    file = state.result_file("reach/cvo-2")
    stored = json.loads(file.read_text())
    stored["trainings"][0]["seed"] = 9
    file.write_text(json.dumps(stored))
    with pytest.raises(ConfigError, match="the plan has changed since result reach/cvo-2"):
        TABLES["visibility"](Stored(steps, "visibility"))


def test_trainings_are_pooled_and_shown_one_by_one(steps):
    table = TABLES["1"](Stored(steps, "1"))
    rows = {row[0]: i for i, row in enumerate(table.rows) if row[0]}
    own = rows["SPIN (CVO)"]
    # 75 and 65 of a hundred on hard, 95 and 85 elsewhere.
    assert table.rows[own][4].startswith("0.70 (") and table.rows[own][2].startswith("0.90 (")
    assert table.rows[own + 1][4] == "0.75 0.65" and table.rows[own + 2][4] == "0.93"
    assert table.rows[own][-1] == "cvo-1, cvo-2"
    record = next(r for r in table.records if r["method"] == "FixCam" and r["difficulty"] == "hard")
    assert record["episodes"] == 2 * EPISODES and record["paper_success_rate"] == 0.20
    claim = table.claims[0]
    assert claim.ours == pytest.approx(0.40) and claim.trainings == pytest.approx((0.30, 0.50))
    assert claim.paper == pytest.approx(0.93 - 0.23) and claim.verdict == "reproduced"
    assert table.claims[1].ours == pytest.approx(0.0) and table.claims[1].verdict == "no difference shown"


def test_budget_counts_the_phases_of_a_training(steps):
    note = TABLES["1"](Stored(steps, "1")).notes[0]
    assert "8.0 M env steps" in note and "9 to 18 min" in note and "seeds 1, 2" in note


def test_verdicts():
    def verdict(one, other, wanted):
        rates = [Rate(round(1000 * share), 1000) for share in (one, other)]
        return tables.compare("a", rates[:1], rates[1:], paper=None, wanted=wanted).verdict

    assert verdict(0.9, 0.5, 0.3) == "reproduced"
    assert verdict(0.9, 0.8, 0.3) == "same direction, less of it"
    assert verdict(0.8, 0.9, 0.0) == "the other way round"
    assert verdict(0.90, 0.90, 0.0) == "no difference shown"


def test_difference_against_the_example_of_newcombe():
    """56 of 70 and 48 of 80, in Newcombe 1998, table II, method 10: 0.0524 to 0.3339."""
    assert difference(Rate(56, 70), Rate(48, 80)) == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)


def test_success_at_equal_samples_is_that_of_the_nearest_point():
    curve = {"env_steps": [1e6, 2e6, 4e6], "success_rate": [0.1, 0.3, 0.6]}
    assert [at_samples(curve, count) for count in (0.0, 2.2e6, 9e6)] == [0.1, 0.3, 0.6]


def test_fixed_poses_are_those_of_the_configuration():
    assert set(paper.FIXCAM) == {"I", "II", "III", "IV"}
    cells = [cell.success_rate for cell in paper.REACH["FixCam"].values()]
    assert list(paper.FIXCAM["IV"]) == cells  # the paper's own two tables agree
