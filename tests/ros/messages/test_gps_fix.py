"""A receiver's GPSFix has all it reported, for both ROS, and those of others are read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import GnssFix, GnssQuality, GnssStatus, Satellite, SensorBatch
from agribot.core.topics import Topic
from agribot.description.loader import load_robot
from agribot.ros.messages import gps_types, rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.sensor_readers import make_readers
from agribot.ros.messages.sensor_topics import SensorTopicWriter
from agribot.ros.ros1.types import generate_definition, list_outputs, load_ros1_types


def see(
    system: str, number: int, elevation_deg: float, azimuth_deg: float, snr_db: float, is_used: bool
) -> Satellite:
    return Satellite(
        system=system, number=number, elevation_deg=elevation_deg, azimuth_deg=azimuth_deg,
        snr_db=snr_db, is_used=is_used,
    )  # fmt: skip


FIX = GnssFix(
    t_s=12.5, lat_deg=52.15, lon_deg=4.51, alt_m=56.5, pos_std_m=0.02,
    quality=GnssQuality.RTK_FIXED, velocity_mps=(0.3, 0.4, -0.1), velocity_std_mps=0.05,
)  # fmt: skip
STATUS = GnssStatus(
    t_s=12.5, gdop=2.1, pdop=1.8, hdop=0.9, vdop=1.5, tdop=1.1,
    satellites=(
        see("GP", 5, 71.0, 210.0, 44.0, True),
        see("GL", 78, 15.0, 33.0, 0.0, False),
    ),
)  # fmt: skip


def make(fix: GnssFix = FIX, status: GnssStatus = STATUS) -> Any:
    return rosmsg.make_extended_fix(fix, status, "gps")


def test_it_tells_motion_dilutions_and_errors_at_95_percent() -> None:
    message = make()
    assert message.speed == pytest.approx(0.5) and message.climb == -0.1
    assert message.track == pytest.approx(math.degrees(math.atan2(0.3, 0.4)))
    dilutions = (message.gdop, message.pdop, message.hdop, message.vdop, message.tdop)
    assert dilutions == (2.1, 1.8, 0.9, 1.5, 1.1)
    assert message.err_horz == pytest.approx(2.0 * math.sqrt(2.0) * 0.02)
    assert message.err_speed == pytest.approx(0.1)
    covariance = np.reshape(message.position_covariance, (3, 3))
    assert covariance[0, 0] == pytest.approx(0.02**2)  # square metres
    assert (message.status.satellites_used, message.status.satellites_visible) == (1, 2)
    assert list(message.status.satellite_used_prn) == [5]
    assert list(message.status.satellite_visible_azimuth) == [210, 33]


@given(
    st.sampled_from([q for q in GnssQuality if q is not GnssQuality.NONE]),
    st.floats(-89, 89), st.floats(-179, 179), st.floats(0.001, 50), st.floats(-5, 5),
)  # fmt: skip
def test_it_survives_the_bytes_of_ros_2(
    quality: GnssQuality, lat_deg: float, lon_deg: float, std_m: float, east_mps: float
) -> None:
    fix = GnssFix(
        t_s=1.0, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=10.0, pos_std_m=std_m, quality=quality,
        velocity_mps=(east_mps, 0.5, 0.0), velocity_std_mps=0.1,
    )  # fmt: skip
    data = rosmsg.to_cdr(make(fix))
    message = rosmsg.load_types().deserialize_cdr(data, gps_types.GPSFIX_ROS2)
    back = gps_types.read_gps_fix(message, 1.0)
    if (lat_deg, lon_deg) == (0.0, 0.0):
        assert back is None, "which is said by who knows no place"
        return
    assert back is not None and back.quality is quality
    assert (back.lat_deg, back.lon_deg) == (lat_deg, lon_deg)
    assert back.pos_std_m == pytest.approx(std_m)
    assert back.velocity_mps == pytest.approx((east_mps, 0.5, 0.0), abs=1e-9)


def test_ros_1_gets_the_original_type_with_a_state_that_it_knows() -> None:
    names = {out.name: out for out in list_outputs(topics.EXTENDED_FIX)}
    assert set(names) == {"/agribot/extended_fix", "/extended_fix"}
    data = rosmsg.to_cdr(make())
    for out in names.values():
        assert out.ros_type == gps_types.GPSFIX_ROS1
        message: Any = load_ros1_types().deserialize_ros1(out.convert(data), out.ros_type)
        assert message.status.status == 2 and message.latitude == FIX.lat_deg
        back = gps_types.read_gps_fix(message, 12.5)
        assert back is not None and back.quality is GnssQuality.RTK_FIXED  # by its accuracy
    assert "satellite_visible_snr" in generate_definition(gps_types.GPSFIX_ROS1)[0]


def test_it_is_published_with_each_fix_once_the_receiver_told_its_state() -> None:
    sent: list[str] = []

    def write(topic: Topic, log_ns: int, data: bytes, publish_ns: int, /) -> None:
        sent.append(topic.name)

    robot = load_robot()
    writer = SensorTopicWriter(write, robot, CameraLog(robot, 0.0, 80))
    writer(0, SensorBatch(t_s=0.0, gnss=(FIX,)))
    assert topics.EXTENDED_FIX.name not in sent and topics.FIX.name in sent
    writer(1, SensorBatch(t_s=1.0, gnss=(FIX,), gnss_status=(STATUS,)))
    writer(2, SensorBatch(t_s=2.0, gnss=(FIX,)))
    assert sent.count(topics.EXTENDED_FIX.name) == 2
    assert {gps_types.GPSFIX_ROS1, gps_types.GPSFIX_ROS2} < set(make_readers("gnss", robot))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"latitude": 91.0}, "no place on Earth"),
        ({"altitude": math.inf}, "no place on Earth"),
        ({"position_covariance": np.full(9, 1e9)}, "variance of 1e"),
    ],
)
def test_a_gps_fix_that_is_none_is_refused(changes: dict[str, Any], why: str) -> None:
    message = make()
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(BridgeError, match=why):
        gps_types.read_gps_fix(message, 0.0)


def test_a_receiver_without_a_fix_gives_none() -> None:
    message = make()
    message.status.status = -1
    assert gps_types.read_gps_fix(message, 0.0) is None
