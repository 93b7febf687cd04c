"""The table of a camera that moves against constant poses, of results that a test chooses, and its plan."""

import json

import numpy as np
import pytest
from stored_results import MACHINE, training

from spin_rl.cli import common, train
from spin_rl.config import ConfigError
from spin_rl.reproduce import state
from spin_rl.reproduce.plan import Evaluation, Training, read_steps
from spin_rl.reproduce.tables import active_camera, camera_variants, table
from spin_rl.reproduce.tables.registry import PLANS
from spin_rl.reproduce.tables.stored import Stored
from spin_rl.runners.config import check_config
from spin_rl.tasks.common.compose import compose, with_depth
from spin_rl.tasks.registry import find_task

SHIPPED = read_steps(compose("reproduce", ["plan=active_camera"])["plan"])
TRAININGS = [step for step in SHIPPED.by_name.values() if isinstance(step, Training)]
EPISODES = 100
MOTION = {"p5": -3.0, "p95": 0.1, "std_within": 0.9}


@pytest.fixture
def steps(tmp_path, monkeypatch):
    monkeypatch.setattr(state, "RESULT_DIR", tmp_path)
    return SHIPPED


def places(success, seeds=(3,)):
    """A result of the rooms benchmark, of a mask of episodes."""
    row = {
        "family": "shuttle",
        "episodes": len(success),
        "success_rate": float(np.mean(success)),
        "collision_rate": float(1.0 - np.mean(success)),
        "timeout_rate": 0.0,
        "outcomes": "".join("s" if each else "c" for each in success),
    }
    return {"rows": [row], "seeds": list(seeds), "num_envs": len(success)}


def frozen(mean):
    """A result of the freeze test."""
    row = {"collision_rate": 0.5, "timeout_rate": 0.1}
    own = {"kind": "own", "camera": {"pan": MOTION, "tilt": MOTION}}
    lost = {"mean": -0.3, "ci95": [-0.4, -0.2]}
    return {"variants": [own, {"kind": "frozen", "mean_success": mean, "difference": lost, "rows": [row]}]}


SIGHT = {
    "groups": [
        {
            "cameras": [
                {"name": "held", "unseen": 0.67, "poses": [[-3.14, -1.25]]},
                {"name": "to and fro", "unseen": 0.24, "poses": []},
                {"name": "looks around", "unseen": 0.0, "poses": []},
            ]
        }
    ]
}


def store(steps, name, result):
    step = steps.by_name[name]
    kept = MACHINE | {
        "command": state.command_of(steps, step),
        "step": state.planned(step),
        "minutes": 2.0,
        "trainings": [training(steps, other) for other in steps.needs(step)],
        "result": result,
    }
    file = state.result_file(name)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(kept))


def store_places(steps, rates, group="shuttle"):
    """Results of all steps of a kind of places: the first so many of a hundred episodes succeed."""
    for step in steps.by_name.values():
        if not isinstance(step, Evaluation) or group not in step.name:
            continue
        kind, _, name = step.name.partition("/")
        camera = name.removeprefix(f"{group}_").rpartition("-")[0]
        made = {
            "active_camera": lambda c=camera: places(np.arange(EPISODES) < rates[c]),
            "active_camera_freeze": lambda: frozen(0.5),
            "active_camera_sight": lambda: SIGHT,
        }
        store(steps, step.name, made[kind]())


RATES = {"free": 80, "behind": 60, "down": 70, "across": 80, "start": 90, "blind": 10}


def test_rows_margins_and_verdicts(steps):
    store_places(steps, RATES)
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    rows = {row[1].split()[0].strip(","): row for row in made.rows[:-1]}
    assert rows["behind"][:4] == ("shuttle", "behind [-3.14,-1.25]", rows["behind"][2], "0.60 0.60")
    assert rows["free"][2].startswith("0.80 (") and rows["start"][1] == "start, frozen after 1.0 s"
    assert {row[0] for row in made.rows} == {"shuttle"}  # beam and crossing: nobody has begun them
    assert made.rows[-1][1] == "free, frozen at its mean"
    assert made.rows[-1][6] == "+0.30 (+0.20 to +0.40); +0.30 (+0.20 to +0.40)"
    verdicts = {claim.text.rpartition("_")[2]: claim.verdict for claim in made.claims}
    assert verdicts == {
        "behind": "met",
        "down": "better, by less than wanted",
        "across": "no difference shown",
        "start": "the other way round",
        "blind": "met",
    }
    worth = next(note for note in made.notes if note.startswith("shuttle: the free camera is "))
    assert "is not worth its motors" in worth and "shuttle_free over shuttle_start, -0.10 (" in worth
    bound = next(note for note in made.notes if note.startswith("shuttle, by the screening"))
    assert "in 0.67 of the episodes the best constant pose (-3.14, -1.25) misses" in bound
    assert "to and fro between two in 0.24," in bound
    assert any("pan -3.00 to +0.10 rad" in note for note in made.notes)
    assert all(len(row) == len(made.header) for row in made.rows)
    for write in table.FORMATS.values():
        assert "behind" in write(made)


def test_a_camera_that_beats_every_pose_is_worth_its_motors(steps):
    store_places(steps, RATES | {"across": 60, "start": 50, "down": 62})
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    worth = next(note for note in made.notes if note.startswith("shuttle: the free camera is worth"))
    assert "by the criterion; the smallest" in worth and "shuttle_free over shuttle_down, +0.18 (" in worth
    for seed, rate in ((1, 70), (2, 54)):  # the same on average
        store(steps, f"active_camera/shuttle_down-{seed}", places(np.arange(EPISODES) < rate))
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    assert any("by the criterion on average, not between all trainings; " in note for note in made.notes)
    down = next(claim for claim in made.claims if "down" in claim.text)
    assert down.line().endswith("wanted +0.15: met on average, not between all trainings")
    for seed in (1, 2):  # another is closer on average, and alike in both trainings
        store(steps, f"active_camera/shuttle_across-{seed}", places(np.arange(EPISODES) < 63))
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    worth = next(note for note in made.notes if note.startswith("shuttle: the free camera is worth"))
    assert "on average, not between all trainings; " in worth and "over shuttle_across, +0.17 (" in worth


def test_what_not_all_trainings_bear_out_is_not_worth_it(steps):
    store_places(steps, RATES | {"across": 60, "start": 50, "down": 62})
    for seed, rate in ((1, 95), (2, 65)):  # by 18 points on average, but one of them by 3
        store(steps, f"active_camera/shuttle_free-{seed}", places(np.arange(EPISODES) < rate))
    for seed, rate in ((1, 70), (2, 54)):
        store(steps, f"active_camera/shuttle_down-{seed}", places(np.arange(EPISODES) < rate))
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    assert any(note.startswith("shuttle: the free camera is not worth its motors") for note in made.notes)
    frozen = next(record for record in made.records if record["camera"] == "free, frozen at its mean")
    assert frozen["success_rate"] == 0.5 and frozen["difference"] == pytest.approx(0.3)


def test_other_ways_to_learn_are_compared_with_learning_alone(steps):
    """What they have in common with it is that nothing is imitated; that one, and those that imitate a gaze,
    are beside the free camera."""
    store_places(steps, RATES | {"floor": 30, "ahead": 30}, "beam")
    rates = {"learn_alone": 50, "learn_unpaid": 70, "learn_greedy": 60, "learn_scratch": 30}
    for step in steps.by_name.values():
        if isinstance(step, Evaluation) and step.name.startswith("active_camera_freeze/learn_"):
            result = frozen(0.5)
            won = {"mean_success": 0.8, "difference": {"mean": 0.4, "ci95": [0.3, 0.5]}}
            result["variants"].append(result["variants"][1] | won | {"kind": "sampled"})
            store(steps, step.name, result)
        if isinstance(step, Evaluation) and step.name.startswith("active_camera/learn_"):
            name = step.name.partition("/")[2].rpartition("-")[0]
            store(steps, step.name, places(np.arange(EPISODES) < rates.get(name, 40)))
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    rows = {row[1]: row for row in made.rows}
    records = {record["camera"]: record for record in made.records}
    assert records["alone, its actions drawn as in training"]["difference"] == pytest.approx(-0.4)
    assert rows["alone"][6].startswith("+0.30 (") and rows["unpaid"][6].startswith("-0.20 (")
    assert rows["greedy"][6].startswith("+0.20 (") and rows["scratch"][6].startswith("+0.50 (")
    drawn = rows["alone, its actions drawn as in training"]
    assert drawn[2:7] == ("0.80", "0.80", "0.50", "0.10", "-0.40 (-0.50 to -0.30)")
    assert rows["alone, frozen at its mean"][2] == "0.50" and "greedy, frozen at its mean" not in rows
    assert not any("learn: the free camera" in note for note in made.notes)


def test_a_variant_stands_where_every_training_has_it():
    drawn = frozen(0.6)
    drawn["variants"].append(drawn["variants"][1] | {"kind": "sampled"})
    facts = {"trainings": [{"name": "a-1"}]}

    def labels(*results):
        measured = active_camera.Measured("a", tuple(facts | {"result": result} for result in results))
        return [row[1] for row in camera_variants.variant_rows("beam", "a", measured)]

    assert labels(drawn, frozen(0.5)) == ["a, frozen at its mean"]
    assert labels(drawn, drawn) == ["a, frozen at its mean", "a, its actions drawn as in training"]


def test_fetches_stand_below_once_they_are_measured(steps):
    store_places(steps, RATES)
    for name in steps.by_name:
        if name.startswith("active_camera_fetch/"):
            successes = 54 if "free" in name else 3 if "blind" in name else 36 if "-1" in name else 24
            store(
                steps,
                name,
                places(np.arange(60) < successes)
                | {
                    "overall": {"collision_rate": 0.1, "timeout_rate": 0.0},
                    "camera_pose": None if "free" in name or "blind" in name else [0.0, -0.7],
                },
            )
    with pytest.raises(ConfigError, match=r"only=active_camera_sight/fetch$"):
        active_camera.active_camera(Stored(steps, "active_camera"))
    store(steps, "active_camera_sight/fetch", SIGHT)
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    rows = made.rows[-6:]
    held = [f"{pose} [0,-0.7]" for pose in ("right", "aside", "ahead")]
    assert [row[1] for row in rows] == ["free", "free, frozen at [0,-0.7]", "free, blind", *held]
    # Scenes of 0.5 in 12 and 1 in 18 of 60, and one of 1 and one of -1: 0.387 +- 1.96 * 0.470 / 62 ** 0.5.
    assert rows[1][6] == "+0.40 (+0.27 to +0.50)" and rows[1][3] == "0.60 0.40"
    assert rows[3][6] == rows[1][6] and rows[2][6].startswith("+0.85 (")
    assert "fetch_pick_free-2" in rows[0][7] and "fetch_pick_right-2" in rows[3][7]
    worth = next(note for note in made.notes if note.startswith("fetch: the free camera is worth"))
    assert "free over right in fetches, +0.40" in worth
    assert made.claims[-1].verdict == "met" and made.claims[-1].trainings == pytest.approx((0.3, 0.5))


def test_fetches_need_no_other_kind_of_places(steps):
    for name in steps.by_name:
        if name.startswith("active_camera_fetch/"):
            facts = {"overall": {"collision_rate": 0.1, "timeout_rate": 0.0}, "camera_pose": None}
            store(steps, name, places(np.arange(60) < 30) | facts)
    store(steps, "active_camera_sight/fetch", SIGHT)
    made = active_camera.active_camera(Stored(steps, "active_camera"))
    assert {row[0] for row in made.rows} == {"fetch"}
    assert len(table.csv_text(made).splitlines()) == 1 + len(made.rows)


def test_scenes_are_paired_and_trainings_averaged():
    """Against the formula of a difference of means, and an interval that knows which scenes are hard."""
    rng = np.random.default_rng(1)
    hard = rng.random(300) < 0.5
    facts = {"trainings": [{"name": "a-1"}]}

    def measured(name, *successes):
        return active_camera.Measured(name, tuple(facts | {"result": places(s)} for s in successes))

    free, other = measured("free", ~hard, ~hard), measured("other", ~hard & (rng.random(300) < 0.8), ~hard)
    margin = active_camera.margin_over("other", free, other)
    lost = np.mean([free.rate().value - other.rate().value])
    assert margin.ours == pytest.approx(lost) and margin.trainings[0] == 0.0
    # Unpaired, the interval of two rates near 0.5 would be 0.11 wide either way.
    assert 0.0 < margin.low < margin.ours < margin.high < margin.ours + 0.04


def test_results_of_other_scenes_are_refused():
    facts = {"trainings": [{"name": "a-1"}]}
    made = [
        active_camera.Measured("a", (facts | {"result": places(np.ones(10), seeds)},))
        for seeds in ((3,), (4,))
    ]
    with pytest.raises(ConfigError, match="table: b and a were measured in other scenes"):
        active_camera.margin_over("b", *made)


def test_what_is_missing_is_one_line_with_its_command(steps):
    said = r"^table: active_camera: not measured yet, {}: spin-reproduce plan=active_camera run=true "
    all_of_it = said.format("15 results") + r"'only=\[active_camera/shuttle_free-,active_camera/"
    with pytest.raises(ConfigError, match=all_of_it):
        active_camera.active_camera(Stored(steps, "active_camera"))
    store_places(steps, RATES)
    stored = Stored(steps, "active_camera")
    active_camera.active_camera(stored)
    for step in stored.used:
        file = state.result_file(step.name)
        kept = file.read_text()
        file.unlink()
        with pytest.raises(ConfigError, match=said.format("1 result") + f"only={step.name}$"):
            active_camera.active_camera(Stored(steps, "active_camera"))
        file.write_text(kept)


@pytest.mark.parametrize("step", TRAININGS, ids=lambda step: step.name)
def test_every_training_can_be_started(step):
    values = with_depth(compose("train", [*SHIPPED.arguments(step), f"seed={step.seed}"]))
    common.check_keys("train", values, common.keys_of(train.Options, common.GROUPS))
    spec = find_task(values["task"]["name"])
    task = spec.configure(values)
    check_config(values["runner"], spec.groups, values["num_envs"])
    held = values["runner"]["actor"]["distribution_cfg"].get("num_used") == 8
    assert held == (task.camera_pose is not None or (spec.name == "nav" and task.teach_gaze))
    assert task.sim.kinematic or spec.name == "pick"


def test_trainings_of_a_kind_of_places_differ_in_the_camera_and_how_it_learns():
    for group in ("shuttle", "beam", "static", "crossing"):
        own = [step for step in TRAININGS if step.group == group]
        assert len({SHIPPED.needs(step)[0] for step in own if SHIPPED.needs(step)}) in (0, 2)  # of each seed
        assert len(own) == 12 and {step.seed for step in own} == {1, 2}
        assert len({step.env_steps for step in own}) == 1
        free = set(SHIPPED.by_name[f"{group}_free-1"].arguments)
        gaze = {given for given in free if given.startswith(("algo=gaze", "task.gaze_poses="))}  # it imitates
        assert "algo=gaze" in gaze
        free -= gaze
        for step in own:
            given = {argument.replace("base-2", "base-1") for argument in step.arguments}
            further = given - free - gaze
            assert free <= given
            about = ("camera", "num_used", "init_std") if "_start-" in step.name else ("camera", "num_used")
            assert all(any(word in given for word in about) for given in further), step.name


def test_evaluations_compose_and_are_of_scenes_that_nothing_else_used():
    for step in SHIPPED.by_name.values():
        if isinstance(step, Evaluation):
            given = SHIPPED.arguments(step)
            task = ["task=fetch"] if "benchmark=fetch" in given else []  # as the command itself adds
            values = compose(step.command, [*task, *given])
            if step.name.startswith(("active_camera/", "active_camera_freeze/")):
                assert values["seeds"] == [3]
    assert PLANS["active_camera"] == SHIPPED.plan
