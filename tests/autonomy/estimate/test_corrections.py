"""Every sensor that corrects the pose: its rows are derivatives, and all climb one ladder."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.corrections import CORRECTIONS
from agribot.autonomy.estimate.filter.ekf import (
    GNSS_BIAS_X,
    GNSS_BIAS_Y,
    MAG_BIAS,
    ROW_BIAS,
    STATES,
    YAW,
    Ekf,
    X,
    Y,
)
from agribot.autonomy.estimate.filter.history import Epoch, Motion
from agribot.autonomy.estimate.filter.measurement import Measurement
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.correction import Ladder, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    BaseFix,
    FloatArray,
    GnssFix,
    GnssHeading,
    GnssQuality,
    GroundPlant,
    ImuSample,
    MagSample,
    PlantClass,
    RowLine,
    Scene,
    SensorBatch,
    WheelSample,
)
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.post_range import BatchWithPosts, PostRange, PostSight

FIELD = FieldConfig(
    first_row_start_map_m=(0.0, 0.0), row_yaw_deg=20.0, row_pitch_m=1.0, row_count=5,
    row_length_m=20.0, plant_spacing_m=0.25,
)  # fmt: skip
FRAME = MapFrame(FIELD.datum)
LAT, LON, ALT = FRAME.geodetic_from_map(5.0, 1.9, 0.6)
POST_MAP_M = (9.0, -3.0)
BASE = BaseFix(
    t_s=0.0, lat_deg=LAT, lon_deg=LON, alt_m=ALT, pos_std_m=1.0,
    known_lat_deg=LAT, known_lon_deg=LON, known_alt_m=ALT,
)  # fmt: skip
PLANT = GroundPlant(
    x_body_m=1.1, y_body_m=0.02, plant=PlantClass.CROP, area_m2=0.05, confidence=0.9, std_m=0.02
)

# A sample of each sensor, of any time.
SAMPLES: dict[str, Any] = {
    "mag": MagSample(t_s=0.0, field_t=(2.7e-5, -1.2e-5, -4e-5)),
    "base": BASE,
    "gnss": GnssFix(
        t_s=0.0, lat_deg=LAT, lon_deg=LON, alt_m=ALT, pos_std_m=0.02,
        quality=GnssQuality.RTK_FIXED, velocity_mps=(0.5, 0.2, 0.0), velocity_std_mps=0.05,
    ),
    "antenna heading": GnssHeading(t_s=0.0, yaw_map_rad=0.4, std_rad=0.01),
    "row line": RowLine(
        t_s=0.0, offset_m=0.05, heading_rad=0.03, offset_std_m=0.02, heading_std_rad=0.02,
        start_ahead_m=-5.0, end_ahead_m=15.0, at_ahead_m=0.8,
    ),
    "scene": Scene(
        t_s=0.0, ready_s=0.0, frame_index=0, plants=(PLANT,),
        view_body_m=((0.5, -0.5), (2.0, -1.0), (2.0, 1.0), (0.5, 0.5)),
    ),
    "plants": Scene(t_s=0.0, ready_s=0.0, frame_index=0, plants=(PLANT,), view_body_m=()),
    "post": PostSight(t_s=0.0, post_map_m=POST_MAP_M, range_m=6.0),
}  # fmt: skip
# Residuals of a sample: position and velocity of a fix, across and along the row of a plant; none
# of plants of an earlier run while there is no map of them.
RESIDUALS = {
    "mag": 1, "base": 0, "gnss": 4, "antenna heading": 1, "row line": 4, "scene": 2, "plants": 0,
    "post": 1,
}  # fmt: skip


@pytest.fixture(autouse=True)
def _a_further_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CORRECTIONS, "post", PostRange)


def test_every_sensor_has_a_sample_here() -> None:
    assert set(SAMPLES) == set(CORRECTIONS)


def at(name: str, t_s: float) -> Any:
    return msgspec.structs.replace(SAMPLES[name], t_s=t_s)


def pose_filter() -> PoseFilter:
    """A robot that knows where it is, on its third row."""
    ekf = Ekf([0.02] * STATES, math.radians(FIELD.row_yaw_deg))
    for state, value in (
        (X, 5.2), (Y, 1.85), (YAW, 0.36), (GNSS_BIAS_X, 0.01), (GNSS_BIAS_Y, -0.02),
        (MAG_BIAS, 0.03), (ROW_BIAS, 0.01),
    ):  # fmt: skip
        ekf.x[state] = value
    pose = PoseFilter(EstimateConfig(mag_learn=False), FIELD, robot((0.1, -0.05, 0.6)), ekf)
    pose.known |= {"yaw", "position"}
    return pose


def epoch(nudge_rad: float) -> Epoch:
    """The robot drove a bend since the capture; the way turns about its end with the heading."""
    now = Motion(1.1, 3.0, 1.0, 0.3, 0.5, 0.4)
    dx, dy = -0.30, -0.08
    cos, sin = math.cos(nudge_rad), math.sin(nudge_rad)
    then = Motion(0.9, now.x_m + cos * dx - sin * dy, now.y_m + sin * dx + cos * dy, 0.25, 0.5, 0.4)
    return Epoch(then, now, 0.2)


def accept_all(measurements: Measurements) -> list[Measurement]:
    """Everything that a sample measures; none of it moves the state."""
    found: list[Measurement] = []
    try:
        found.append(next(measurements))
        while True:
            found.append(measurements.send("accept"))
    except StopIteration:
        return found


def measured(name: str, nudge: FloatArray) -> list[Measurement]:
    """What the second sample of a sensor measures in a state that is off by `nudge` (STATES,)."""
    pose = pose_filter()
    correction = CORRECTIONS[name](pose)
    before = epoch(0.0)._replace(then=Motion(0.7, 2.0, 0.8, 0.2, 0.5, 0.4))
    accept_all(correction.measure(at(name, 0.7), before))
    pose.ekf.x = [value + float(by) for value, by in zip(pose.ekf.x, nudge, strict=True)]
    return accept_all(correction.measure(at(name, 0.9), epoch(float(nudge[YAW]))))


def residuals(name: str, nudge: FloatArray) -> FloatArray:
    return np.array([value for each in measured(name, nudge) for value in each.residuals])


@pytest.mark.parametrize("name", SAMPLES)
def test_the_rows_of_a_sensor_are_the_derivatives_of_what_it_expects(name: str) -> None:
    found = measured(name, np.zeros(STATES))
    rows = [row for each in found for row in each.rows]
    assert len(rows) == RESIDUALS[name]
    step = 1e-6
    for state in range(STATES):
        nudge = step * np.eye(STATES)[state]
        slopes = (residuals(name, nudge) - residuals(name, -nudge)) / (2.0 * step)
        by_row = [sum(weight for column, weight in row if column == state) for row in rows]
        np.testing.assert_allclose(-slopes, by_row, rtol=0.0, atol=1e-6, err_msg=f"state {state}")


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_that_is_late_or_older_than_the_odometry_is_refused_and_counted(
    name: str,
) -> None:
    pose = pose_filter()
    for t_s in (5.0, 5.1, 5.2):
        pose.history.append(Motion(t_s, 0.0, 0.0, 0.0, 0.0, 0.0))
    ladder = Ladder(name, CORRECTIONS[name](pose))
    ladder.update(at(name, math.nan))
    assert pose.rejected == {f"{name} not usable": 1}
    ladder.update(at(name, 1.0))
    assert pose.rejected[f"{name} without odometry"] == ladder.correction.needs_odometry
    ladder.update(at(name, 5.1))
    before = list(pose.ekf.x)
    ladder.update(at(name, 5.1))
    ladder.update(at(name, 5.05))
    assert pose.rejected[f"{name} out of order"] == 2
    assert pose.ekf.x == before


def test_a_sensor_that_needs_the_position_waits_for_it_without_a_word() -> None:
    pose = PoseFilter(EstimateConfig(), FIELD, robot())
    pose.history.append(Motion(5.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    Ladder("post", PostRange(pose)).update(at("post", 5.0))
    assert not pose.rejected


def drive(range_m: Callable[[float], float], seconds: float) -> Localizer:
    """Stand at (1, 2) with a receiver that is 1.5 m off to the East, and look at a post."""
    field = FieldConfig(start_map_m=(1.0, 2.0), start_yaw_deg=90.0, start_std_m=1.0)
    frame, into = MapFrame(field.datum), Localizer(EstimateConfig(), field, robot())
    lat, lon, alt = frame.geodetic_from_map(2.5, 2.0, 0.6)
    for k in range(round(seconds / 0.1)):
        t_s = 0.1 * k
        into.update(
            BatchWithPosts(
                t_s=t_s,
                wheels=(WheelSample(t_s=t_s, angle_rad=(0.0,) * 4, speed_radps=(0.0,) * 4),),
                imu=(ImuSample(t_s=t_s, gyro_radps=(0.0,) * 3, accel_mps2=(0.0, 0.0, 9.8)),),
                mag=(MagSample(t_s=t_s, field_t=(3e-5, 0.0, -4e-5)),),
                gnss=(
                    GnssFix(
                        t_s=t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=1.5,
                        quality=GnssQuality.SINGLE,
                    ),
                ),
                posts=(
                    PostSight(t_s=t_s, post_map_m=(-9.0, 2.0), range_m=range_m(t_s)),
                ),
            )
        )  # fmt: skip
    return into


def test_a_further_sensor_is_one_file_and_a_line_in_the_table() -> None:
    into = drive(lambda t_s: 10.0, 20.0)
    assert into.pose.ekf.x[X] == pytest.approx(1.0, abs=0.02)
    assert math.sqrt(into.pose.ekf.cov[X, X]) < 0.02
    assert not [cause for cause in into.rejected if cause.startswith("post")]


def test_one_outlier_of_a_further_sensor_is_kept_out_and_a_run_of_them_moves_the_robot() -> None:
    single = drive(lambda t_s: 14.0 if abs(t_s - 10.0) < 0.01 else 10.0, 20.0)
    assert single.rejected["post outlier"] == 1
    assert single.pose.ekf.x[X] == pytest.approx(1.0, abs=0.02)
    moved = drive(lambda t_s: 14.0 if t_s > 10.0 else 10.0, 20.0)
    assert (moved.rejected["post outlier"], moved.rejected["post found again"]) == (4, 1)
    assert moved.pose.ekf.x[X] == pytest.approx(5.0, abs=0.05)


def test_a_batch_without_the_further_sensor_is_no_matter() -> None:
    into = Localizer(EstimateConfig(), FIELD, robot())
    into.update(SensorBatch(t_s=0.0))
    assert not into.rejected
