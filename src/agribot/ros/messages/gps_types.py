"""gps_umd's GPSFix, which no ROS brings with it: its types, and ours as one and back.

The same package is gps_common in ROS 1 and gps_msgs in ROS 2. Errors of a GPSFix are at 95 %.
"""

from __future__ import annotations

import math
from importlib import resources
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.core.geo import is_nowhere
from agribot.core.messages import GnssFix, GnssQuality, GnssStatus, Vec3

SHIPPED = "ros/messages/msg"
IN_ROS1, IN_ROS2 = "gps_common", "gps_msgs"
GPSFIX_ROS1, GPSFIX_ROS2 = f"{IN_ROS1}/msg/GPSFix", f"{IN_ROS2}/msg/GPSFix"
GPSSTATUS_ROS2 = f"{IN_ROS2}/msg/GPSStatus"

# GPSStatus: those of NavSatStatus, and some of its own; those of RTK are of ROS 2 only.
_NO_FIX, _FIX, _SBAS, _GBAS, _DGPS, _RTK_FIX, _RTK_FLOAT, _WAAS = -1, 0, 1, 2, 18, 19, 20, 33
_CODES = {
    GnssQuality.NONE: _NO_FIX,
    GnssQuality.SINGLE: _FIX,
    GnssQuality.DGNSS: _DGPS,
    GnssQuality.RTK_FIXED: _RTK_FIX,
    GnssQuality.RTK_FLOAT: _RTK_FLOAT,
}
# Quality and 1 sigma (m) of a fix that states none.
_QUALITY = {
    _FIX: (GnssQuality.SINGLE, 2.5),
    _SBAS: (GnssQuality.DGNSS, 1.0),
    _WAAS: (GnssQuality.DGNSS, 1.0),
    _DGPS: (GnssQuality.DGNSS, 1.0),
    _GBAS: (GnssQuality.RTK_FLOAT, 0.3),
    _RTK_FLOAT: (GnssQuality.RTK_FLOAT, 0.3),
    _RTK_FIX: (GnssQuality.RTK_FIXED, 0.02),
}
_FIXED_STD_M = 0.05  # a carrier solution that claims to be better has its ambiguities fixed
_MOST_VARIANCE_M2, _MOST_ERROR_M = 1e8, 1e4
_SOURCE_GPS, _SOURCE_DOPPLER = 1, 4
_APPROXIMATED = 1
_HEIGHT_FACTOR = 2.0  # ratio of the vertical sigma to the horizontal one, a guess


def read_shipped_texts() -> dict[str, str]:
    """Read the shipped .msg texts by ROS 1 type name, such as gps_common/msg/GPSFix."""
    texts = {}
    for package in (resources.files("agribot") / SHIPPED).iterdir():
        for file in package.iterdir():
            kind = file.name.removesuffix(".msg")
            texts[f"{package.name}/msg/{kind}"] = file.read_text(encoding="utf-8")
    return texts


def register_gps_types(store: Typestore, package: str) -> None:
    """Register GPSFix and GPSStatus under their package's name in that ROS."""
    types: dict[str, Any] = {}
    for name, text in read_shipped_texts().items():
        if name.startswith(f"{IN_ROS1}/"):
            types.update(get_types_from_msg(text, name.replace(IN_ROS1, package, 1)))
    store.register(types)


def make_gps_fix(fix: GnssFix, status: GnssStatus, header: Any, store: Typestore) -> Any:
    """Make the GPSFix of ROS 2 of a fix and of what else its receiver reported; else NaN."""
    std_m, unknown = fix.pos_std_m, math.nan
    east_mps, north_mps, up_mps = fix.velocity_mps or (unknown, unknown, unknown)
    variances_m2 = np.array([std_m**2, std_m**2, (_HEIGHT_FACTOR * std_m) ** 2])
    err_mps = unknown if fix.velocity_mps is None else 2.0 * fix.velocity_std_mps
    return store.types[GPSFIX_ROS2](
        header=header,
        status=_make_status(fix, status, header, store),
        latitude=fix.lat_deg,
        longitude=fix.lon_deg,
        altitude=fix.alt_m,
        track=math.degrees(math.atan2(east_mps, north_mps)) % 360.0,
        speed=math.hypot(east_mps, north_mps),
        climb=up_mps,
        **dict.fromkeys(("pitch", "roll", "dip", "err_time", "err_pitch", "err_roll"), unknown),
        **dict.fromkeys(("err_dip", "err_track"), unknown),
        time=fix.t_s,
        **{name: unknown if dop is None else dop for name, dop in _list_dops(status)},
        err=2.0 * math.sqrt(float(variances_m2.sum())),
        err_horz=2.0 * math.sqrt(float(variances_m2[:2].sum())),
        err_vert=2.0 * math.sqrt(float(variances_m2[2])),
        **dict.fromkeys(("err_speed", "err_climb"), err_mps),
        position_covariance=np.diag(variances_m2).ravel(),
        position_covariance_type=_APPROXIMATED,
    )


def _list_dops(status: GnssStatus) -> list[tuple[str, float | None]]:
    return [(name, getattr(status, name)) for name in ("gdop", "pdop", "hdop", "vdop", "tdop")]


def _make_status(fix: GnssFix, status: GnssStatus, header: Any, store: Typestore) -> Any:
    seen = status.satellites
    used = [each.number for each in seen if each.is_used]
    return store.types[GPSSTATUS_ROS2](
        header=header,
        satellites_used=len(used),
        satellite_used_prn=np.array(used, dtype=np.int32),
        satellites_visible=len(seen),
        satellite_visible_prn=_gather([each.number for each in seen]),
        satellite_visible_z=_gather([each.elevation_deg for each in seen]),
        satellite_visible_azimuth=_gather([each.azimuth_deg for each in seen]),
        satellite_visible_snr=_gather([each.snr_db for each in seen]),
        status=_CODES[fix.quality],
        motion_source=_SOURCE_DOPPLER if fix.velocity_mps else 0,
        orientation_source=0,
        position_source=_SOURCE_GPS,
    )


def _gather(values: list[Any]) -> Any:
    return np.rint(np.array(values, dtype=float)).astype(np.int32)


def use_ros1_codes(message: Any) -> Any:
    """Make the state of a GPSFix one that ROS 1 knows: RTK is ground based augmentation there."""
    if message.status.status in (_RTK_FIX, _RTK_FLOAT):
        message.status.status = _GBAS
    return message


def read_place(message: Any) -> tuple[float, float, float] | None:
    """Read latitude, longitude and altitude, NaN without one; None where the place is not known.

    Raises: BridgeError: no place on Earth.
    """
    lat_deg, lon_deg = float(message.latitude), float(message.longitude)
    alt_m = float(message.altitude)
    if is_nowhere(lat_deg, lon_deg):
        return None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0) or math.isinf(alt_m):
        place = (lat_deg, lon_deg, alt_m)
        raise BridgeError(
            f"latitude, longitude and altitude {place} are no place on Earth; send degrees and m"
        )
    return lat_deg, lon_deg, alt_m


def read_variance_m2(message: Any) -> float | None:
    """Read the horizontal variance; None where the message does not state it.

    Raises: BridgeError: one that is too large.
    """
    variances_m2 = [float(message.position_covariance[i]) for i in (0, 4)]
    if not message.position_covariance_type or not all(v >= 0.0 for v in variances_m2):
        return None
    if not max(variances_m2) < _MOST_VARIANCE_M2:
        raise BridgeError(
            f"a horizontal variance of {max(variances_m2):g} m^2 is not below "
            f"{_MOST_VARIANCE_M2:g}; the fix is left out"
        )
    return max(variances_m2) or None


def read_gps_fix(message: Any, t_s: float) -> GnssFix | None:
    """Read a GPSFix of either ROS; None without a fix.

    Raises: BridgeError: no place on Earth, or an invalid accuracy.
    """
    code = message.status.status
    if code <= _NO_FIX or (place := read_place(message)) is None:
        return None
    quality, std_m = _QUALITY.get(code, _QUALITY[_FIX])
    if variance_m2 := read_variance_m2(message):
        std_m = math.sqrt(variance_m2)
    elif 0.0 < message.err_horz < _MOST_ERROR_M:
        std_m = float(message.err_horz) / (2.0 * math.sqrt(2.0))
    if code == _GBAS and std_m <= _FIXED_STD_M:
        quality = GnssQuality.RTK_FIXED
    velocity_mps = _read_velocity(message)
    err_mps = float(message.err_speed)
    return GnssFix(
        t_s=t_s, lat_deg=place[0], lon_deg=place[1], alt_m=place[2], pos_std_m=std_m,
        quality=quality, velocity_mps=velocity_mps,
        velocity_std_mps=err_mps / 2.0 if 0.0 < err_mps < 1e3 else 0.1,
    )  # fmt: skip


def _read_velocity(message: Any) -> Vec3 | None:
    """Read East, North and up, NaN without a climb; None without a speed or a course.

    None, too, where all is zero and nothing says that it was measured.
    """
    speed_mps, climb_mps = float(message.speed), float(message.climb)
    course_rad = math.radians(float(message.track))
    if not math.isfinite(speed_mps + course_rad) or math.isinf(climb_mps):
        return None
    if speed_mps == 0.0 and not message.err_speed > 0.0:
        return None
    return speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad), climb_mps
