"""Places and angles: WGS-84 and the local map, yaw and compass, rigid transforms."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, Vec3

# WGS-84 (NIMA TR8350.2): semi-major axis and first eccentricity squared.
WGS84_A_M = 6378137.0
WGS84_E2 = 6.69437999014e-3


def wrap_rad(angle_rad: float) -> float:
    """Wrap an angle to (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def compass_deg_from_yaw(yaw_map_rad: float) -> float:
    """Convert a yaw, counter-clockwise from East, to degrees clockwise from North in [0, 360)."""
    compass_deg = (90.0 - math.degrees(yaw_map_rad)) % 360.0
    return 0.0 if compass_deg == 360.0 else compass_deg  # a tiny negative angle rounds up to 360


def yaw_from_compass_deg(compass_deg: float) -> float:
    return wrap_rad(math.radians(90.0 - compass_deg))


def ecef_from_geodetic(lat_deg: float, lon_deg: float, alt_m: float) -> FloatArray:
    """Convert to an Earth-centred, Earth-fixed position in metres, (3,)."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    normal_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * math.sin(lat) ** 2)
    return np.array(
        [
            (normal_m + alt_m) * math.cos(lat) * math.cos(lon),
            (normal_m + alt_m) * math.cos(lat) * math.sin(lon),
            (normal_m * (1.0 - WGS84_E2) + alt_m) * math.sin(lat),
        ]
    )


def geodetic_from_ecef(ecef_m: FloatArray) -> Vec3:
    """Convert a position (3,) in metres to latitude, longitude (degrees) and altitude (m).

    Source: Bowring 1985, three iterations; below 10 nm of error within 10 km of the surface.
    """
    x, y, z = float(ecef_m[0]), float(ecef_m[1]), float(ecef_m[2])
    semi_minor_m = WGS84_A_M * math.sqrt(1.0 - WGS84_E2)
    second_e2 = WGS84_E2 / (1.0 - WGS84_E2)
    p_m = math.hypot(x, y)
    reduced = math.atan2(WGS84_A_M * z, semi_minor_m * p_m)
    lat = 0.0
    for _ in range(3):
        lat = math.atan2(
            z + second_e2 * semi_minor_m * math.sin(reduced) ** 3,
            p_m - WGS84_E2 * WGS84_A_M * math.cos(reduced) ** 3,
        )
        reduced = math.atan2((1.0 - WGS84_E2) ** 0.5 * math.sin(lat), math.cos(lat))
    root = math.sqrt(1.0 - WGS84_E2 * math.sin(lat) ** 2)
    alt_m = p_m * math.cos(lat) + z * math.sin(lat) - WGS84_A_M * root
    return math.degrees(lat), math.degrees(math.atan2(y, x)), alt_m


class Datum(msgspec.Struct, frozen=True, kw_only=True):
    """A place on Earth, the origin of a local map."""

    lat_deg: Annotated[float, msgspec.Meta(ge=-90, le=90)]
    lon_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)]
    alt_m: float = 0.0


def is_place(lat_deg: float, lon_deg: float) -> bool:
    """Return whether degrees, which another program may have left unset, are a place on Earth."""
    return abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and not is_nowhere(lat_deg, lon_deg)


NOWHERE = (
    "latitude 0, longitude 0 is what devices write that have no fix; remove it, or give the right "
    "place"
)


def is_nowhere(lat_deg: float, lon_deg: float) -> bool:
    """Return whether a place is exactly 0, 0, which devices and files without a place state.

    It lies in the sea, 570 km from the next field.
    """
    return lat_deg == 0.0 and lon_deg == 0.0


def make_datum(lat_deg: float, lon_deg: float, alt_m: float) -> Datum:
    """Make a datum there, on the ellipsoid where the altitude is not known (NaN)."""
    return Datum(lat_deg=lat_deg, lon_deg=lon_deg, alt_m=0.0 if math.isnan(alt_m) else alt_m)


def enu_from_ecef(lat_deg: float, lon_deg: float) -> FloatArray:
    """Return the rotation (3, 3) from Earth-centred axes to East, North, Up at a place."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )


class MapFrame:
    """The exact East-North-Up frame of a datum (a rotation of ECEF, no projection)."""

    def __init__(self, datum: Datum) -> None:
        self.datum = datum
        self._origin_ecef_m = ecef_from_geodetic(datum.lat_deg, datum.lon_deg, datum.alt_m)
        self._enu_from_ecef = enu_from_ecef(datum.lat_deg, datum.lon_deg)

    def map_from_geodetic(self, lat_deg: float, lon_deg: float, alt_m: float) -> Vec3:
        """Convert to East, North, Up in metres; an unknown altitude (NaN) is that of the datum."""
        alt_m = self.datum.alt_m if math.isnan(alt_m) else alt_m
        delta = ecef_from_geodetic(lat_deg, lon_deg, alt_m) - self._origin_ecef_m
        east, north, up = self._enu_from_ecef @ delta
        return float(east), float(north), float(up)

    def geodetic_from_map(self, east_m: float, north_m: float, up_m: float = 0.0) -> Vec3:
        """Convert to latitude and longitude in degrees and altitude in metres."""
        enu = np.array([east_m, north_m, up_m])
        return geodetic_from_ecef(self._origin_ecef_m + self._enu_from_ecef.T @ enu)

    def lonlat_from_map(self, xy_m: FloatArray) -> FloatArray:
        """Convert East and North of many places (N, 2) to longitude and latitude, degrees (N, 2).

        Bowring 1985 as in `geodetic_from_ecef`; within 20 km of the datum one iteration is exact.
        """
        ecef = xy_m @ self._enu_from_ecef[:2] + self._origin_ecef_m
        semi_minor_m = WGS84_A_M * math.sqrt(1.0 - WGS84_E2)
        second_e2 = WGS84_E2 / (1.0 - WGS84_E2)
        p_m = np.hypot(ecef[:, 0], ecef[:, 1])
        reduced = np.arctan2(WGS84_A_M * ecef[:, 2], semi_minor_m * p_m)
        lat = np.arctan2(
            ecef[:, 2] + second_e2 * semi_minor_m * np.sin(reduced) ** 3,
            p_m - WGS84_E2 * WGS84_A_M * np.cos(reduced) ** 3,
        )
        lonlat: FloatArray = np.column_stack([np.arctan2(ecef[:, 1], ecef[:, 0]), lat])
        return np.rad2deg(lonlat)

    def map_from_lonlat(self, lonlat_deg: FloatArray) -> FloatArray:
        """Convert longitude and latitude (N, 2), degrees, to East and North, m (N, 2).

        The places lie in the map's plane, up = 0: those far away are above the datum's height.
        """
        flat_m = self._project(lonlat_deg, np.full(len(lonlat_deg), self.datum.alt_m))
        above_m = (flat_m**2).sum(axis=1) / (2.0 * WGS84_A_M)
        return self._project(lonlat_deg, self.datum.alt_m + above_m)

    def _project(self, lonlat_deg: FloatArray, alt_m: FloatArray) -> FloatArray:
        lon, lat = np.radians(lonlat_deg[:, 0]), np.radians(lonlat_deg[:, 1])
        normal_m = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * np.sin(lat) ** 2)
        across_m = (normal_m + alt_m) * np.cos(lat)
        up_m = (normal_m * (1.0 - WGS84_E2) + alt_m) * np.sin(lat)
        ecef = np.column_stack([across_m * np.cos(lon), across_m * np.sin(lon), up_m])
        xy_m: FloatArray = (ecef - self._origin_ecef_m) @ self._enu_from_ecef[:2].T
        return xy_m


class AlvinXY:
    """The equirectangular x, y of the original robot's nodes, kept for old goal files.

    It is a projection, not a frame: off the exact map by up to 5 mm at 100 m, 65 mm at 1 km
    and 1 m at 5 km (21 degrees North; at 60 degrees 178 mm at 1 km; the tests hold the
    numbers). Use MapFrame for everything else.
    Source: Murphy, "AlvinXY", WHOI; series of the metres per degree as in Snyder 1987.
    """

    def __init__(self, datum: Datum) -> None:
        self.datum = datum
        lat = math.radians(datum.lat_deg)
        self._m_per_deg_lat = (
            111132.09 - 566.05 * math.cos(2 * lat) + 1.20 * math.cos(4 * lat)
            - 0.002 * math.cos(6 * lat)
        )  # fmt: skip
        self._m_per_deg_lon = (
            111415.13 * math.cos(lat) - 94.55 * math.cos(3 * lat) + 0.12 * math.cos(5 * lat)
        )

    def xy_from_geodetic(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        d_lon_deg = math.remainder(lon_deg - self.datum.lon_deg, 360.0)
        d_lat_deg = lat_deg - self.datum.lat_deg
        return d_lon_deg * self._m_per_deg_lon, d_lat_deg * self._m_per_deg_lat

    def geodetic_from_xy(self, x_m: float, y_m: float) -> tuple[float, float]:
        lon_deg = self.datum.lon_deg + x_m / self._m_per_deg_lon
        return self.datum.lat_deg + y_m / self._m_per_deg_lat, math.remainder(lon_deg, 360.0)


def std_along_m(cov_m2: Vec3, direction: tuple[float, float]) -> float:
    """Give 1 sigma of a position along a unit vector; `cov_m2` is its covariance xx, xy and yy."""
    (xx, xy, yy), (dx, dy) = cov_m2, direction
    return math.sqrt(max(xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy, 0.0))


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> FloatArray:
    """Make the rotation (3, 3) of URDF's fixed-axis roll, pitch, yaw: Rz @ Ry @ Rx."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_from_quaternion(w: float, x: float, y: float, z: float) -> FloatArray:
    """Make the rotation `parent_from_child` (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rpy_from_rotation(rotation: FloatArray) -> Vec3:
    """Find the fixed-axis roll, pitch, yaw of a rotation (3, 3) with |pitch| < 90 degrees."""
    sin_pitch = max(-1.0, min(1.0, -float(rotation[2, 0])))
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.asin(sin_pitch),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )


def transform(xyz_m: Vec3, rpy_rad: Vec3 = (0.0, 0.0, 0.0)) -> FloatArray:
    """Make the homogeneous matrix `parent_from_child` (4, 4) of a URDF origin."""
    parent_from_child = np.eye(4)
    parent_from_child[:3, :3] = rotation_from_rpy(*rpy_rad)
    parent_from_child[:3, 3] = xyz_m
    return parent_from_child


def inverse(parent_from_child: FloatArray) -> FloatArray:
    """Invert a rigid transform (4, 4): `child_from_parent`, (4, 4)."""
    rotation = parent_from_child[:3, :3].T
    child_from_parent = np.eye(4)
    child_from_parent[:3, :3] = rotation
    child_from_parent[:3, 3] = -rotation @ parent_from_child[:3, 3]
    return child_from_parent


def is_backwards(xy_m: FloatArray, yaw_rad: FloatArray) -> npt.NDArray[np.bool_]:
    """Return for poses (N, 2), (N,) of a way whether the body leaves each against its heading.

    While it stands, and at the end, it keeps the direction before.
    """
    step_m = np.diff(xy_m, axis=0)
    ahead_m = step_m[:, 0] * np.cos(yaw_rad[:-1]) + step_m[:, 1] * np.sin(yaw_rad[:-1])
    last = np.maximum.accumulate(np.where(ahead_m != 0.0, np.arange(len(ahead_m)), 0))
    return np.append(ahead_m[last] < 0.0, ahead_m[last[-1]] < 0.0)


# Columns: the optical axes (x right, y down, z forward) written in link axes (x forward).
LINK_FROM_OPTICAL = transform((0.0, 0.0, 0.0), (-math.pi / 2, 0.0, -math.pi / 2))
