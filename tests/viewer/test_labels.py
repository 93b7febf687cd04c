from dataclasses import replace

import pytest
from viewer_worlds import fetch_snapshot, pick_snapshot, snapshot

from spin_rl.viewer.browser.view import status_text
from spin_rl.viewer.labels import cell_label, progress_label, summary


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


@pytest.mark.parametrize(
    ("stage", "progress"),
    [
        ("reach", "goal in 3.50 m"),
        ("align", "mug seen"),
        ("pick", "lifted 0.10 m, grip 12 N"),
        ("retract", "lifted 0.10 m, grip 12 N"),
        ("carry", "start in 3.50 m, grip 12 N"),
        ("place", "object 1.35 m from start, grip 12 N"),
    ],
)
def test_a_fetch_is_told_by_what_its_stage_is_about(stage, progress):
    state = fetch_snapshot(stage, "mug")
    assert cell_label(state) == "scenario 1, easy, mug"
    assert progress_label(state) == progress
    text = status_text(state)
    assert f"{stage}, running" in text and progress in text and "1 corners seen, mug seen" in text


def test_a_summary_says_in_which_stages_fetches_failed():
    last = [fetch_snapshot(stage, outcome="dropped") for stage in ("carry", "pick", "carry")]
    assert last[0].cause == "carry dropped"
    last.append(fetch_snapshot("place", outcome="success"))
    assert last[-1].cause == "success"
    assert summary(last) == "1 of 4 fetches done (2 carry dropped, 1 pick dropped)"
    assert summary(last[-1:]) == "1 of 1 fetches done"


def test_summaries_of_other_tasks_name_their_aim():
    reached, failed = snapshot(outcome="success"), snapshot(outcome="timeout")
    assert summary([reached, failed, reached]) == "2 of 3 episodes reached the goal"
    held = replace(pick_snapshot(), outcome="success")
    assert summary([held]) == "1 of 1 episodes held the object up"
