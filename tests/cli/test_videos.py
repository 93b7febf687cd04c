"""Videos of a run on the way: counted on, one at the end, and a failure that is told and stops nothing."""

import sys
import time

import pytest

from spin_rl.cli import videos

WRITES = "import pathlib, sys; p = pathlib.Path(sys.argv[1]); p.parent.mkdir(exist_ok=True); p.touch()"


@pytest.fixture
def run(tmp_path):
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "last.pt").touch()
    return tmp_path


def play(monkeypatch, script):
    monkeypatch.setattr(
        videos, "_play", lambda run, seconds, video: [sys.executable, "-c", script, str(video)]
    )


def made(run):
    return sorted(path.name for path in (run / "videos").glob("*"))


def wait_for(found):
    end = time.monotonic() + 60.0
    while not found() and time.monotonic() < end:
        time.sleep(0.05)


def test_a_resumed_run_counts_on(run, monkeypatch):
    play(monkeypatch, WRITES)
    for count in (1, 2):
        with videos.made_on_the_way(run, 0.001, 10.0):
            wait_for(lambda count=count: len(made(run)) >= count)
    assert made(run)[:2] == ["0001.mp4", "0002.mp4"]


def test_a_run_shorter_than_the_interval_has_a_video_too(run, monkeypatch, capfd):
    play(monkeypatch, WRITES)
    with videos.made_on_the_way(run, 60.0, 10.0) as make_last:
        pass
    assert made(run) == []
    make_last()
    assert made(run) == ["0001.mp4"] and "Ctrl-C" in capfd.readouterr().out


def test_a_failure_is_told_whatever_else_is_printed(run, monkeypatch, capfd):
    play(monkeypatch, "import sys; sys.exit('x' * 300_000 + chr(10) + 'no room')")
    with videos.made_on_the_way(run, 60.0, 10.0) as make_last:
        pass
    make_last()
    assert capfd.readouterr().err.strip() == "warning: video_minutes: no video: no room"


def test_one_in_the_making_is_given_up_at_the_end(run, monkeypatch, capfd):
    play(monkeypatch, WRITES + "; import time; time.sleep(60)")
    start = time.monotonic()
    with videos.made_on_the_way(run, 0.001, 10.0):
        wait_for(lambda: made(run))
    assert time.monotonic() - start < 50.0 and capfd.readouterr().err == ""


def test_no_minutes_no_videos(run, monkeypatch):
    play(monkeypatch, WRITES)
    with videos.made_on_the_way(run, None, 10.0) as make_last:
        make_last()
    assert made(run) == []
