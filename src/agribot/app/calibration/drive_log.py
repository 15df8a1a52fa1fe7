"""The samples of a calibration drive: what wheels, gyro and GNSS say of each stretch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.errors import MissionError
from agribot.core.facts import FewSamples, Sampled
from agribot.core.geo import MapFrame, make_datum
from agribot.core.messages import FloatArray, GnssFix, SensorBatch

# Time after the stop command in which the robot brakes, rocks and untwists on its tyres, s.
SETTLE_S = 1.0


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """One motion from rest to rest; `end_s` is the command to stop.

    `distance_m` is a leg's length by tape, if it was measured.
    """

    name: str
    start_s: float
    end_s: float
    is_leg: bool
    distance_m: float | None = None

    @property
    def at_rest_s(self) -> float:
        return self.end_s + SETTLE_S


class DriveLog:
    """The sensor samples of a drive as arrays, with the gyro's bias taken out."""

    def __init__(self, batches: Sequence[SensorBatch], stretches: Sequence[Stretch]) -> None:
        """Sort the samples of a drive into arrays.

        Raises: MissionError: no stretches, or wheels, gyro or GNSS said nothing.
        """
        wheels = [sample for batch in batches for sample in batch.wheels]
        imu = [sample for batch in batches for sample in batch.imu]
        fixes = [fix for batch in batches for fix in batch.gnss]
        self.fixes: list[GnssFix] = [fix for fix in fixes if not fix.unmeasured]
        counts: dict[Sampled, int] = {
            "wheels": len(wheels), "imu": len(imu), "stretches": len(stretches),
        }  # fmt: skip
        for what, count in counts.items():
            if count < 2:
                raise MissionError(FewSamples(count, what))
        self.wheel_t_s = np.array([sample.t_s for sample in wheels])
        self.wheel_rad = np.array([sample.angle_rad for sample in wheels])
        self.imu_t_s = np.array([sample.t_s for sample in imu])
        self._gyro = np.array([sample.gyro_radps[2] for sample in imu])
        self.rests = _rests(stretches, float(self.imu_t_s[0]), float(self.imu_t_s[-1]))
        self._is_steady = [True, *(stretch.is_leg for stretch in stretches)]
        self._turned_rad = self._integrate()
        self._positions = self._rest_positions()

    def turned_rad(self, start_s: float, end_s: float) -> float:
        turned = np.interp([start_s, end_s], self.imu_t_s, self._turned_rad)
        return float(turned[1] - turned[0])

    def wheels_rad(self, start_s: float, end_s: float) -> FloatArray:
        """Turn of each wheel in the order of WHEEL_NAMES, (4,)."""
        ends = [
            [np.interp(t_s, self.wheel_t_s, column) for column in self.wheel_rad.T]
            for t_s in (start_s, end_s)
        ]
        return np.subtract(ends[1], ends[0])

    def rolled_rad(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Turn of the wheels: mean of all, and right minus left."""
        right_r, left_r, right_f, left_f = self.wheels_rad(start_s, end_s).tolist()
        right, left = (right_r + right_f) / 2.0, (left_r + left_f) / 2.0
        return (right + left) / 2.0, right - left

    def displacement(self, index: int) -> tuple[FloatArray, float] | None:
        """Measure a stretch by positions: East and North, (2,), and 1 sigma."""
        before, after = self._positions[index], self._positions[index + 1]
        if before is None or after is None:
            return None
        return after[0] - before[0], math.hypot(before[1], after[1])

    def integrate(self, stretch: Stretch) -> tuple[float, float] | None:
        """Integrate the GNSS velocity over a leg: its length, and 1 sigma."""
        start_s, end_s = stretch.start_s - SETTLE_S, stretch.at_rest_s
        during = [
            fix for fix in self.fixes
            if fix.velocity_mps is not None and start_s <= fix.t_s <= end_s
        ]  # fmt: skip
        if len(during) < 3:
            return None
        t_s = np.array([fix.t_s for fix in during])
        velocity = np.array([fix.velocity_mps for fix in during])[:, :2]
        steps_s = np.diff(t_s)[:, None]
        path = ((velocity[1:] + velocity[:-1]) / 2.0 * steps_s).sum(axis=0)
        step_s = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
        return float(np.hypot(*path)), during[0].velocity_std_mps * step_s * math.sqrt(len(t_s))

    def _integrate(self) -> FloatArray:
        """Turn since the start, with the bias of the rests, linear between them.

        After a turn the body goes on to untwist slowly on its tyres: those rests do not count.
        """
        middles, biases = [], []
        for (start_s, end_s), is_steady in zip(self.rests, self._is_steady, strict=True):
            if not is_steady:
                continue
            still = (self.imu_t_s >= start_s) & (self.imu_t_s <= end_s)
            if np.count_nonzero(still) > 1:
                middles.append((start_s + end_s) / 2.0)
                biases.append(float(self._gyro[still].mean()))
        bias = np.interp(self.imu_t_s, middles, biases) if middles else 0.0
        steps = np.diff(self.imu_t_s, prepend=self.imu_t_s[0])
        return np.cumsum((self._gyro - bias) * steps)

    def _rest_positions(self) -> list[tuple[FloatArray, float] | None]:
        if not self.fixes:
            return [None] * len(self.rests)
        first = self.fixes[0]
        frame = MapFrame(make_datum(first.lat_deg, first.lon_deg, first.alt_m))
        positions: list[tuple[FloatArray, float] | None] = []
        for start_s, end_s in self.rests:
            fixes = [fix for fix in self.fixes if start_s <= fix.t_s <= end_s]
            if not fixes:
                positions.append(None)
                continue
            places = [frame.map_from_geodetic(f.lat_deg, f.lon_deg, f.alt_m)[:2] for f in fixes]
            weights = np.array([fix.pos_std_m**-2 for fix in fixes])
            mean = np.average(np.array(places), axis=0, weights=weights)
            # Errors of successive fixes are alike: averaging does not make them small.
            positions.append((mean, min(fix.pos_std_m for fix in fixes)))
        return positions


def _rests(
    stretches: Sequence[Stretch], first_s: float, last_s: float
) -> list[tuple[float, float]]:
    """List rests before, between and after the stretches, without the rocking after braking."""
    ends = [first_s, *(stretch.at_rest_s for stretch in stretches)]
    starts = [*(stretch.start_s for stretch in stretches), last_s]
    return list(zip(ends, starts, strict=True))
