"""Turning on the spot shows the robot's iron and where its antenna sits."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.calibration.drive_log import DriveLog
from agribot.app.calibration.figure import TURNS, DriveSamples, drive_figure
from agribot.app.calibration.sensors import calibrate_antenna, calibrate_magnetometer
from agribot.app.simulated_run import simulate
from agribot.autonomy.estimate.sensors.compass import yaw_of
from agribot.autonomy.estimate.sensors.mag_fit import Level, MagCalibration
from agribot.cli import main as cli
from agribot.core.config import PerceptionConfig, RunConfig, SimConfig, load
from agribot.core.fact_text import render
from agribot.core.facts import CameraUnproven, FewTurnFixes, NoMagnetometer
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.record import run_files
from agribot.sim.platform import SimPlatform
from tests import nightly
from tests.finding import refused


def turned(rover: RobotSpec, world: WorldSpec, sensors: str, seed: int) -> DriveSamples:
    config = RunConfig(
        seed=seed, perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors=sensors)
    )
    return drive_figure(SimPlatform(config, rover, world), rover.drive, figure=TURNS)


def scatter_rad(driven: DriveSamples, calibration: MagCalibration) -> float:
    """Of the compass against the gyro over all readings, without what is common to all."""
    log = DriveLog(driven.batches, driven.stretches)
    errors: list[float] = []
    for batch in driven.batches:
        for sample in batch.mag:
            level: Level = calibration.correct(sample.field_t[:2])
            turned_rad = log.turned_rad(driven.stretches[0].start_s, sample.t_s)
            errors.append(yaw_of(level, 0.0) - turned_rad)
    unit: FloatArray = np.exp(1j * np.array(errors))
    around = np.angle(unit / np.mean(unit))
    return float(np.sqrt(np.mean(around**2)))


@nightly.all_or_first("seeds", range(4), in_suite=2)
def test_the_iron_of_robots_is_found_and_taken_off(
    rover: RobotSpec, meadow: WorldSpec, seeds: Sequence[int]
) -> None:
    before, after = [], []
    for seed in seeds:
        driven = turned(rover, meadow, "m8n", seed)
        result = calibrate_magnetometer(driven, 0.0)
        assert result.ok, result.reasons
        assert result.fit.sectors == 36
        before.append(scatter_rad(driven, MagCalibration()))
        after.append(scatter_rad(driven, result.fit.calibration))
    assert all(late < early for early, late in zip(before, after, strict=True))
    assert np.mean(after) < 0.75 * np.mean(before)  # the noise and the motors' field remain


@nightly.all_or_first("seeds", range(3), in_suite=1)
def test_the_antenna_is_found_where_it_was_mounted(
    rover: RobotSpec, meadow: WorldSpec, seeds: Sequence[int]
) -> None:
    for seed in seeds:
        driven = turned(rover, meadow, "rtk", seed)
        for one in (driven, without_altitudes(driven)):
            result = calibrate_antenna(one, rover)
            assert result.ok, result.reasons
            assert (result.fit.x_m, result.fit.y_m) == pytest.approx(
                (result.described_x_m, result.described_y_m), abs=0.01
            )


def without_altitudes(driven: DriveSamples) -> DriveSamples:
    """A drive with a receiver that reports no altitudes."""
    flat = [
        msgspec.structs.replace(
            batch, gnss=tuple(msgspec.structs.replace(fix, alt_m=math.nan) for fix in batch.gnss)
        )
        for batch in driven.batches
    ]
    return driven._replace(batches=flat)


def test_without_corrections_or_turns_it_says_what_is_missing(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    driven = turned(rover, meadow, "m8n", 0)
    assert "receiver with corrections" in calibrate_antenna(driven, rover).reasons[0]
    legs = [stretch for stretch in driven.stretches if stretch.is_leg]
    with refused(FewTurnFixes):
        calibrate_antenna(driven._replace(stretches=legs), rover)
    still = [msgspec.structs.replace(batch, mag=()) for batch in driven.batches]
    with refused(NoMagnetometer):
        calibrate_magnetometer(driven._replace(batches=still), 0.0)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs end without report.html and map.png, which cost more than a short drive."""
    for write in ("write_page", "write_map"):
        monkeypatch.setattr(run_files, write, lambda *_: None)


@nightly.by_day(
    "test_the_iron_of_robots_is_found_and_taken_off",
    "test_the_antenna_is_found_where_it_was_mounted",
    "test_a_drive_without_pictures_shows_nothing_of_the_camera",
)
@pytest.mark.usefixtures("undrawn")
def test_the_recording_of_a_mission_serves_as_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load("farm", ["perception.enabled=false", "duration_s=48", 'sim.sensors="rtk"'])
    with simulate(config, tmp_path) as session:
        for _ in session.ticks():
            pass
        session.finish()
    recording = str(tmp_path / "run.mcap")
    code = cli.main(["calibrate", "magnetometer", "--recording", recording, "--json"])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert code == (0 if result["ok"] else 1)
    assert result["fit"]["field_t"] == pytest.approx(3.8e-5, rel=0.15)
    assert result["settings"][0].startswith("estimate.mag_offset_t=[")


@pytest.mark.usefixtures("undrawn")
def test_a_drive_without_pictures_shows_nothing_of_the_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load("farm", ["perception.enabled=false", "duration_s=3", 'sim.sensors="rtk"'])
    with simulate(config, tmp_path) as session:
        for _ in session.ticks():
            pass
        session.finish()
    unproven, _, _ = render(CameraUnproven(pictures=0, poses=7)).partition("7")
    for subject in ("camera", "row-view"):
        code = cli.main(["calibrate", subject, "--recording", str(tmp_path / "run.mcap")])
        assert code == 2
        assert unproven in capsys.readouterr().err
