"""GNSS positions as odometry on the UTM grid and back, as the nodes of gps_umd do it.

x is easting and y northing in metres, z the altitude; the projection is that of pyproj.
"""

from __future__ import annotations

import functools
import math
import re
from typing import Any

import msgspec
import numpy as np
from rosbags.typesys.store import Typestore

from agribot.core.errors import RecordingError
from agribot.core.extras import format_install
from agribot.ros.messages.fixes import make_header

ODOMETRY = "nav_msgs/msg/Odometry"
ROT_COVARIANCE = 99999.0  # rad^2: a position holds no orientation

_ZONE = re.compile(r"(?:.*?utm_)?(\d{1,2})([NS])", re.IGNORECASE)
_NAVSATFIX_STATUS_FIX, _SERVICE_GPS = 0, 1
_APPROXIMATED = 1


class UtmZone(msgspec.Struct, frozen=True):
    number: int
    is_south: bool = False

    def __str__(self) -> str:
        return f"{self.number}{'S' if self.is_south else 'N'}"


def parse_zone(text: str) -> UtmZone:
    """Parse 43N (northern half of zone 43) or 43S (southern half).

    Raises: RecordingError: anything else.
    """
    found = _ZONE.fullmatch(text.strip())
    if found is None or not 1 <= int(found[1]) <= 60:
        raise RecordingError(
            f"'{text}' is no UTM zone; write its number from 1 to 60 and the hemisphere: 43N, 33S"
        )
    return UtmZone(int(found[1]), found[2].upper() == "S")


def find_zone(lat_deg: float, lon_deg: float) -> UtmZone:
    """Find the zone of a place: six degrees of longitude each, but for Norway and Svalbard.

    Raises: RecordingError: beyond 80 degrees South or 84 degrees North there is no UTM.
    """
    if not -80.0 <= lat_deg <= 84.0:
        raise RecordingError(
            f"latitude {lat_deg:.4f}: UTM ends at 80 degrees South and 84 North; use map frames"
        )
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0
    number = min(int((lon_deg + 180.0) // 6.0) + 1, 60)
    if 56.0 <= lat_deg < 64.0 and 3.0 <= lon_deg < 12.0:
        number = 32
    elif lat_deg >= 72.0 and 0.0 <= lon_deg < 42.0:
        number = 31 + 2 * int((lon_deg + 3.0) // 12.0)
    return UtmZone(number, lat_deg < 0.0)


def utm_from_geodetic(lat_deg: float, lon_deg: float, zone: UtmZone) -> tuple[float, float]:
    """Convert to easting and northing in metres."""
    east_m, north_m = _projection(zone)(lon_deg, lat_deg)
    return float(east_m), float(north_m)


def geodetic_from_utm(east_m: float, north_m: float, zone: UtmZone) -> tuple[float, float]:
    """Convert to latitude and longitude in degrees."""
    lon_deg, lat_deg = _projection(zone)(east_m, north_m, inverse=True)
    return float(lat_deg), float(lon_deg)


def odometry_from_fix(
    fix: Any,
    store: Typestore,
    zone: UtmZone | None = None,
    frame_id: str = "",
    child_frame_id: str = "",
    rot_covariance: float = ROT_COVARIANCE,
    append_zone: bool = False,
) -> Any | None:
    """Make odometry of a NavSatFix or GPSFix, in its own zone unless one is given.

    None without a fix, or for one that was never stamped. `frame_id` is that of the fix unless
    given; `append_zone` writes the zone behind it (map/utm_43N), so that the way back knows it.
    """
    code = fix.status.status
    stamp = fix.header.stamp
    if code < 0 or (stamp.sec == 0 and stamp.nanosec == 0):
        return None
    if not (math.isfinite(fix.latitude) and math.isfinite(fix.longitude)):
        return None
    zone = zone or find_zone(fix.latitude, fix.longitude)
    east_m, north_m = utm_from_geodetic(fix.latitude, fix.longitude, zone)
    frame = frame_id or fix.header.frame_id
    if append_zone:
        frame = f"{frame}/utm_{zone}"
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.reshape(fix.position_covariance, (3, 3))
    covariance[3:, 3:] = np.eye(3) * rot_covariance
    make = store.types
    position = make["geometry_msgs/msg/Point"](east_m, north_m, fix.altitude)
    pose = make["geometry_msgs/msg/Pose"](
        position, make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    still = make["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = make["geometry_msgs/msg/Twist"](still, still)
    return make[ODOMETRY](
        make_header(store, stamp, frame),
        child_frame_id,
        make["geometry_msgs/msg/PoseWithCovariance"](pose, covariance.ravel()),
        make["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )


def fix_from_odometry(
    odometry: Any, store: Typestore, zone: UtmZone | None = None, frame_id: str = ""
) -> Any:
    """Make a NavSatFix of odometry on the UTM grid; without `zone`, its frame must end in one.

    Raises: RecordingError: no zone is known.
    """
    frame = odometry.header.frame_id
    if zone is None:
        if "utm_" not in frame:
            raise RecordingError(
                f"the frame '{frame}' does not say its UTM zone; give it, such as 43N"
            )
        zone = parse_zone(frame)
    position = odometry.pose.pose.position
    lat_deg, lon_deg = geodetic_from_utm(position.x, position.y, zone)
    covariance = np.reshape(odometry.pose.covariance, (6, 6))[:3, :3]
    status = store.types["sensor_msgs/msg/NavSatStatus"](_NAVSATFIX_STATUS_FIX, _SERVICE_GPS)
    return store.types["sensor_msgs/msg/NavSatFix"](
        make_header(store, odometry.header.stamp, frame_id or frame.partition("/utm_")[0]),
        status,
        lat_deg,
        lon_deg,
        position.z,
        np.ascontiguousarray(covariance).ravel(),
        _APPROXIMATED,
    )


@functools.cache
def _projection(zone: UtmZone) -> Any:
    try:
        from pyproj import Proj
    except ImportError as error:
        raise RecordingError(
            f"UTM needs the package pyproj; install it with: {format_install('gis')}"
        ) from error
    return Proj(proj="utm", zone=zone.number, south=zone.is_south, ellps="WGS84")
