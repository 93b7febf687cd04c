"""Scripts and stages of a fetch on the robot beside those of training, from the same random states."""

import dataclasses

import numpy as np
import pytest
import warp as wp

from spin_rl import robot
from spin_rl.config import from_keys
from spin_rl.deploy.contract import Profile
from spin_rl.deploy.fetch import numbers as n
from spin_rl.deploy.fetch import script, stages
from spin_rl.deploy.fetch.known import Grip, Known, Now, Slots, read, tell
from spin_rl.deploy.fetch.memory import Memory
from spin_rl.export.write import fetch_settings
from spin_rl.sim.drive import DriveLimits
from spin_rl.sim.targets import make_increments
from spin_rl.tasks.common.episode import RUNNING, SUCCESS, StepEnd
from spin_rl.tasks.common.rules import rules_of
from spin_rl.tasks.fetch import stages as fetch_stages
from spin_rl.tasks.fetch import start as fetch_start
from spin_rl.tasks.fetch import state as fetch_state
from spin_rl.tasks.fetch.config import FetchConfig
from spin_rl.tasks.fetch.known import Known as WarpKnown
from spin_rl.tasks.fetch.scripts import kernel as fetch_script
from spin_rl.tasks.pick.episode import Forces
from spin_rl.warp_kernels.slots import Slots as WarpSlots
from spin_rl.warp_kernels.structs import struct_of

NUM, NUM_SLOTS = 3000, 4
PERIOD = 0.1
CFG = FetchConfig(carry_moves=("lift", "wrist_pitch"))
IS_CYLINDER = np.array([False, False, True, True])
LOW, HIGH = np.array(robot.JOINT_LOWER), np.array(robot.JOINT_UPPER)
OBJECT_LENGTH = 0.07
FLAGS = ("ready", "detour", "is_found")
COUNTS = {"time": 150, "phase_time": 12, "held": 12, "loose": 3, "stuck": 5, "retries": 2}


def draw(seed):
    """States of all worlds as arrays, by name: memory, robot, what is told, and a policy's actions."""
    rng = np.random.default_rng(seed)
    every = {name: rng.integers(0, most + 1, NUM) for name, most in COUNTS.items()}
    every |= {name: rng.random(NUM) < 0.5 for name in FLAGS}
    every["stage"] = rng.integers(0, len(n.STAGES), NUM)
    last = np.array([9, 7, 9, 4, 9, 5])[every["stage"]]
    every["phase"] = (rng.random(NUM) * (last + 1)).astype(int)
    every["length"] = rng.integers(1, 1000, NUM)
    every["base"] = rng.uniform([-0.5, -0.4, -4.0], [3.0, 0.4, 4.0], (NUM, 3))
    every["home"] = rng.uniform([-0.3, -0.4], [0.5, 0.4], (NUM, 2))
    near = rng.random((NUM, 1)) < 0.5  # where robots arrive
    every["goal"] = every["base"][:, :2] + np.where(near, 0.3, 3.0) * rng.uniform(-1, 1, (NUM, 2))
    every["stand"] = every["base"] + rng.uniform(-0.4, 0.4, (NUM, 3))
    every["found"] = rng.uniform([-0.5, -1.0, 0.3], [3.5, 1.0, 1.0], (NUM, 3))
    every["grip"] = rng.uniform(-0.9, 0.3, (NUM, 2))
    every["mark"], every["rest"] = rng.uniform(0.0, 1.1, NUM), rng.uniform(0.4, 0.9, NUM)
    every["joints"], every["target"] = rng.uniform(LOW, HIGH, (NUM, 8)), rng.uniform(LOW, HIGH, (NUM, 8))
    stands = rng.random((NUM, 1)) < 0.3  # where targets are those of the pose already
    every["target"] = np.where(stands, every["target"].round(1), every["target"])
    every["turning"] = rng.uniform(-0.2, 0.2, NUM)
    every["action"] = rng.uniform(-1.0, 1.0, (NUM, 10))
    every["fingers"] = rng.choice([0.0, 0.4, 1.5, 8.0], (NUM, 2))
    every["table_n"], every["hard_n"] = rng.choice([0.0, 5.0], NUM), rng.choice([0.0, 0.0, 0.0, 35.0], NUM)
    every["support"], every["seen"] = rng.random(NUM) < 0.5, rng.random(NUM) < 0.5
    every["speed"] = rng.choice([0.0, 0.2], NUM)
    every["half"] = rng.uniform(0.05, 0.4, (NUM, NUM_SLOTS, 3))
    every["half"][:, 2:, 1] = every["half"][:, 2:, 0]
    every["pos"] = rng.uniform([-1.0, -1.5, -0.1], [3.5, 1.5, 0.6], (NUM, NUM_SLOTS, 3))
    every["yaw"] = rng.uniform(-3.0, 3.0, (NUM, NUM_SLOTS))
    top = every["pos"][:, 0] + every["half"][:, 0] * [0.0, 0.0, 1.0]
    at = rng.random((NUM, 1))
    low = np.column_stack([every["home"] + rng.uniform(-0.6, 0.6, (NUM, 2)), rng.uniform(0.04, 0.1, NUM)])
    over = top + rng.uniform([-0.3, -0.3, -0.1], [0.3, 0.3, 0.3], (NUM, 3))
    every["at"] = np.where(at < 0.3, low, over)
    return {name: as_single(values) for name, values in every.items()}


def as_single(values):
    """What float32 holds, in float64."""
    return values.astype(np.float32).astype(float) if values.dtype == float else values


def known_of(e, i):
    slots = Slots(e["pos"][i], e["yaw"][i], e["half"][i], IS_CYLINDER)
    table = Slots(*(values[:1] for values in (slots.pos, slots.yaw, slots.half, slots.is_cylinder)))
    fingers = tuple(e["fingers"][i].tolist())
    grip = Grip(fingers, float(e["table_n"][i]), float(e["hard_n"][i]), bool(e["support"][i]))
    known = Known(grip, e["at"][i], float(e["speed"][i]), bool(e["seen"][i]), OBJECT_LENGTH, table, slots)
    return read(tell(known))


def now_of(e, i):
    return Now(e["base"][i], float(e["turning"][i]), e["joints"][i], e["target"][i], known_of(e, i), PERIOD)


def memory_of(e, i):
    counts = {name: int(e[name][i]) for name in ("stage", "phase", "length", *COUNTS)}
    flags = {name: bool(e[name][i]) for name in FLAGS}
    points = {name: e[name][i].copy() for name in ("home", "goal", "stand", "found")}
    rest = {"grip": tuple(e["grip"][i]), "mark": float(e["mark"][i]), "rest": float(e["rest"][i])}
    return Memory(**counts, **flags, **points, **rest)


def warp_state(e, device):
    state = fetch_state.make_state(NUM, device)
    for field in dataclasses.fields(Memory):
        if field.name != "goal":
            getattr(state, field.name).assign(e[field.name])
    return state


def assert_memories_equal(memories, state):
    for field in dataclasses.fields(Memory):
        if field.name != "goal":
            ours = np.array([getattr(memory, field.name) for memory in memories], dtype=float)
            theirs = getattr(state, field.name).numpy()
            np.testing.assert_allclose(ours, theirs, atol=1e-5, err_msg=field.name)


def profile():
    found = robot.SPEED_PROFILES["paper"]
    return Profile(name="paper", turn_acceleration=found.turn_acceleration, **vars(found))


@pytest.mark.parametrize("seed", [0, 1])
def test_scripts_want_what_they_do_in_training(device, seed):
    e = draw(seed)
    increments = CFG.manipulation.increments
    speeds = (increments.forward_speed, increments.turn_speed)
    with wp.ScopedDevice(device):
        state, known, near = warp_state(e, device), WarpKnown(), WarpSlots()
        known.base, known.turning = wp.array(e["base"], dtype=wp.vec3), wp.array(e["turning"], dtype=float)
        known.target, known.finger = (
            wp.array(e["target"], dtype=float),
            wp.array(e["joints"][:, 5], dtype=float),
        )
        grips = [known_of(e, i).grip for i in range(NUM)]
        known.holds = wp.array([grip.holds for grip in grips], dtype=bool)
        known.supported = wp.array([grip.stands for grip in grips], dtype=bool)
        known.table_yaw = wp.array(e["yaw"][:, 0], dtype=float)
        near.pos, near.half_size = wp.array(e["pos"], dtype=wp.vec3), wp.array(e["half"], dtype=wp.vec3)
        near.yaw, near.active = wp.array(e["yaw"], dtype=float), wp.full((NUM, NUM_SLOTS), True, dtype=bool)
        near.is_cylinder = wp.array(IS_CYLINDER, dtype=bool)
        known.near = near
        drive = struct_of(
            fetch_script.Drive,
            DriveLimits.create(robot.SPEED_PROFILES["paper"], device),
            carry_moves=wp.array([joint in CFG.carry_moves for joint in robot.JOINTS], dtype=wp.bool),
            carry_lift_m=CFG.carry_lift_m,
            pick_speed=wp.vec2(*speeds),
            turns_to_look=False,
            period=PERIOD,
        )
        action = wp.array(e["action"], dtype=float)
        wp.launch(fetch_script.script_actions, dim=NUM, inputs=[drive, known], outputs=[state, action])
    memories = [memory_of(e, i) for i in range(NUM)]
    ours = script.Drive(profile(), CFG.carry_moves, CFG.carry_lift_m, speeds)
    actions = [script.act(ours, now_of(e, i), memories[i], e["action"][i]) for i in range(NUM)]
    np.testing.assert_allclose(actions, action.numpy(), atol=1e-5)
    assert_memories_equal(memories, state)
    moved = np.abs(np.array(actions) - e["action"]).max(-1)[e["stage"] == n.PICK] > 1e-3
    assert 0.1 < moved.mean() < 0.9  # the bumper acts, and not always


@pytest.mark.parametrize("seed", [2, 3])
def test_stages_follow_each_other_as_in_training(device, seed):
    e = draw(seed)
    e["length"][:] = 1
    with wp.ScopedDevice(device):
        state, end = warp_state(e, device), StepEnd()
        limits = [round(limit / PERIOD) for limit in CFG.limits.seconds()]
        bodies = bodies_of(e)
        rules = rules_of(
            fetch_state.FetchRules, CFG, limits=wp.array(limits, dtype=wp.int32), table_slot=0, must_see=True
        )
        end.qpos, end.qvel = wp.zeros_like(bodies.qpos), wp.zeros_like(bodies.qvel)
        end.outcome, end.done = wp.zeros(NUM, dtype=wp.int32), wp.zeros(NUM, dtype=bool)
        increments = make_increments(CFG.manipulation.increments, PERIOD, device)
        forces, seen = Forces(), wp.array(e["seen"], dtype=bool)
        forces.finger, forces.table = wp.array(e["fingers"], dtype=float), wp.array(e["table_n"], dtype=float)
        forces.hard, forces.support = wp.array(e["hard_n"], dtype=float), wp.array(e["support"], dtype=bool)
        wp.launch(
            fetch_stages.advance_stages,
            dim=NUM,
            inputs=[bodies, forces, rules, increments, seen],
            outputs=[
                state, fetch_state.make_record(NUM, device), wp.zeros(NUM, dtype=wp.int32),
                wp.zeros((NUM, 10), dtype=float), end,
            ],
        )  # fmt: skip
        at = wp.array(e["at"], dtype=wp.vec3)
        wp.launch(fetch_start.watch_objects, dim=NUM, inputs=[seen, at], outputs=[state])
    ours = from_keys(stages.Rules, fetch_settings(CFG, "nav.onnx", "pick.onnx")["settings"])
    memories = [memory_of(e, i) for i in range(NUM)]
    ended = []
    for i, memory in enumerate(memories):
        ended.append(stages.advance(memory, ours, now_of(e, i)))
        stages.watch(memory, known_of(e, i))
    outcome = end.outcome.numpy()
    assert [why is None for why in ended] == (outcome == RUNNING).tolist()
    assert [why == stages.PLACED for why in ended] == (outcome == SUCCESS).tolist() and SUCCESS in outcome
    goes_on = np.flatnonzero(outcome == RUNNING)
    assert_memories_equal([memories[i] for i in goes_on], Rows(state, goes_on))
    goals = np.array([memories[i].goal for i in goes_on])
    np.testing.assert_allclose(goals, bodies.goal.numpy()[goes_on], atol=1e-6)
    after = state.stage.numpy()[goes_on]
    assert {(a, b) for a, b in zip(e["stage"][goes_on], after, strict=True) if a != b} == {
        (0, 1), (1, 2), (2, 1), (2, 3), (3, 1), (3, 4), (4, 5),
    }  # fmt: skip


class Rows:
    """Some rows of a state's arrays."""

    def __init__(self, state, rows):
        self._state, self._rows = state, rows

    def __getattr__(self, name):
        return wp.array(getattr(self._state, name).numpy()[self._rows], device="cpu")


def bodies_of(e):
    dofs = len(robot.DOF_NAMES)
    qpos, qvel = np.zeros((NUM, dofs + 7)), np.zeros((NUM, dofs + 6))
    qpos[:, :3], qpos[:, dofs : dofs + 3] = e["base"], e["at"]
    for dof, (joint, share) in zip(range(3, dofs), robot.DOF_SOURCE, strict=True):
        qpos[:, dof] = share * e["joints"][:, robot.JOINTS.index(joint)]
    qvel[:, dofs] = e["speed"]
    bodies = fetch_state.Bodies()
    bodies.qpos, bodies.qvel = wp.array(qpos, dtype=float), wp.array(qvel, dtype=float)
    bodies.parts = wp.array(np.repeat(e["hard_n"][:, None] > 0.0, len(robot.PARTS), 1), dtype=bool)
    bodies.target = wp.array(e["target"], dtype=float)
    bodies.object_kind, bodies.object_start = wp.zeros(NUM, dtype=wp.int32), wp.zeros(NUM, dtype=wp.vec4)
    bodies.half_extents = wp.full(NUM, wp.vec3(OBJECT_LENGTH, 0.0, 0.0), dtype=wp.vec3)
    bodies.goal = wp.array(e["goal"], dtype=wp.vec2)
    bodies.slots.pos, bodies.slots.yaw = wp.array(e["pos"], dtype=wp.vec3), wp.array(e["yaw"], dtype=float)
    bodies.slots.half_size = wp.array(e["half"], dtype=wp.vec3)
    return bodies
