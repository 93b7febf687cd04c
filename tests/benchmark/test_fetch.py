"""Whole fetches counted: which facts are kept, what the figures of each part are, and how they are told."""

import json

import numpy as np
import pytest
import torch

from spin_rl import robot
from spin_rl.benchmark import fetch
from spin_rl.benchmark.fetch import Fetches, run_fetches, summarize_fetches
from spin_rl.benchmark.metrics import Episodes, wilson_interval
from spin_rl.benchmark.registry import BENCHMARKS
from spin_rl.benchmark.tables import fetch as fetch_report
from spin_rl.benchmark.tables import paper
from spin_rl.scenes.objects.shapes import OBJECTS
from spin_rl.tasks.common import episode
from spin_rl.tasks.fetch.config import STAGES, FetchConfig, StageLimits
from spin_rl.tasks.fetch.env import FetchEnv
from spin_rl.tasks.fetch.state import FETCH_OUTCOMES

DROPPED = FETCH_OUTCOMES.index("dropped")


def fetches(*rows):
    """Made-up fetches of (outcome, stage in which it ended, seconds in each stage, part that touched)."""
    outcome, stage, seconds, part = zip(*rows, strict=True)
    stage_steps = np.round(10 * np.array(seconds)).astype(int)
    place = np.array([STAGES.index(name) for name in stage])
    n = len(rows)
    return Fetches(
        outcome=np.array(outcome),
        steps=stage_steps.sum(1),
        stage=place,
        kind=np.arange(n) % len(OBJECTS),
        stage_steps=stage_steps,
        reached=place > STAGES.index("reach"),
        picked=place > STAGES.index("pick"),
        retries=np.arange(n),
        drops=np.array(outcome) == DROPPED,
        scrapes=np.full(n, 2),
        distance=np.full(n, 0.5),
        parts=np.array([[name == touched for name in robot.PARTS] for touched in part]),
    )


SUCCESS = (episode.SUCCESS, "place", [6, 8, 2, 10, 7, 9], None)
SLOW_SUCCESS = (episode.SUCCESS, "place", [8, 18, 4, 12, 9, 11], None)
CRASH = (episode.COLLISION, "carry", [7, 9, 3, 11, 5, 0], "base")
MISSED = (episode.TIMEOUT, "pick", [7, 20, 24, 0, 0, 0], None)
SLIPPED = (DROPPED, "retract", [7, 9, 5, 1, 0, 0], None)
LOST = (episode.TIMEOUT, "reach", [60, 0, 0, 0, 0, 0], None)


def test_every_part_is_counted_out_of_all_and_out_of_those_that_came_so_far():
    row = summarize_fetches(fetches(SUCCESS, SLOW_SUCCESS, CRASH, CRASH, MISSED, SLIPPED, LOST), 0.1)
    assert row["success_rate"] == pytest.approx(2 / 7) and row["episodes"] == 7
    assert row["ci95"] == pytest.approx(wilson_interval(2, 7))
    assert row["duration_s"] == pytest.approx((42 + 62) / 2)
    assert row["collision_rate"] == row["timeout_rate"] == pytest.approx(2 / 7)
    assert row["dropped_rate"] == pytest.approx(1 / 7) and row["final_distance_m"] == 0.5
    counts = {part: (row[part]["succeeded"], row[part]["tried"]) for part in ("reach", "pick", "place")}
    assert counts == {"reach": (6, 7), "pick": (5, 6), "place": (2, 5)}
    for part, (succeeded, tried) in counts.items():
        assert row[part]["success_rate"] == pytest.approx(succeeded / 7)
        assert row[part]["ci95"] == pytest.approx(wilson_interval(succeeded, 7))
        assert row[part]["success_rate_of_tried"] == pytest.approx(succeeded / tried)
        assert row[part]["ci95_of_tried"] == pytest.approx(wilson_interval(succeeded, tried))
    # Of those that did it: the lost one's 60 s and the missed one's 44 s are in no mean.
    assert row["reach"]["duration_s"] == pytest.approx((6 + 8 + 4 * 7) / 6)
    assert row["pick"]["duration_s"] == pytest.approx((10 + 22 + 12 + 12 + 14) / 5)
    assert row["place"]["duration_s"] == pytest.approx((26 + 32) / 2)
    assert next(iter(row["causes"])) == "carry collision base"
    assert row["causes"] == {
        "carry collision base": 0.4, "pick timeout": 0.2, "retract dropped": 0.2, "reach timeout": 0.2
    }  # fmt: skip
    assert (row["retries"], row["drops"], row["scrapes"]) == (21, 1, 14)
    assert row["stage_s"] == pytest.approx(
        {"reach": 7.0, "align": 13.0, "pick": 3.0, "retract": 11.0, "carry": 8.0, "place": 10.0}
    )


def test_what_nobody_came_to_has_no_rate_and_no_time():
    row = summarize_fetches(fetches(LOST, LOST), 0.1)
    assert row["pick"]["success_rate"] == 0.0 and row["pick"]["tried"] == 0
    for key in ("success_rate_of_tried", "ci95_of_tried", "duration_s"):
        assert row["pick"][key] is None
    assert row["reach"]["success_rate_of_tried"] == 0.0 and row["reach"]["duration_s"] is None
    assert set(row["stage_s"].values()) == {None} and row["duration_s"] is None
    assert summarize_fetches(fetches(SUCCESS), 0.1)["causes"] == {}


def test_groups_of_fetches_are_joined_and_selected():
    joined = Episodes.concatenate([fetches(SUCCESS, LOST), fetches(CRASH)])
    assert isinstance(joined, Fetches) and joined.stage_steps.shape == (3, 6)
    chosen = joined.select(np.array([2, 0]))
    assert [chosen.cause(row) for row in (0, 1)] == ["carry collision base", "success"]


class Script:
    """Puts world 1 before its table in the first step, breaks world 2 in the second, else stands still."""

    def __init__(self, env):
        self.env = env

    def reset(self, dones=None):
        if dones is None:
            self.step = 0

    def __call__(self, obs):
        actions = torch.zeros(self.env.num_envs, 10, device=self.env.device)
        if self.step == 0:
            views = self.env.sim.views
            stowed = robot.qpos_from_joints(self.env.sim.mj_model, robot.STOWED)[3:13]
            views.qpos[1, :2] = self.env.goal[1]
            views.qpos[1, 3:13] = torch.as_tensor(stowed, dtype=torch.float32)
        if self.step == 1:
            actions[2] = torch.nan
        self.step += 1
        return actions


@pytest.fixture(scope="module")
def env(device):
    # Kernels are those of the default configuration.
    return FetchEnv(FetchConfig(limits=StageLimits(reach=0.5, align=0.2)), 6, device, 3)


def test_facts_are_those_of_the_first_fetch_of_every_world(env):
    lines = []
    groups = run_fetches(env, Script(env), 2, report=lines.append)
    assert len(groups) == 6 and lines[-1].startswith("12 of 12 episodes")
    causes = [[group.cause(row) for row in (0, 1)] for group in groups]
    expected = ["reach timeout"] * 6
    expected[1], expected[2] = "align timeout", "reach non_finite"
    assert causes == [[cause, cause] for cause in expected]
    steps = [group.steps.tolist() for group in groups]
    assert steps == [[5, 5], [3, 3], [2, 2], [5, 5], [5, 5], [5, 5]]
    assert groups[1].stage_steps.tolist() == [[1, 2, 0, 0, 0, 0]] * 2
    assert groups[1].reached.all() and not groups[0].reached.any() and not groups[1].picked.any()
    # Objects in turn, each cell from another one on.
    assert [group.kind.tolist() for group in groups] == [[0, 1], [1, 2], [2, 3], [3, 4], [4, 0], [0, 1]]
    assert (groups[5].distance > 2.0).all()


def made_up(monkeypatch, cells, **options):
    """The result of `evaluate_fetch`, had the six cells gone like this."""
    facts = {"seeds": [0], "num_envs": 4, "device": "cpu", "overflows": {}, "commit": "0", "seconds": 1.0}
    monkeypatch.setattr(fetch, "run_seeds", lambda *args, **kwargs: (cells, facts))
    result = fetch.evaluate_fetch(
        lambda obs, device: None, FetchConfig(), 4, [0], "cpu",
        policy_name="nav-cvo-depth", pick_name="pick-depth", **options,
    )  # fmt: skip
    json.dumps(result, allow_nan=False)
    # Four fetches a cell leave objects out; the paper's rows stand beside all five.
    known = {row["object"] for row in result["objects"]}
    result["objects"] += [result["objects"][0] | {"object": kind} for kind in OBJECTS if kind not in known]
    return result


@pytest.fixture
def cells():
    good, mixed = fetches(SUCCESS, SLOW_SUCCESS, SUCCESS, SUCCESS), fetches(SUCCESS, CRASH, MISSED, LOST)
    return [good, good, mixed, good, good, mixed]


def test_table_is_the_papers_table_1(monkeypatch, cells):
    result = made_up(monkeypatch, cells)
    lines = fetch_report.table(result).splitlines()
    assert lines[0].startswith("Fetch: nav-cvo-depth + pick-depth, 4 episodes per cell (seeds 0), robot")
    starts = [line.split(" ")[0] for line in lines]
    success, times = starts.index("success"), starts.index("time")
    assert lines[success + 1].split() == (
        "this pair 1.00 1.00 0.75 1.00 1.00 0.75 0.91 1.00 1.00 0.25 1.00 1.00 0.25".split()
    )
    assert lines[success + 4].split() == (
        "FixCam 1.00 0.53 0.20 1.00 0.50 0.26 0.86 1.00 0.53 0.16 0.97 0.50 0.20".split()
    )
    assert lines[times + 1].split()[:4] == "this pair 6.50 6.50".split()
    assert lines[times + 2].split() == (
        "SPIN (CVO) 6.24 14.00 23.57 6.55 15.81 29.31 5.74 6.51 13.39 27.25 8.03 12.79 31.25".split()
    )
    # Columns line up from the heading to the last row.
    place = lines[2].index("Place")
    assert all(line[place - 1] == " " != line[place] for line in lines[success + 1 : times])
    hard = next(line for line in lines if line.startswith("S2 hard"))
    assert hard.split()[2:9] == ["0.25", "0.05-0.70", "42.0", "s", "3/4", "2/3", "1/2"]
    assert hard.endswith("carry collision base 33%, pick timeout 33%, reach timeout 33%")
    mug = next(line for line in lines if line.startswith("mug"))
    assert mug.split()[1] == "0.67" and mug.endswith("6/6    6/6    4/6    carry collision base 100%")
    assert max(map(len, lines)) <= 120
    assert fetch_report.headline(result) == (
        "fetched 0.75 (0.55-0.88) of 24; reach 22/24, pick 20/22, place 18/20"
    )


def test_other_scenes_and_one_object_are_not_beside_the_paper(monkeypatch, cells):
    result = made_up(monkeypatch, cells)
    assert "SPIN" not in fetch_report.table(result | {"scene": "fetch, scene.table.height=0.6"})
    assert "SPIN" not in fetch_report.table(result | {"objects": result["objects"][:1]})
    assert "SPIN" not in fetch_report.place_table(result | {"scene": "fetch, scene.table.height=0.6"})


def test_place_has_the_time_of_its_part_and_both_rates(monkeypatch, cells):
    benchmark = BENCHMARKS["place"]
    result = made_up(monkeypatch, cells, benchmark="place")
    assert result["benchmark"] == "place" and result["rows"][0]["duration_s"] == pytest.approx(27.5)
    assert made_up(monkeypatch, cells)["rows"][0]["duration_s"] == pytest.approx(47.0)
    lines = benchmark.table(result).splitlines()
    hard = next(line for line in lines if line.startswith("1 ") and " hard " in line)
    assert hard.split()[:13] == "1 straight hard 0.25 0.05-0.70 26.0 s 1/2 0.90 27.2 s 0.16 41.1".split()
    assert lines[-1] == "success: of all fetches; time: retract + carry + place"


def test_paper_has_all_parts_of_all_methods():
    assert paper.PLACE.keys() == paper.REACH.keys() == paper.PICK.keys()
    cells = {(method, *cell): figures for method, row in paper.PLACE.items() for cell, figures in row.items()}
    assert len(cells) == 30
    assert cells["FixCam", 1, "hard"] == paper.PaperCell(0.16, 41.07)
    assert cells["Mapping", 2, "medium"] == paper.PaperCell(0.90, 12.62)
    assert cells["SPIN (CVO)", 2, "hard"] == paper.PaperCell(0.93, 31.25)
