"""The original's nodes: what they say of what they hear, without any network."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from agribot.autonomy.control.go_to_goal import GoToGoal, GoToGoalSettings
from agribot.autonomy.estimate.sensors.compass_heading import CompassHeading
from agribot.autonomy.estimate.sensors.pole_origin import PoleOrigin
from agribot.core import topics
from agribot.core.geo import Datum, MapFrame, compass_deg_from_yaw, wrap_rad
from agribot.core.messages import FloatArray, GnssFix, GnssQuality, ImuSample, MagSample
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.nodes.autonomous_drive import AutonomousDrive
from agribot.ros.nodes.autonomous_drive_action import ActionSettings, AutonomousDriveAction
from agribot.ros.nodes.data_manipulation import DataManipulation
from agribot.ros.nodes.gps_converter import GpsConverter
from agribot.ros.nodes.stage import OutgoingMessage

POLE = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)


def fix_at(
    frame: MapFrame,
    east_m: float,
    north_m: float,
    t_s: float,
    quality: GnssQuality = GnssQuality.SINGLE,
) -> object:
    lat, lon, alt = frame.geodetic_from_map(east_m, north_m)
    fix = GnssFix(t_s=t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=1.0, quality=quality)
    return rosmsg.make_fix(fix, "gps_link")


def value(said: list[OutgoingMessage], topic: Topic) -> float:
    (found,) = [float(m.data) for t, m in said if t is topic]
    return found


def positions(
    converter: GpsConverter, frame: MapFrame, drift_m: float
) -> list[tuple[float, float]]:
    """Of a robot standing at (3, 4) while pole and robot drift together after the origin."""
    found = []
    for index in range(400):
        t_s = 0.2 * index
        off_m = 0.0 if index < 30 else drift_m * math.sin((index - 30) / 60.0)
        converter.receive(topics.POLE_FIX, fix_at(frame, off_m, -off_m, t_s), t_s)
        said = converter.receive(topics.FIX, fix_at(frame, 3.0 + off_m, 4.0 - off_m, t_s), t_s)
        found += [(m.pose.position.x, m.pose.position.y) for t, m in said if t is topics.POSE]
    return found


@pytest.mark.parametrize("datum", [POLE, Datum(lat_deg=-45.0, lon_deg=179.99999)])
def test_a_drift_of_five_metres_that_the_pole_shares_leaves_less_than_ten_centimetres(
    datum: Datum,
) -> None:
    frame = MapFrame(datum)
    found = positions(GpsConverter(PoleOrigin(), waits_for_pole=True), frame, 5.0)
    assert len(found) >= 370
    off_m = np.hypot(*(np.array(found) - (3.0, 4.0)).T)
    assert off_m.max() < 0.1
    alone = GpsConverter(PoleOrigin(datum), waits_for_pole=False)
    said = alone.receive(topics.FIX, fix_at(frame, 8.0, -1.0, 0.0), 0.0)
    assert said[0].message.pose.position.x == pytest.approx(8.0, abs=1e-3)  # nothing to correct


def test_a_fixed_solution_is_left_alone_by_the_pole() -> None:
    frame = MapFrame(POLE)
    converter = GpsConverter(PoleOrigin(POLE), waits_for_pole=False)
    converter.receive(topics.POLE_FIX, fix_at(frame, 2.0, 0.0, 0.0), 0.0)
    (said,) = converter.receive(
        topics.FIX, fix_at(frame, 3.0, 4.0, 0.0, GnssQuality.RTK_FIXED), 0.0
    )
    assert said.message.pose.position.x == pytest.approx(3.0, abs=1e-3)
    (said,) = converter.receive(topics.FIX, fix_at(frame, 3.0, 4.0, 0.0), 0.0)
    assert said.message.pose.position.x == pytest.approx(1.0, abs=1e-3)


def test_a_correction_older_than_five_seconds_is_not_used() -> None:
    frame = MapFrame(POLE)
    converter = GpsConverter(PoleOrigin(POLE), waits_for_pole=False)
    converter.receive(topics.POLE_FIX, fix_at(frame, 2.0, 0.0, 0.0), 0.0)
    (late,) = converter.receive(topics.FIX, fix_at(frame, 3.0, 4.0, 5.5), 5.5)
    assert late.message.pose.position.x == pytest.approx(3.0, abs=1e-3)


def test_distance_and_bearing_are_right_in_eight_directions_in_both_hemispheres() -> None:
    for datum in (POLE, Datum(lat_deg=-60.0, lon_deg=-179.99999)):
        frame = MapFrame(datum)
        for k in range(8):
            angle = k * math.pi / 4.0
            converter = GpsConverter(PoleOrigin(datum), waits_for_pole=False)
            goal = fix_at(frame, 30.0 * math.cos(angle), 30.0 * math.sin(angle), 0.0)
            converter.receive(topics.GOAL_FIX, goal, 0.0)
            said = list(converter.receive(topics.FIX, fix_at(frame, 0.0, 0.0, 1.0), 1.0))
            assert value(said, topics.DISTANCE) == pytest.approx(30.0, abs=1e-3)
            off_rad = wrap_rad(math.radians(value(said, topics.BEARING)) - angle)
            assert abs(off_rad) < 1e-4


def test_fixes_that_are_none_say_nothing() -> None:
    converter = GpsConverter(PoleOrigin(POLE), waits_for_pole=False)
    frame = MapFrame(POLE)
    assert not converter.receive(topics.FIX, fix_at(frame, 0, 0, 0.0, GnssQuality.NONE), 0.0)
    broken = fix_at(frame, 0.0, 0.0, 0.0)
    broken.latitude = math.nan  # type: ignore[attr-defined]
    assert not converter.receive(topics.FIX, broken, 0.0)


def field_of(yaw_rad: float) -> tuple[float, float, float]:
    """Magnetic North is North; the body's x points along the yaw."""
    from_north = math.pi / 2.0 - yaw_rad
    return (4e-5 * math.cos(from_north), 4e-5 * math.sin(from_north), -2e-5)


def test_the_heading_error_is_bearing_minus_heading_for_eight_by_eight_directions() -> None:
    for heading in range(8):
        yaw_rad = wrap_rad(heading * math.pi / 4.0)
        node = DataManipulation(CompassHeading())
        for bearing in range(8):
            wanted_rad = wrap_rad(bearing * math.pi / 4.0 + 0.1)
            node.receive(
                topics.BEARING, rosmsg.make_float64(math.degrees(wanted_rad)), float(bearing)
            )
            mag = MagSample(t_s=float(bearing), field_t=field_of(yaw_rad))
            field = rosmsg.make_magnetic_field(mag, "mag_link")
            said = list(node.receive(topics.MAGNETIC, field, float(bearing)))
            error_rad = math.radians(value(said, topics.ANGLE))
            assert abs(wrap_rad(error_rad - (wanted_rad - yaw_rad))) < 1e-6
            compass = compass_deg_from_yaw(yaw_rad)
            assert math.remainder(value(said, topics.HEADING_RAW) - compass, 360.0) == (
                pytest.approx(0.0, abs=1e-6)
            )


def filtered_errors_rad(rate_radps: float, seed: int) -> FloatArray:
    """60 s of a 16 degree compass at 20 Hz and a biased gyro; 5 s standing, then the rate."""
    rng = np.random.default_rng(seed)
    heading, yaw_rad, errors = CompassHeading(), 1.0, []
    for index in range(12_000):
        t_s = 0.005 * index
        rate = rate_radps if t_s > 5.0 else 0.0
        yaw_rad += rate * 0.005
        heading.update_command(0.0, rate)
        gyro = rate + 0.008 + 0.002 * float(rng.standard_normal())
        up = (0.0, 0.0, 9.81)
        heading.update_imu(ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, gyro), accel_mps2=up))
        if index % 10 == 0:
            seen = wrap_rad(yaw_rad + math.radians(16.0) * float(rng.standard_normal()))
            yaws = heading.update_mag(MagSample(t_s=t_s, field_t=field_of(seen)))
            assert yaws is not None
            errors.append(wrap_rad(yaws[1] - yaw_rad))
    return np.array(errors)


def test_the_heading_of_the_node_is_steady_at_rest_and_does_not_lag_in_a_turn() -> None:
    still = np.concatenate([filtered_errors_rad(0.0, seed)[400:] for seed in range(3)])
    assert math.degrees(float(np.sqrt(np.mean(still**2)))) < 1.5
    turning = np.concatenate([filtered_errors_rad(0.5, seed)[400:] for seed in range(3)])
    assert math.degrees(float(np.abs(turning).max())) < 5.0


def test_tilt_does_not_turn_the_heading() -> None:
    heading = CompassHeading()
    tilt = math.radians(15.0)
    for index in range(4000):  # nose up: specific force leans forward
        accel = (9.81 * math.sin(tilt), 0.0, 9.81 * math.cos(tilt))
        heading.update_imu(ImuSample(t_s=0.005 * index, gyro_radps=(0.0,) * 3, accel_mps2=accel))
    x, y, z = field_of(0.7)
    tilted = (x * math.cos(tilt) + z * math.sin(tilt), y, -x * math.sin(tilt) + z * math.cos(tilt))
    yaws = heading.update_mag(MagSample(t_s=20.0, field_t=tilted))
    assert yaws is not None
    assert abs(wrap_rad(yaws[0] - 0.7)) < math.radians(1.0)


def test_the_drive_spins_then_creeps_then_goes_and_stops_when_an_input_falls_silent() -> None:
    go = GoToGoal(GoToGoalSettings())
    assert go.command(0.0).v_mps == 0.0
    for error_deg, v_mps in ((90.0, 0.0), (-20.0, 0.2), (2.0, 0.4)):
        go.update_distance(1.0, 10.0)
        go.update_error(1.0, math.radians(error_deg))
        drive = go.command(1.0)
        assert drive.v_mps == v_mps
        assert math.copysign(1.0, drive.yaw_rate_radps) == math.copysign(1.0, error_deg)
        assert abs(drive.yaw_rate_radps) <= 0.5
    assert go.command(2.5).v_mps == 0.0
    assert "no distance" in go.reason


def test_the_drive_stays_at_its_goal_and_leaves_for_the_next() -> None:
    go = GoToGoal(GoToGoalSettings())
    speeds = []
    for distance_m in (0.8, 0.49, 0.55, 0.65, math.nan, 5.0):
        go.update_distance(0.0, distance_m)
        go.update_error(0.0, 0.0)
        speeds.append(go.command(0.0).v_mps)
    assert speeds == [0.4, 0.0, 0.0, 0.0, 0.0, 0.4]


def test_a_drive_that_ends_stops_the_robot() -> None:
    ((topic, twist),) = AutonomousDrive(GoToGoal(GoToGoalSettings())).finish()
    assert topic is topics.CMD_VEL
    assert twist.linear.x == twist.angular.z == 0.0


def test_the_action_goes_from_goal_to_goal_and_says_how_far_it_is() -> None:
    action = AutonomousDriveAction([(1.0, 2.0), (3.0, 4.0)], ActionSettings())
    goals, states = [], []
    distance_m, t_s = 6.0, 0.0
    while not action.is_done:
        assert t_s < 200.0
        said = [
            *action.tick(t_s),
            *action.receive(topics.DISTANCE, rosmsg.make_float64(distance_m), t_s),
        ]
        for topic, message in said:
            if topic is topics.GOAL_FIX:
                goals.append((message.latitude, message.longitude))
                distance_m = 6.0
            else:
                states.append(json.loads(message.data))
        t_s += 0.1
        distance_m -= 0.04
    assert goals == [(1.0, 2.0), (3.0, 4.0)]
    assert action.ok
    assert states[-1]["state"] == "done"
    assert states[-1]["waypoints_reached"] == 2
    etas = [s["eta_s"] for s in states if s["eta_s"] is not None]
    assert etas
    assert all(0.0 < eta < 6.0 / 0.4 + 1.0 for eta in etas)


def test_an_action_whose_distance_falls_silent_fails_with_the_reason() -> None:
    action = AutonomousDriveAction([(1.0, 2.0)], ActionSettings())
    action.tick(0.0)
    action.receive(topics.DISTANCE, rosmsg.make_float64(5.0), 3.0)
    action.tick(20.0)
    assert action.is_done
    assert not action.ok
    assert "no /agribot/distance for 10 s" in action.reason
