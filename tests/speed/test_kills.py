"""A short form of `python -m spin_rl.speed.kills`."""

import os

import pytest

from spin_rl.runners import checkpoint
from spin_rl.speed import kills

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")


def test_kills_lose_nothing(tmp_path):
    found = kills.kill_often(tmp_path, 25, seed=1)
    assert found.kills == 25 and found.lost == []


def test_a_writer_that_replaces_in_place_is_found_out(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "write_atomically", lambda path, write: write_in_place(path, write))
    assert kills.kill_often(tmp_path, 40, seed=1).lost


def write_in_place(path, write):
    path.parent.mkdir(exist_ok=True)
    with open(path, "wb") as file:
        write(file)
