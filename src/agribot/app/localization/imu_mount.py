"""How an IMU is mounted, from gravity, from turns and from forward accelerations of the wheels.

Gravity and the turns of the wheels show the vertical axis in the IMU's own axes, and the turns its
sign. The horizontal acceleration is that of the wheels ahead and that of the curve to the left,
turned by the angle about the vertical which is left.
"""

from __future__ import annotations

import math
from itertools import permutations, product

import msgspec
import numpy as np

from agribot.core.messages import FloatArray, Vec3

GRAVITY_MPS2 = 9.81
# Mean acceleration below which an IMU subtracts gravity itself, m/s^2.
LEAST_GRAVITY_MPS2 = 0.7 * GRAVITY_MPS2
# 1 sigma of an angle that counts as found: a third of the angle that separates square mounts, rad.
SURE_RAD = math.radians(15.0)
# Largest angle between gravity and turns that agree, rad.
AGREE_RAD = math.radians(35.0)
# Angle to square up to which an IMU is mounted square: soil tilts the mean by some degrees, rad.
SQUARE_RAD, SQUARE_SIGMA = math.radians(12.0), 2.0
# Factor on the variance of accelerations by soil and vibration, which last over some samples.
LASTING = 4.0
# Share of the wheels' acceleration that an IMU must show to have measured it.
LEAST_GAIN, MOST_GAIN = 0.3, 2.0
LEAST_SAMPLES = 20


class ImuMount(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """`body_from_imu` (3, 3), and what is known of it.

    `how` says where it is from. `has_heading` is False where the angle about the vertical is not
    known: turns are right then, roll and pitch are not. `accel_sign` is -1 for an IMU that reports
    gravity itself, which points down. `has_gravity` is False for one that subtracts it. `apart_rad`
    is the angle between the verticals of gravity and of the turns, 0 where one is not known.
    Standard deviations are of the vertical by the turns and of the angle about it, rad.
    """

    body_from_imu: FloatArray
    how: str
    has_heading: bool = True
    has_gravity: bool = True
    accel_sign: float = 1.0
    turn_gain: float | None = None
    apart_rad: float = 0.0
    vertical_std_rad: float = math.inf
    heading_std_rad: float = math.inf

    def turn(self, vector: Vec3) -> Vec3:
        """Turn a vector of the IMU's axes to those of the body."""
        x, y, z = self.body_from_imu @ vector
        return float(x), float(y), float(z)

    @property
    def axes(self) -> str:
        """The body's axes in the IMU's, such as `x = imu z, y = imu x, z = imu y`."""
        rows = zip("xyz", self.body_from_imu, strict=True)
        return ", ".join(f"{name} = {_name_axis(row)}" for name, row in rows)


class ImuMountFit:
    """Sums over a drive that determine the mount; memory does not grow."""

    def __init__(self) -> None:
        self._count = self._standing = 0
        self._accel, self._accel_standing = np.zeros(3), np.zeros(3)
        # Regressors: 1, yaw rate, forward acceleration, acceleration to the left in a curve.
        self._normal, self._gyro_by = np.zeros((4, 4)), np.zeros((3, 4))
        self._accel_by = np.zeros((3, 4))
        self._gyro2, self._accel2 = np.zeros((3, 3)), np.zeros((3, 3))

    def add(
        self, gyro_radps: Vec3, accel_mps2: Vec3, v_mps: float, ahead_mps2: float, yaw_radps: float
    ) -> None:
        """Add means over a short time, of the IMU and of the wheels."""
        gyro, accel = np.array(gyro_radps), np.array(accel_mps2)
        known = np.array([1.0, yaw_radps, ahead_mps2, v_mps * yaw_radps])
        self._count += 1
        self._accel += accel
        if v_mps == ahead_mps2 == yaw_radps == 0.0:
            self._standing += 1
            self._accel_standing += accel
        self._normal += np.outer(known, known)
        self._gyro_by += np.outer(gyro, known)
        self._accel_by += np.outer(accel, known)
        self._gyro2 += np.outer(gyro, gyro)
        self._accel2 += np.outer(accel, accel)

    @property
    def gravity_mps2(self) -> FloatArray:
        """Mean acceleration in the IMU's axes (3,): at rest where the robot stood, else of all."""
        if self._standing >= LEAST_SAMPLES:
            return self._accel_standing / self._standing
        return self._accel / max(self._count, 1)

    def fit_turns(self) -> tuple[FloatArray, float]:
        """Fit the gyro's rates to the wheels' yaw rate: the slope (3,) and 1 sigma of each."""
        return _fit_slope(self._normal[:2, :2], self._gyro_by[:, :2], np.trace(self._gyro2))

    def solve(self) -> ImuMount | None:
        """Find the mount; None where neither gravity nor turns show the vertical."""
        slope, slope_std = self.fit_turns()
        gain = float(np.linalg.norm(slope))
        std_rad = slope_std / gain if gain > 0.0 else math.inf
        has_turned = bool(std_rad < SURE_RAD) and self._count >= LEAST_SAMPLES
        gravity = self.gravity_mps2
        has_gravity = float(np.linalg.norm(gravity)) > LEAST_GRAVITY_MPS2
        if not (has_turned or has_gravity):
            return None
        up, accel_sign = _find_up(gravity if has_gravity else None, slope if has_turned else None)
        cosine = float(up @ slope) / gain if has_turned else 1.0
        forward, heading_std_rad = self._find_forward(up, accel_sign)
        has_heading = bool(heading_std_rad < SURE_RAD)
        near_rad = max(SQUARE_RAD, SQUARE_SIGMA * heading_std_rad) if has_heading else math.inf
        body_from_imu = _make_square(_stack(forward, up), near_rad)
        sources = ("gravity",) * has_gravity + ("turns",) * has_turned
        return ImuMount(
            body_from_imu=body_from_imu,
            how=_name_sources(sources + ("accelerations",) * has_heading),
            has_heading=has_heading,
            has_gravity=has_gravity,
            accel_sign=accel_sign,
            turn_gain=gain if has_turned else None,
            apart_rad=math.acos(max(-1.0, min(1.0, cosine))),
            vertical_std_rad=std_rad,
            heading_std_rad=heading_std_rad,
        )

    def _find_forward(self, up: FloatArray, accel_sign: float) -> tuple[FloatArray, float]:
        """Find the forward axis across the vertical (3,), and its 1 sigma about it, rad."""
        east = _pick_across(up)
        north = np.cross(up, east)
        count = max(self._count, 1)
        mean_known, mean_accel = self._normal[0] / count, self._accel_by[:, 0] / count
        moment = accel_sign * (self._accel_by / count - np.outer(mean_accel, mean_known))[:, 2:]
        power = np.diag(self._normal)[2:].sum() / count - float(mean_known[2:] @ mean_known[2:])
        plane = np.stack([east, north]) @ moment  # rows east, north; columns ahead, left
        turned = complex(plane[0, 0] + plane[1, 1], plane[1, 0] - plane[0, 1])
        if power <= 0.0 or abs(turned) == 0.0:
            return east, math.inf
        gain = abs(turned) / power
        spread = self._accel2 / count - np.outer(mean_accel, mean_accel)
        noise = max(east @ spread @ east + north @ spread @ north - gain**2 * power, 0.0)
        std_rad = math.sqrt(LASTING * noise / (2.0 * count * power)) / gain
        forward = (turned.real * east + turned.imag * north) / abs(turned)
        is_measured = LEAST_GAIN < gain < MOST_GAIN and count >= LEAST_SAMPLES
        return forward, std_rad if is_measured else math.inf


def _fit_slope(normal: FloatArray, by: FloatArray, square: float) -> tuple[FloatArray, float]:
    """Fit y (3,) = slope x + offset from sums over 1 and x; the slope and 1 sigma of its parts."""
    count, mean_x = max(normal[0, 0], 1.0), normal[0, 1] / max(normal[0, 0], 1.0)
    power = normal[1, 1] / count - mean_x**2
    if power <= 0.0:
        return np.zeros(3), math.inf
    slope = (by[:, 1] / count - by[:, 0] / count * mean_x) / power
    mean_y = by[:, 0] / count
    noise = max(float(square) / count - mean_y @ mean_y - slope @ slope * power, 0.0)
    return slope, math.sqrt(LASTING * noise / (3.0 * count * power))


def _find_up(gravity: FloatArray | None, slope: FloatArray | None) -> tuple[FloatArray, float]:
    """Find the vertical in the IMU's axes (3,), and the sign of its acceleration."""
    if gravity is None:
        assert slope is not None
        return slope / np.linalg.norm(slope), 1.0
    up = gravity / np.linalg.norm(gravity)
    if slope is None:
        return up, 1.0
    cosine = float(up @ slope / np.linalg.norm(slope))
    if cosine < -math.cos(AGREE_RAD):
        return -up, -1.0
    return up, 1.0


def _pick_across(up: FloatArray) -> FloatArray:
    """Pick the IMU's axis that lies best across the vertical, made square to it (3,)."""
    axis = np.eye(3)[int(np.argmin(np.abs(up)))]
    across: FloatArray = axis - (axis @ up) * up
    return across / np.linalg.norm(across)


def _stack(forward: FloatArray, up: FloatArray) -> FloatArray:
    """Make `body_from_imu` (3, 3) of two of the body's axes, written in the IMU's."""
    ahead = forward - (forward @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up])


def _make_square(body_from_imu: FloatArray, near_rad: float) -> FloatArray:
    """Take the nearest square mount within an angle; where that is infinite, for the vertical."""
    if math.isinf(near_rad):
        nearest = max(SQUARE, key=lambda each: float(each[2] @ body_from_imu[2]))
        is_near = float(nearest[2] @ body_from_imu[2]) > math.cos(SQUARE_RAD)
        return _stack(_pick_across(nearest[2]), nearest[2]) if is_near else body_from_imu
    nearest = max(SQUARE, key=lambda each: float(np.sum(each * body_from_imu)))
    cosine = (float(np.sum(nearest * body_from_imu)) - 1.0) / 2.0
    return nearest if cosine > math.cos(near_rad) else body_from_imu


def _list_square() -> tuple[FloatArray, ...]:
    """List the 24 rotations (3, 3) whose axes are those of the IMU, either way."""
    rows = np.eye(3)
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.array(signs)[:, None] * rows[list(order)]
            if np.linalg.det(matrix) > 0.0:
                found.append(matrix)
    return tuple(found)


SQUARE = _list_square()


def _name_axis(row: FloatArray) -> str:
    """Name a body axis in the IMU's axes: `imu -y`, or its three parts."""
    largest = int(np.argmax(np.abs(row)))
    if abs(row[largest]) > 1.0 - 1e-6:
        return f"imu {'-' if row[largest] < 0.0 else ''}{'xyz'[largest]}"
    return "imu (" + ", ".join(f"{part:.2f}" for part in row.tolist()) + ")"


def _name_sources(sources: tuple[str, ...]) -> str:
    *first, last = sources
    return f"found from {', '.join(first)} and {last}" if first else f"found from {last}"
