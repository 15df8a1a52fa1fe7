"""What `agribot calibrate magnetometer` says on a robot without a magnetometer."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from agribot.app.calibration import sensors
from agribot.cli.main import main
from agribot.core.config import RunConfig
from agribot.core.facts import NoMagnetometer
from agribot.core.messages import SensorBatch
from agribot.description import loader
from tests.finding import refused


def test_a_robot_without_a_magnetometer_is_not_driven_for_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = msgspec.structs.replace(loader.load_robot("agribot"), mag=None)
    monkeypatch.setattr(loader, "load_robot", lambda _: bare)
    assert main(["calibrate", "magnetometer"]) == 2
    assert (
        "agribot: its description has no magnetometer, so that there is nothing to calibrate; its "
        "heading follows from the first metres driven" in capsys.readouterr().err
    )


def test_a_recording_without_a_reading_names_the_magnetometer_and_not_the_circle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    estimate = SimpleNamespace(ok=True, yaw_map_rad=0.0)
    tick = SimpleNamespace(batch=SensorBatch(t_s=0.1), estimate=estimate)
    monkeypatch.setattr(sensors, "read_config", lambda _: RunConfig())
    monkeypatch.setattr(sensors, "read_ticks", lambda _: [tick])
    with refused(NoMagnetometer):
        sensors.calibrate_recorded_magnetometer(Path("run.mcap"))
