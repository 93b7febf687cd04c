"""The scenes benchmark: every trip is driven once, by scene."""

import numpy as np

from spin_rl.benchmark import policies, scenes
from spin_rl.benchmark.tables import rooms as tables
from spin_rl.paths import CONF_DIR
from spin_rl.planning.distance_field import CLEARANCE_M
from spin_rl.scenes.scene_file import load_scene
from spin_rl.tasks.nav.config import NavConfig


def test_two_scenes_with_more_trips_than_worlds(monkeypatch, device):
    names = ("corridor", "playroom")
    files = {name: load_scene(CONF_DIR / "scenes_examples" / f"{name}.yaml") for name in names}
    monkeypatch.setattr(scenes, "example_scenes", lambda: files)
    seen = []

    class Watched(scenes.NavEnv):
        def set_scenes(self, chosen):
            super().set_scenes(chosen)
            ways = self.sim.layout.goal.numpy() - self.sim.layout.start.numpy()[:, :2]
            seen.append(np.linalg.norm(ways, axis=1))

        def step(self, actions):
            result = super().step(actions)
            # No way is shorter than the straight line, up to the grid's cells.
            assert (self.final_way.numpy(force=True) > seen[-1] - CLEARANCE_M).all()
            return result

    monkeypatch.setattr(scenes, "NavEnv", Watched)
    result = scenes.evaluate_scenes(
        policies.open_policy("zero").make,
        NavConfig(slack_s=0.3, slowness=0.01),
        3,
        [0, 1],
        device,
        num_envs=4,
        report=lambda line: None,
    )
    assert [(row["scene"], row["episodes"], row["timeout_rate"]) for row in result["rows"]] == [
        ("corridor", 6, 1.0),
        ("playroom", 6, 1.0),
    ]
    assert result["num_envs"] == 3 and len(seen) == 5  # at the start, then two rounds a seed
    assert tables.scenes_table(result).splitlines()[2].startswith("corridor  0.00")
