"""The log of a real rover: a Husky outdoors whose fixes wander by 2 m while they state one."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.localization.log import LogEntry, RobotLog, TwistSample
from agribot.app.localization.study import Study, StudyOptions, open_study, run_study
from agribot.app.localization.time_order import RestampedLog
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray, GnssFix, ImuSample
from agribot.record.localization.result import LocalizationResult
from tests import nightly
from tests.app.localization.drives import rotation_deg

HUSKY = Path(os.environ.get("AGRIBOT_DATA", "")) / "husky-log" / "husky.bag"
pytestmark = pytest.mark.skipif(
    not HUSKY.is_file(), reason="AGRIBOT_DATA holds no husky-log/husky.bag"
)
OUTAGES = [(180.0, 240.0), (60.0, 120.0), (240.0, 300.0)]
Alter = Callable[[LogEntry], LogEntry]


class AlteredLog(RestampedLog):
    """The log as another robot would have written it."""

    def __init__(self, log: RobotLog, alter: Alter) -> None:
        super().__init__(log)
        self._alter = alter

    def entries(self) -> Iterator[LogEntry]:
        return map(self._alter, self._log.entries())


@pytest.fixture(scope="module")
def study() -> Study:
    return open_study([HUSKY], StudyOptions())


def localize(study: Study, outage: tuple[float, float]) -> LocalizationResult:
    options = msgspec.structs.replace(study.options, outages=(outage,))
    return run_study(msgspec.structs.replace(study, options=options))[0].result


def test_the_log_is_scanned_as_it_was_mounted(study: Study) -> None:
    """A test of robot_localization states roll 90 and yaw -90 degrees for its IMU."""
    assert study.mount.body_from_imu == pytest.approx(rotation_deg(90.0, 0.0, -90.0), abs=1e-9)
    assert study.mount.turn_gain == pytest.approx(1.02, abs=0.02)
    assert {each.sensor: each.measurements for each in study.facts.sources} == {
        "gnss": 989, "imu": 11865, "odom": 3952,
    }  # fmt: skip
    assert study.scan.way_ratio == pytest.approx(1.03, abs=0.02)
    assert study.robot.mag is None


@nightly.one_by_one("outage", OUTAGES, in_suite=1)
def test_the_pose_is_known_soon_and_states_what_it_is_worth(
    study: Study, outage: tuple[float, float]
) -> None:
    result = localize(study, outage)
    assert result.started_after_s is not None and result.started_after_s < 15.0
    assert result.started_after_m is not None and result.started_after_m < 10.0
    assert result.rms_to_fixes_m is not None and result.rms_to_fixes_m < 2.5
    assert result.within_3_sigma_ratio is not None and result.within_3_sigma_ratio > 0.95
    (withheld,) = result.outages
    assert withheld.error_m is not None and withheld.sigma_m is not None
    assert withheld.error_m < 3.0 * withheld.sigma_m
    assert withheld.sigma_m < 0.25 * (withheld.driven_m or 0.0)


@nightly.by_day("test_the_pose_is_known_soon_and_states_what_it_is_worth")
def test_it_is_never_far_off_the_fixes(study: Study) -> None:
    run = run_study(study)[0]
    after = run.fixes[run.fixes[:, 0] > 60.0]
    assert float(np.max(after[:, 4])) < 8.0
    assert run.result.rms_to_fixes_m is not None and run.result.rms_to_fixes_m < 2.5


def scale_wheels(ratio: float) -> Alter:
    def alter(entry: LogEntry) -> LogEntry:
        sample = entry.sample
        if not isinstance(sample, TwistSample):
            return entry
        return entry._replace(sample=msgspec.structs.replace(sample, v_mps=ratio * sample.v_mps))

    return alter


def displace_fixes(share: float, by_m: float) -> Alter:
    """Put a share of the fixes elsewhere, each in a direction of its own."""
    rng = np.random.default_rng(1)
    frame = MapFrame(Datum(lat_deg=0.0, lon_deg=0.0, alt_m=0.0))

    def alter(entry: LogEntry) -> LogEntry:
        fix = entry.sample
        if not isinstance(fix, GnssFix) or rng.random() >= share:
            return entry
        north_deg, east_deg, _ = frame.geodetic_from_map(*by_m * unit(rng.uniform(0.0, math.tau)))
        moved = msgspec.structs.replace(
            fix, lat_deg=fix.lat_deg + north_deg,
            lon_deg=fix.lon_deg + east_deg / math.cos(math.radians(fix.lat_deg)),
        )  # fmt: skip
        return entry._replace(sample=moved)

    return alter


def unit(angle_rad: float) -> FloatArray:
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])


def permute_axes(entry: LogEntry) -> LogEntry:
    """Mount the IMU with its axes turned round once more: x to y, y to z, z to x."""
    imu = entry.sample
    if not isinstance(imu, ImuSample) or imu.accel_mps2 is None:
        return entry
    (ax, ay, az), (gx, gy, gz) = imu.accel_mps2, imu.gyro_radps
    turned = msgspec.structs.replace(imu, accel_mps2=(az, ax, ay), gyro_radps=(gz, gx, gy))
    return entry._replace(sample=turned)


ALTERED = {
    "a tenth of the fixes 30 m away": displace_fixes(0.1, 30.0),
    "wheels of 0.9": scale_wheels(0.9),
    "wheels of 1.1": scale_wheels(1.1),
}


@nightly.by_day("test_the_pose_is_known_soon_and_states_what_it_is_worth")
@pytest.mark.parametrize("name", ALTERED)
def test_it_is_as_good_as_another_robot_would_have_written_it(
    study: Study, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = AlteredLog(study.log, ALTERED[name])
    monkeypatch.setattr("agribot.app.localization.study.open_log", lambda *args: opened)
    result = run_study(open_study([HUSKY], StudyOptions()))[0].result
    assert result.started_after_m is not None and result.started_after_m < 11.0
    assert result.rms_to_fixes_m is not None and result.within_3_sigma_ratio is not None
    displaced = result.fixes / 10 if "30 m" in name else 0.0
    assert result.used > result.fixes - 60 - 1.3 * displaced
    assert result.within_3_sigma_ratio > 0.95 - 1.3 * displaced / result.fixes
    if not displaced:  # these distances count, too
        as_logged_m = run_study(study)[0].result.rms_to_fixes_m
        assert result.rms_to_fixes_m == pytest.approx(as_logged_m, rel=0.1)


def test_axes_of_the_imu_in_another_order_are_found(
    study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = AlteredLog(study.log, permute_axes)
    monkeypatch.setattr("agribot.app.localization.study.open_log", lambda *args: opened)
    found = open_study([HUSKY], StudyOptions())
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    expected = study.mount.body_from_imu @ turn
    assert found.mount.body_from_imu == pytest.approx(expected, abs=1e-9)
