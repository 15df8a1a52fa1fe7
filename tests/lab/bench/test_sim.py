from __future__ import annotations

from functools import partial

import pytest

from agribot.lab.bench import sim
from agribot.lab.bench.dense_field import CAMERA_RATE_HZ, CameraLoop, dense_field
from agribot.lab.bench.sim import FIGURES, measure


def test_only_the_wanted_figures_are_measured_and_each_is_told() -> None:
    lines: list[str] = []
    result = measure(["network_ms", "physics_rtf"], lines.append)
    assert result["network_ms"] > 0.0
    assert result["physics_rtf"] > 1.0  # real time at least, or no robot could be simulated
    assert "mission_rtf_cpu" not in result
    assert [line.startswith(FIGURES[name].title) for name, line in zip(
        ("network_ms", "physics_rtf"), lines, strict=True
    )] == [True, True]  # fmt: skip


def test_missions_are_told_as_a_share_of_physics_alone_in_the_same_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    speeds = {"physics_rtf": 200.0, "mission_rtf_cpu.camera": 1.0}
    speeds |= {"mission_rtf_cpu.no_camera_recorded": 12.0, "mission_rtf_cpu.no_camera": 14.0}
    monkeypatch.setattr(sim, "FIGURES", {
        name: FIGURES[name]._replace(measure=partial(speeds.__getitem__, name)) for name in speeds
    })  # fmt: skip
    lines: list[str] = []
    result = measure([name for name in speeds if name != "physics_rtf"], lines.append)
    assert result["physics_rtf"] == 200.0
    assert result["mission_rtf_cpu"] == {
        "camera": 1.0, "no_camera_recorded": 12.0, "no_camera": 14.0
    }  # fmt: skip
    assert [line[-23:] for line in lines[1:]] == [
        " 0.5 % of physics alone", " 6.0 % of physics alone", " 7.0 % of physics alone"
    ]  # fmt: skip


def test_the_camera_is_timed_over_more_than_ten_thousand_plants_at_its_full_rate() -> None:
    assert len(dense_field().plants) == 10_816
    loop = CameraLoop()
    loop.advance(0.4)
    assert loop.frames == pytest.approx(0.4 * CAMERA_RATE_HZ, abs=1)
