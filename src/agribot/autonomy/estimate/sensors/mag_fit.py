"""Hard and soft iron of a magnetometer from readings at known headings.

The levelled field of a robot that turns draws an ellipse: its centre is the field of the robot's
own magnets (hard iron), its shape the iron that bends the Earth's field (soft iron). With the
heading known to a few degrees this is linear: h = M (cos a, sin a) + o, where a is the bearing of
magnetic North from the robot's nose, counter-clockwise. Of M = S R only the symmetric S is used:
a rotation R looks like a wrong reference, and the filter keeps a bias for it.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.messages import FloatArray

Level = tuple[float, float]
SECTORS, PER_SECTOR = 36, 20
MIN_SECTORS = 12
# A fit with larger errors of the heading than this, 1 sigma at the worst heading, is not used.
MAX_STD_RAD = math.radians(1.5)
# Largest stretch of the field by iron that a fit takes away; more is a magnet nearby.
MAX_STRETCH_RATIO = 0.35


class MagCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """`offset_t` forward and left; `shape` (xx, xy, yy) makes a circle of the ellipse."""

    offset_t: Level = (0.0, 0.0)
    shape: tuple[float, float, float] = (1.0, 0.0, 1.0)

    def correct(self, level_t: Level) -> Level:
        x_t, y_t = level_t[0] - self.offset_t[0], level_t[1] - self.offset_t[1]
        xx, xy, yy = self.shape
        return xx * x_t + xy * y_t, xy * x_t + yy * y_t


class MagFitted(msgspec.Struct, frozen=True, kw_only=True):
    """A fit and how good it is: angles of the heading, 1 sigma; `turned_rad` is R, not used."""

    calibration: MagCalibration
    std_rad: float
    scatter_rad: float
    turned_rad: float
    field_t: float
    sectors: int

    def complaints(self) -> tuple[str, ...]:
        found = []
        if self.sectors < MIN_SECTORS:
            found.append(f"only {self.sectors} of {SECTORS} directions seen; turn further round")
        if not self.std_rad <= MAX_STD_RAD:
            found.append(
                f"headings would be good to {math.degrees(self.std_rad):.1f} degrees only, "
                f"{math.degrees(MAX_STD_RAD):.1f} are needed; turn longer, away from iron"
            )
        stretch = max(abs(self.calibration.shape[0] - 1.0), abs(self.calibration.shape[2] - 1.0))
        if stretch > MAX_STRETCH_RATIO:
            found.append(f"the ellipse is {100 * stretch:.0f} % off a circle; look for a magnet")
        return tuple(found)


def sector_of(north_rad: float) -> int:
    """Return the sector of a bearing of magnetic North from the nose."""
    return math.floor(north_rad / math.tau * SECTORS) % SECTORS


class MagFit:
    """Adds up readings, up to a limit for each direction, so that standing does not outweigh."""

    def __init__(self) -> None:
        self._counts = [0] * SECTORS
        self._square = np.zeros((3, 3))
        self._with_field = np.zeros((3, 2))
        self._power_t2 = 0.0

    @property
    def sectors(self) -> int:
        return sum(count > 0 for count in self._counts)

    @property
    def count(self) -> int:
        return sum(self._counts)

    def add(self, level_t: Level, north_rad: float) -> bool:
        """Add a levelled reading where magnetic North was at `north_rad`; False if not needed."""
        sector = sector_of(north_rad)
        if self._counts[sector] >= PER_SECTOR:
            return False
        self._counts[sector] += 1
        features = np.array([math.cos(north_rad), math.sin(north_rad), 1.0])
        self._square += np.outer(features, features)
        self._with_field += np.outer(features, level_t)
        self._power_t2 += level_t[0] ** 2 + level_t[1] ** 2
        return True

    def solve(self) -> MagFitted | None:
        """Solve for the ellipse; None while the readings do not determine it."""
        if self.sectors < 3 or self.count < 8:
            return None
        values, _ = np.linalg.eigh(self._square)
        if values[0] < 1e-3 * values[-1]:
            return None
        inverse = np.asarray(np.linalg.inv(self._square), dtype=np.float64)
        found = inverse @ self._with_field
        iron = found[:2].T
        left, sizes, right = np.linalg.svd(iron)
        turn = left @ right
        if sizes[1] < 1e-2 * sizes[0] or np.linalg.det(turn) < 0.0:
            return None
        stretch = (left * sizes) @ left.T
        field_t = math.sqrt(float(sizes[0] * sizes[1]))
        circle = field_t * np.linalg.inv(stretch)
        rest_t2 = max(self._power_t2 - float(np.sum(found * self._with_field)), 0.0)
        scatter_t = math.sqrt(rest_t2 / (2 * self.count - 6))
        return MagFitted(
            calibration=MagCalibration(
                offset_t=(float(found[2, 0]), float(found[2, 1])),
                shape=(float(circle[0, 0]), float(circle[0, 1]), float(circle[1, 1])),
            ),
            std_rad=scatter_t / field_t * _worst(inverse),
            scatter_rad=scatter_t / field_t,
            turned_rad=math.atan2(turn[1, 0], turn[0, 0]),
            field_t=field_t,
            sectors=self.sectors,
        )


def _worst(inverse: FloatArray) -> float:
    """Largest 1 sigma of the fitted field over all directions, per sigma of a reading."""
    angles = np.arange(SECTORS) * (math.tau / SECTORS)
    features = np.stack([np.cos(angles), np.sin(angles), np.ones(SECTORS)], axis=1)
    spread: FloatArray = np.einsum("ni,ij,nj->n", features, inverse, features)
    return math.sqrt(float(spread.max()))
