"""What constant poses would have shown in fetches: the object when it counts, obstacles while driving."""

import numpy as np
import pytest
import torch
from test_sight import POSES

from spin_rl.analysis.sight import judge, report
from spin_rl.analysis.sight.analysis import analyse_sight
from spin_rl.analysis.sight.fetches import ALIGN, CARRY, PICK, REACH, FetchWatch, ObjectRecord, object_events
from spin_rl.analysis.sight.heads import Poses
from spin_rl.analysis.sight.options import SightOptions
from spin_rl.benchmark import policies, registry
from spin_rl.tasks.fetch.config import FetchConfig, StageLimits
from spin_rl.tasks.fetch.env import FetchEnv

OPTIONS = SightOptions(POSES.pans, POSES.tilts, fresh_s=0.2)
PERIOD = 0.1


def record(stages, shown):
    """One fetch, given its stages and the numbers of the poses that show the object at each observation."""
    words = [[sum(1 << pose for pose in poses)] for poses in shown]
    return ObjectRecord(np.array(stages)[:, None], np.array(words, dtype=np.uint32)[:, None])


def test_an_object_is_to_be_found_on_the_way_and_in_view_before_the_hand():
    stages = [REACH, REACH, ALIGN, ALIGN, PICK, PICK, CARRY]
    shown = [(0,), (), (1, 2), (3,), (2,), (4,), ()]
    events = object_events(record(stages, shown), 5, OPTIONS, PERIOD)
    assert events.world.tolist() == [0, 0] and events.step.tolist() == [2, 4]
    # Until the table everything counts; then what is seen at most 0.2 s before the pick begins.
    assert judge.held(events).tolist() == [
        [True, True, True, False, False],
        [False, True, True, True, False],
    ]
    assert events.failed(judge.held(events))[0].tolist() == [True, False, False, True, True]


def test_a_fetch_that_ended_on_the_way_asks_for_no_object():
    events = object_events(record([REACH, REACH, -1], [(0,), (), ()]), 5, OPTIONS, PERIOD)
    assert len(events.world) == 0 and events.worlds == 1
    assert not events.failed(judge.held(events)).any()


class Idle:
    def __call__(self, obs):
        return torch.zeros(obs.batch_size[0], 10, device=obs.device)

    def reset(self, dones=None):
        pass


@pytest.mark.parametrize("pose", [(0.0, -0.7), (-3.14, -0.7)])
def test_the_object_is_shown_where_the_environment_sees_it(device, pose):
    """Robots at the table: the sight of a camera held at a pose, against that of all poses at once."""
    env = FetchEnv(FetchConfig(camera_pose=pose), 4, device, seed=3)
    env.set_cells([1, 2, 1, 2], [0] * 4)
    env.reset()
    goal = env.goal.cpu().numpy()
    table = env.sim.layout.pos.numpy()[:, env.cfg.scene.table_slot, :2]
    to_table = table - goal
    for world in range(4):
        env.sim.views.qpos[world, :2] = torch.as_tensor(goal[world])
        env.sim.views.qpos[world, 2] = float(np.arctan2(*to_table[world, ::-1]))
    env.step(torch.zeros(4, 10, device=env.device))
    poses = Poses(tuple(sorted({pose[0], 1.0})), (-1.4, pose[1]))
    watch = FetchWatch(Idle(), env, poses, lead_s=0.8, near_m=0.03)
    watch.reset()
    watch(env.get_observations())
    watch.finish()
    number = [tuple(each) for each in poses.table].index(pose)
    bits = judge.bits_of(watch.objects[0].shown, len(poses))
    assert bits[0, :, number].tolist() == env.sight.seen.numpy().tolist() == [pose[0] == 0.0] * 4


def test_an_analysis_of_fetches_is_whole(device):
    cfg = FetchConfig(limits=StageLimits(reach=0.5))
    result = analyse_sight(
        registry.find("fetch", "fetch"),
        policies.open_policy("zero").make,
        cfg,
        SightOptions(POSES.pans, POSES.tilts),
        1,
        [0],
        device,
        policy_name="zero",
        pick_name="zero",
        report=lambda line: None,
    )
    groups = {group["name"]: group for group in result["groups"]}
    assert list(groups) == ["whole fetch", "driving", "object"] and result["pick"] == "zero"
    assert all(group["episodes"] == 6 and np.shape(group["unseen"]) == (5, 4) for group in groups.values())
    # Nobody came to a table.
    assert groups["object"]["decisive"] == 0.0 and groups["object"]["cameras"][0]["unseen"] == 0.0
    assert report.table(result).splitlines()[0].startswith("Sight: zero drives, 6 episodes")
