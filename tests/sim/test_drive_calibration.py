"""The calibration drive finds the geometry of the machine that was really driven."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot import description
from agribot.app.calibration import figure
from agribot.app.calibration.drive_fit import fit_drive
from agribot.app.calibration.drive_log import Stretch
from agribot.app.calibration.figure import FIGURE, DriveSamples, drive_figure, measure_gain
from agribot.cli import main as cli
from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import PlatformError
from agribot.core.facts import DriveUndetermined
from agribot.core.messages import DriveCommand, Inbox, RobotCommand, SensorBatch, WheelSample
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.platform import SimPlatform
from tests import nightly
from tests.finding import refused

RADIUS_M, SEPARATION_M = 0.09, 1.106
# Soil carries a quarter of the weight on 1e4 N/m: the tyre rolls on a radius 1.25 mm smaller.
ROLLING_RADIUS_M = RADIUS_M - 5.112 * 9.8 / 4 / 1e4


def _drive(
    rover: RobotSpec, world: WorldSpec, sensors: str, seed: int, board: DriveSpec | None = None
) -> DriveSamples:
    config = RunConfig(
        seed=seed, perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors=sensors)
    )
    platform = SimPlatform(config, rover, world, board=board)
    return drive_figure(platform, board or rover.drive)


@pytest.fixture(scope="module")
def driven(rover: RobotSpec, meadow: WorldSpec) -> DriveSamples:
    return _drive(rover, meadow, "ideal", 0)


@nightly.all_or_first("seeds", range(6), in_suite=1)
def test_fit_recovers_the_machine_over_seeds(
    rover: RobotSpec, meadow: WorldSpec, seeds: Sequence[int]
) -> None:
    in_sigma = []
    for seed in seeds:
        drive = _drive(rover, meadow, "rtk", seed)
        fit = fit_drive(drive.batches, drive.stretches)
        assert fit.wheel_radius_m == pytest.approx(RADIUS_M, rel=0.035)
        assert fit.separation_m == pytest.approx(SEPARATION_M, rel=0.035)
        assert fit.complaints() == ()
        in_sigma.append((fit.wheel_radius_m - ROLLING_RADIUS_M) / fit.wheel_radius_std_m)
    assert np.abs(in_sigma).max() < 3.5


@nightly.by_day(
    "test_fit_recovers_the_machine_over_seeds",
    "test_command_says_how_wrong_the_description_is",
)
def test_fit_does_not_believe_a_wrong_description(rover: RobotSpec, meadow: WorldSpec) -> None:
    wrong = msgspec.structs.replace(rover.drive, wheel_radius_m=0.1, yaw_multiplier=1.0)
    drive = _drive(rover, meadow, "rtk", 3, board=wrong)
    fit = fit_drive(drive.batches, drive.stretches)
    assert fit.wheel_radius_m == pytest.approx(RADIUS_M, rel=0.035)
    assert fit.separation_m == pytest.approx(SEPARATION_M, rel=0.035)
    reached = measure_gain(drive, fit)
    assert reached.speed == pytest.approx(ROLLING_RADIUS_M / 0.1, rel=0.01)
    assert reached.yaw_rate == pytest.approx(0.09 / 0.1 * 0.7816 / SEPARATION_M, rel=0.04)


def test_fit_finds_the_scale_of_the_gyro(driven: DriveSamples) -> None:
    def scaled(batch: SensorBatch) -> SensorBatch:
        imu = tuple(
            msgspec.structs.replace(
                sample, gyro_radps=(0.0, 0.0, 1.008 * sample.gyro_radps[2] + 0.002)
            )
            for sample in batch.imu
        )
        return msgspec.structs.replace(batch, imu=imu)

    true = fit_drive(driven.batches, driven.stretches)
    fit = fit_drive([scaled(batch) for batch in driven.batches], driven.stretches)
    assert true.gyro_scale == pytest.approx(1.0, abs=2e-4)
    assert fit.gyro_scale == pytest.approx(1.0 / 1.008, abs=3e-4)
    assert fit.separation_m == pytest.approx(true.separation_m, rel=1e-3)


def test_a_tape_replaces_gnss(driven: DriveSamples) -> None:
    batches = [msgspec.structs.replace(batch, gnss=()) for batch in driven.batches]
    fit = fit_drive(driven.batches, driven.stretches)
    legs = {
        stretch.name: fit.wheel_radius_m * abs(_rolled(driven.batches, stretch))
        for stretch in driven.stretches
        if stretch.is_leg
    }
    taped = [
        msgspec.structs.replace(stretch, distance_m=legs.get(stretch.name))
        for stretch in driven.stretches
    ]
    by_tape = fit_drive(batches, taped)
    assert by_tape.wheel_radius_m == pytest.approx(fit.wheel_radius_m, rel=0.002)
    assert by_tape.complaints() == ()
    with refused(DriveUndetermined):
        fit_drive(batches, driven.stretches)


def _rolled(batches: list[SensorBatch], stretch: Stretch) -> float:
    wheels = [sample for batch in batches for sample in batch.wheels]
    inside = [sample for sample in wheels if stretch.start_s <= sample.t_s <= stretch.at_rest_s]
    return float(np.mean(np.subtract(inside[-1].angle_rad, inside[0].angle_rad)))


def test_a_dead_encoder_makes_the_fit_bad(driven: DriveSamples) -> None:
    def dead(sample: WheelSample) -> WheelSample:
        return msgspec.structs.replace(sample, angle_rad=(0.0, *sample.angle_rad[1:]))

    batches = [
        msgspec.structs.replace(batch, wheels=tuple(dead(w) for w in batch.wheels))
        for batch in driven.batches
    ]
    (complaint, *_) = fit_drive(batches, driven.stretches).complaints()
    assert "rear right" in complaint and "encoder" in complaint


def test_legs_that_contradict_each_other_make_the_fit_bad(driven: DriveSamples) -> None:
    stretches = [
        msgspec.structs.replace(s, distance_m=4.4 if "ahead" in s.name else 3.6) if s.is_leg else s
        for s in driven.stretches
    ]
    assert any(
        "leg" in complaint for complaint in fit_drive(driven.batches, stretches).complaints()
    )


def coarsen(batch: SensorBatch) -> SensorBatch:
    fixes = tuple(
        msgspec.structs.replace(fix, pos_std_m=5.0, velocity_mps=None) for fix in batch.gnss
    )
    return msgspec.structs.replace(batch, gnss=fixes)


def test_coarse_gnss_is_not_passed_off_as_a_measurement(driven: DriveSamples) -> None:
    fit = fit_drive([coarsen(batch) for batch in driven.batches], driven.stretches)
    assert any("wheel radius is known to" in complaint for complaint in fit.complaints())


def test_a_machine_that_does_not_move_ends_the_drive() -> None:
    class Stuck:
        def __init__(self) -> None:
            self.t_s = 0.0
            self.inbox = Inbox()
            self.last = RobotCommand(t_s=0.0, drive=DriveCommand(v_mps=1.0))

        def read(self) -> SensorBatch:
            self.t_s += 0.02
            wheels = WheelSample(t_s=self.t_s, angle_rad=(0.0,) * 4, speed_radps=(0.0,) * 4)
            return SensorBatch(t_s=self.t_s, wheels=(wheels,))

        def write(self, command: RobotCommand) -> None:
            self.last = command

        def close(self) -> None:
            pass

    platform = Stuck()
    drive = msgspec.convert(
        {field: 1.0 for field in DriveSpec.__struct_fields__} | {"encoder_ticks_per_rev": 1},
        DriveSpec,
        strict=False,
    )
    with pytest.raises(PlatformError, match="leg 1"):
        drive_figure(platform, drive)
    assert platform.last.drive == DriveCommand()
    assert platform.t_s < 60.0


def test_figure_comes_home(driven: DriveSamples) -> None:
    turned = sum(m.travel * np.sign(m.yaw_rate_radps) for m in FIGURE if not m.is_leg)
    along = sum(m.travel * np.sign(m.v_mps) for m in FIGURE if m.is_leg)
    assert turned == pytest.approx(0.0)
    fixes = [fix for batch in driven.batches for fix in batch.gnss]
    north_m = (fixes[-1].lat_deg - fixes[0].lat_deg) * 110_700.0
    east_m = (fixes[-1].lon_deg - fixes[0].lon_deg) * 103_860.0
    assert math.hypot(east_m - along, north_m) < 1.5


def test_command_says_how_wrong_the_description_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "urdf"
    shutil.copytree(Path(description.__file__).parent / "urdf", folder)
    body = folder / "agribot_body.urdf.xacro"
    body.write_text(
        body.read_text().replace('"wheel_radius" value="0.09"', '"wheel_radius" value="0.1"')
    )
    wrong = str(folder / "agribot_sensors.urdf.xacro")
    status = cli.main(["calibrate", "drive", "--robot", wrong, "--machine", "agribot", "--json"])
    out, err = capsys.readouterr()
    result = json.loads(out.splitlines()[-1])
    assert status == 0 and result["ok"]
    assert result["fit"]["wheel_radius_m"] == pytest.approx(RADIUS_M, rel=0.035)
    assert result["wheel_radius_off_ratio"] == pytest.approx(-0.11, abs=0.02)
    assert '<xacro:property name="wheel_radius" value="0.088' in err


def test_command_exits_with_one_where_the_sensors_are_too_coarse(
    driven: DriveSamples, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a drive whose fixes are coarse."""
    coarse = driven._replace(batches=[coarsen(batch) for batch in driven.batches])
    monkeypatch.setattr(figure, "drive_figure", lambda *_: coarse)
    assert cli.main(["calibrate", "drive"]) == 1
    assert "do not use it" in capsys.readouterr().err
