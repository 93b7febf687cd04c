from viewer_worlds import pick_snapshot, snapshot

from spin_rl.viewer.browser import status_text
from spin_rl.viewer.labels import cell_label, progress_label


def test_a_pick_is_told_by_its_object():
    state = pick_snapshot("mug", seen=False)
    assert cell_label(state) == "mug"
    assert progress_label(state) == "lifted 0.10 m, grip 12 N"
    assert "mug not seen" in status_text(state) and "goal" not in status_text(state)
    fallen = pick_snapshot("mug", pose=(1.0, 0.9, 0.1, 1.0, 0.0, 0.0, 0.0))
    assert progress_label(fallen).startswith("lifted 0.00 m")


def test_a_drive_is_told_by_its_corridor():
    state = snapshot()
    assert cell_label(state) == "scenario 1, easy"
    assert progress_label(state) == "goal in 3.50 m"
    assert "1 corners seen" in status_text(state)
