"""NavSatFix and GPSFix, each as the other, as fix_translator of gps_umd does it.

Values that the other type has no place for are lost; what it wants and the first does not know
stays zero. The rules: status -1..2 are the same, DGPS (18) is ground based and WAAS (33)
satellite based augmentation; the services GPS, GLONASS and Galileo are position source GPS,
Compass is the source MAGNETIC. Errors of a GPSFix are at 95 %.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from agribot.ros.messages.gps_types import GPSFIX_ROS1, GPSFIX_ROS2

NAVSATFIX = "sensor_msgs/msg/NavSatFix"
GPSFIXES = (GPSFIX_ROS1, GPSFIX_ROS2)

_NO_FIX, _DGPS, _WAAS = -1, 18, 33
_RTK_FIX, _RTK_FLOAT = 19, 20  # ROS 2 only
_SBAS, _GBAS = 1, 2
_SERVICE_GPS, _SERVICE_COMPASS = 1, 4
_SERVICES_OF_SOURCE_GPS = 1 | 2 | 8
_SOURCE_GPS, _SOURCE_MAGNETIC = 1, 16
_NAVSAT_STATUS = {_DGPS: _GBAS, _WAAS: _SBAS, _RTK_FIX: _GBAS, _RTK_FLOAT: _GBAS}


def gpsfix_type(is_ros2: bool) -> str:
    return GPSFIX_ROS2 if is_ros2 else GPSFIX_ROS1


def make_header(store: Typestore, stamp: Any, frame_id: str) -> Any:
    """Make a std_msgs/Header of either ROS version."""
    time = store.types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
    kind = store.types["std_msgs/msg/Header"]
    has_seq = store.fielddefs["std_msgs/msg/Header"][1][0][0] == "seq"
    return kind(0, time, frame_id) if has_seq else kind(time, frame_id)


def gpsfix_from_navsatfix(fix: Any, store: Typestore, is_ros2: bool) -> Any:
    """Make the GPSFix of `store` for a NavSatFix of any store."""
    ros_type = gpsfix_type(is_ros2)
    stamp, frame = fix.header.stamp, fix.header.frame_id
    source = _SOURCE_GPS if fix.status.service & _SERVICES_OF_SOURCE_GPS else 0
    if fix.status.service & _SERVICE_COMPASS:
        source |= _SOURCE_MAGNETIC
    nothing = np.zeros(0, dtype=np.int32)
    status = store.types[ros_type.replace("GPSFix", "GPSStatus")](
        header=make_header(store, stamp, frame),
        satellites_used=0,
        satellite_used_prn=nothing,
        satellites_visible=0,
        satellite_visible_prn=nothing,
        satellite_visible_z=nothing,
        satellite_visible_azimuth=nothing,
        satellite_visible_snr=nothing,
        status=fix.status.status,
        motion_source=0,
        orientation_source=0,
        position_source=source,
    )
    covariance = np.array(fix.position_covariance, dtype=float)
    unknown = {
        name: 0.0
        for name in (
            "track", "speed", "climb", "pitch", "roll", "dip", "gdop", "pdop", "hdop", "vdop",
            "tdop", "err_track", "err_speed", "err_climb", "err_time", "err_pitch", "err_roll",
            "err_dip",
        )
    }  # fmt: skip
    return store.types[ros_type](
        header=make_header(store, stamp, frame),
        status=status,
        latitude=fix.latitude,
        longitude=fix.longitude,
        altitude=fix.altitude,
        time=stamp.sec + 1e-9 * stamp.nanosec,
        **_errors_95(covariance, fix.position_covariance_type),
        **unknown,
        position_covariance=covariance,
        position_covariance_type=fix.position_covariance_type,
    )


def navsatfix_from_gpsfix(fix: Any, store: Typestore) -> Any:
    """Make the NavSatFix of `store` for a GPSFix of any store."""
    service = _SERVICE_GPS if fix.status.position_source & _SOURCE_GPS else 0
    if fix.status.position_source & _SOURCE_MAGNETIC:
        service |= _SERVICE_COMPASS
    code = _NAVSAT_STATUS.get(fix.status.status, fix.status.status)
    status = store.types["sensor_msgs/msg/NavSatStatus"](
        code if _NO_FIX <= code <= _GBAS else _NO_FIX, service
    )
    return store.types[NAVSATFIX](
        make_header(store, fix.header.stamp, fix.header.frame_id),
        status,
        fix.latitude,
        fix.longitude,
        fix.altitude,
        np.array(fix.position_covariance, dtype=float),
        fix.position_covariance_type,
    )


def _errors_95(covariance: Any, covariance_type: int) -> dict[str, float]:
    """Compute two sigma (2DRMS in the plane); zero where the covariance is not known."""
    variances = [max(float(v), 0.0) for v in covariance[[0, 4, 8]]]
    if not covariance_type or not all(map(math.isfinite, variances)):
        return {"err": 0.0, "err_horz": 0.0, "err_vert": 0.0}
    return {
        "err": 2.0 * math.sqrt(sum(variances)),
        "err_horz": 2.0 * math.sqrt(variances[0] + variances[1]),
        "err_vert": 2.0 * math.sqrt(variances[2]),
    }
