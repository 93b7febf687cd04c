"""Latency of exported policies, measured with few calls."""

from pathlib import Path

import pytest

from spin_rl.speed import deploy as deploy_speed

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture
def ticking():
    """A clock on which every call takes as long as the number of calls before it [ms]."""
    now = {"time": 0.0, "step": 0}

    def clock():
        now["time"] += 0.001 * (now["step"] // 2 % deploy_speed._LEAST)
        now["step"] += 1
        return now["time"]

    return clock


def test_rows_have_median_and_percentile_of_every_part(ticking, monkeypatch):
    monkeypatch.setattr(deploy_speed, "_LEAST", 200)
    files = [DATA / f"{name}.onnx" for name in ("tiny_nav", "tiny_pick", "tiny_room")]
    rows = deploy_speed.measure_deploy(files, 0.0, ticking)
    names = ["depth filter, 848 x 480"]
    parts = ("network", "whole tick")
    names += [f"{name}: {part}" for name in ("tiny_nav", "tiny_pick", "tiny_room") for part in parts]
    names.append("tiny_room: tick without pilot")
    assert [row.name for row in rows] == [n for name in names for n in (name, f"{name}, 99th percentile")]
    for median, slow in zip(rows[::2], rows[1::2], strict=True):
        assert median.unit == "ms" and median.value == pytest.approx(99.5)
        assert 196.0 < slow.value <= 199.0 and slow.spread == pytest.approx((0.0, 199.0))
