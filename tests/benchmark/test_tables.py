import json
from dataclasses import asdict

import pytest

from spin_rl import robot
from spin_rl.benchmark.reach import REACH_CELLS
from spin_rl.benchmark.tables import pick as pick_report
from spin_rl.benchmark.tables import reach as report
from spin_rl.files import write_json
from spin_rl.sensors.depth.noise import DepthNoiseConfig

CAUSES = dict.fromkeys((*robot.PARTS, "timeout", "non_finite"), 0.0)


def make_row(scenario, difficulty, **changes):
    row = {
        "scenario": scenario,
        "difficulty": difficulty,
        "success_rate": 0.8,
        "ci95": [0.711, 0.867],
        "duration_s": 6.54,
        "duration_all_s": 8.0,
        "collision_rate": 0.15,
        "timeout_rate": 0.05,
        "non_finite": 0,
        "final_distance_m": 0.4,
        "episodes": 100,
        "causes": CAUSES | {"base": 0.75, "timeout": 0.25},
    }
    return row | changes


def make_result(rows):
    return {
        "policy": "nav-cvo",
        "benchmark": "reach",
        "rows": rows,
        "seeds": [0, 1],
        "robot": "paper",
        "camera_mount": "portrait",
    }


@pytest.fixture
def six_cells():
    return make_result([make_row(cell.scenario, cell.difficulty) for cell in REACH_CELLS])


def test_table_stands_beside_the_paper(six_cells):
    lines = report.table(six_cells).splitlines()
    assert "nav-cvo" in lines[0] and "100 episodes" in lines[0] and "seeds 0, 1" in lines[0]
    assert "SPIN (CVO)" in lines[1] and "FixCam" in lines[1]
    hard = lines[7]
    assert hard.split() == (
        "2 L hard 0.80 0.71-0.87 6.5 s 0.93 29.3 s 0.26 42.4 s base 75%, timeout 25%".split()
    )
    # Columns line up.
    assert len({line.index("0.71-") for line in lines[2:8]}) == 1


def test_another_distribution_of_corridors_is_named_and_not_beside_the_paper(six_cells):
    lines = report.table(six_cells | {"scene": "moving, scene.width=1.1"}).splitlines()
    assert lines[0].endswith(", scene moving, scene.width=1.1")
    assert "SPIN" not in lines[1]
    assert "scene" not in report.table(six_cells).splitlines()[0]


def test_images_are_named_with_their_noise(six_cells):
    noise = asdict(DepthNoiseConfig())
    title = report.table(six_cells | {"depth": {"noise": noise}, "scene": "moving"}).splitlines()[0]
    assert title.endswith(", camera portrait, depth noise ideal, scene moving")
    title = report.table(six_cells | {"depth": {"noise": noise | {"dropout": 0.1}}}).splitlines()[0]
    assert title.endswith(", depth noise ideal, dropout=0.1")
    assert "depth" not in report.table(six_cells | {"depth": None})


def test_table_without_success(six_cells):
    six_cells["rows"][0] |= {"success_rate": 0.0, "duration_s": None}
    assert " -  " in report.table(six_cells).splitlines()[2]


def test_table_of_a_scene_has_no_paper_columns():
    text = report.table(make_result([make_row("kitchen.yaml", "scene")]))
    assert "kitchen.yaml" in text and "SPIN" not in text and "paper (Table 1)" not in text


def test_table_of_picks_tells_successes_without_contact():
    rows = [make_row(0, "", object=name, untouched_rate=rate) for name, rate in (("mug", 0.7), ("can", 0.5))]
    lines = pick_report.table(make_result(rows) | {"overall": rows[0] | {"untouched_rate": 0.6}}).splitlines()
    at = lines[1].index("untouched")
    assert [line[at:].split()[0] for line in lines[1:5]] == ["untouched", "0.60", "0.70", "0.50"]


def test_main_causes_are_sorted_and_limited():
    causes = CAUSES | {"base": 0.1, "arm": 0.5, "head": 0.2, "timeout": 0.4}
    assert report.main_causes(make_row(1, "easy", causes=causes)) == "arm 50%, timeout 40%, head 20%"
    assert report.main_causes(make_row(1, "easy", causes=CAUSES)) == "-"


def test_headline(six_cells):
    six_cells["rows"][0]["success_rate"] = 0.2
    assert report.headline(six_cells) == "mean success 0.70 over 6 cells, 600 episodes"


def test_json_makes_its_folder_and_replaces_the_file(six_cells, tmp_path):
    path = tmp_path / "new" / "reach.json"
    write_json(path, {"old": 1})
    write_json(path, six_cells)
    assert json.loads(path.read_text()) == six_cells
    assert [entry.name for entry in path.parent.iterdir()] == ["reach.json"]
