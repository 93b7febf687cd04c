"""The distributions in conf/scene: they can be read, are what they say, and have a way through."""

import sys

import pytest
from scene_worlds import PARAMS

from spin_rl.paths import CONF_DIR
from spin_rl.planning import solvability
from spin_rl.scenes.kinds import FAMILIES

# Of other generators: tables, a corridor with a table, and families of places.
OTHERS = {"fetch", "tabletop", "mixture", "emerging", "blind_crossing", *FAMILIES}
FILES = {file.stem for file in (CONF_DIR / "scene").glob("*.yaml")}
NAMES = sorted(FILES - OTHERS)


def test_these_are_the_variants():
    assert NAMES == ["beam", "hidden", "long", "looking", "moving", "nav", "static_beam"] and OTHERS < FILES
    assert solvability.scene_params("nav") == PARAMS


@pytest.mark.parametrize("name", NAMES)
def test_corridors_of_a_variant_have_a_way_through(name):
    params = solvability.scene_params(name)
    for scenario in (1, 2):
        scenes = solvability.generate_scenes(2, scenario, 2, seed=4, params=params)
        assert all(solvability.is_solvable(scene) for scene in scenes)
        assert all(scene.num_obstacles == params.hard_obstacles for scene in scenes)
        assert all(abs(scene.goal).sum() == pytest.approx(params.length, abs=1e-5) for scene in scenes)


def test_variants_differ_as_they_say():
    scenes = {
        name: solvability.generate_scenes(100, 2, 2, params=solvability.scene_params(name)) for name in NAMES
    }
    moving = {name: any(scene.moves for scene in group) for name, group in scenes.items()}
    assert moving == {
        "beam": True,
        "hidden": False,
        "long": False,
        "looking": True,
        "moving": True,
        "nav": False,
        "static_beam": False,
    }
    for still, moved in zip(scenes["nav"], scenes["moving"], strict=True):
        assert (still.pos == moved.pos).all() and (still.half_size == moved.half_size).all()


def test_the_command_checks_the_named_variant(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["solvability", "--layouts", "1", "--scene", "long"])
    lengths = []

    class Inline:
        def __init__(self, processes):
            assert processes == 1

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def map(self, function, scenes, chunksize):
            lengths.extend(abs(scene.goal).sum() for scene in scenes)
            return [True for _ in scenes]

    monkeypatch.setattr(solvability, "ProcessPoolExecutor", Inline)
    solvability.main()
    assert lengths == pytest.approx([8.0] * 6, abs=1e-5)
    assert capsys.readouterr().out.count("1.0000") == 6
