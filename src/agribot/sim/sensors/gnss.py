"""GNSS receivers: the antenna's position and velocity with the errors of a preset."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray, GnssFix, GnssQuality, Vec3
from agribot.sim.attitude import rotate
from agribot.sim.random_streams import NormalRows, make_stream
from agribot.sim.sensors.noise import GaussMarkov, HectorNoise
from agribot.sim.sensors.presets import FloatOutages, HectorGnss, PhysicalGnss, Steps
from agribot.sim.sensors.tuning import Tuning
from agribot.sim.state import ANGULAR, POSITION, VELOCITY

# Least velocity error that a receiver claims, whatever the error model says.
BEST_VELOCITY_STD_MPS = 0.01


class Antenna:
    """Place and motion of the antenna; `arm_m` is its place in base axes."""

    def __init__(self, datum: Datum, arm_m: Vec3) -> None:
        self._frame = MapFrame(datum)
        self._arm_m = arm_m

    def compute_motion(self, row: FloatArray) -> tuple[Vec3, Vec3]:
        """Return position, m, and velocity, m/s, in the map, for a row of the history."""
        x, y, z = self._arm_m
        wx, wy, wz = row[ANGULAR].tolist()
        ax, ay, az = rotate(row, self._arm_m)
        ux, uy, uz = rotate(row, (wy * z - wz * y, wz * x - wx * z, wx * y - wy * x))
        px, py, pz = row[POSITION].tolist()
        vx, vy, vz = row[VELOCITY].tolist()
        return (px + ax, py + ay, pz + az), (vx + ux, vy + uy, vz + uz)

    def to_geodetic(self, east_m: float, north_m: float, up_m: float) -> Vec3:
        return self._frame.geodetic_from_map(east_m, north_m, up_m)


class HectorReceiver:
    """The original plugin: a drifting position, by default an exact velocity, no delay."""

    latency_s = 0.0
    is_fixed = False  # no ambiguities, so no heading from a second antenna

    def __init__(self, errors: HectorGnss, antenna: Antenna, seed: int) -> None:
        self._antenna = antenna
        self.tuning, self.velocity_tuning = _make_tunings(seed)
        self._position = HectorNoise(
            make_stream(seed, "gnss"), errors.drift_m, errors.drift_frequency_hz, errors.gaussian_m
        )
        self._velocity = HectorNoise(
            make_stream(seed, "gnss velocity"), 0.0, 0.0, errors.velocity_gaussian_mps
        )
        self._std_m = math.hypot(errors.drift_m, errors.gaussian_m)
        self._velocity_std_mps = max(errors.velocity_gaussian_mps, BEST_VELOCITY_STD_MPS)
        self._t_s = 0.0

    def compute_common_error(self) -> Vec3:
        """Return the error that a receiver near by has, too: east, north, up, m."""
        return self._position.drift

    def sample(self, t_s: float, row: FloatArray) -> GnssFix:
        """Return the fix for one row of the physics history."""
        (east, north, up), velocity = self._antenna.compute_motion(row)
        dt_s, self._t_s = t_s - self._t_s, t_s
        de, dn, du = self._position.step(dt_s)
        seen_m = self.tuning.apply(t_s, (east + de, north + dn, up + du))
        lat_deg, lon_deg, alt_m = self._antenna.to_geodetic(*seen_m)
        ve, vn, vu = self._velocity.step(dt_s)
        seen_mps = (velocity[0] + ve, velocity[1] + vn, velocity[2] + vu)
        return GnssFix(
            t_s=t_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            pos_std_m=self._std_m,
            quality=GnssQuality.SINGLE,
            velocity_mps=self.velocity_tuning.apply(t_s, seen_mps),
            velocity_std_mps=self._velocity_std_mps,
        )


class Receiver:
    """Slow and fast position errors, velocity noise, and spells without a fixed solution."""

    def __init__(self, errors: PhysicalGnss, antenna: Antenna, seed: int) -> None:
        self.latency_s = errors.latency_s
        self.is_fixed = errors.quality == GnssQuality.RTK_FIXED
        self._errors = errors
        self._antenna = antenna
        self.tuning, self.velocity_tuning = _make_tunings(seed)
        ratio = errors.vertical_ratio
        self._white = (errors.white_std_m, errors.white_std_m, ratio * errors.white_std_m)
        self._wander = [
            GaussMarkov(
                make_stream(seed, f"gnss wander {index}"),
                (wander.std_m, wander.std_m, ratio * wander.std_m),
                wander.tau_s,
            )
            for index, wander in enumerate(errors.wander)
        ]
        self._steps = None if errors.steps is None else StepProcess(errors.steps, ratio, seed)
        self._normal = NormalRows(make_stream(seed, "gnss"), 6)
        self._outages = (
            None if errors.outages is None else OutageProcess(errors.outages, ratio, seed)
        )
        self._t_s = 0.0

    def compute_common_error(self) -> Vec3:
        """Return the error that a receiver near by has, too: east, north, up, m."""
        terms = [
            wander.value
            for wander, settings in zip(self._wander, self._errors.wander, strict=True)
            if settings.common
        ]
        x, y, z = (sum((term[axis] for term in terms), 0.0) for axis in range(3))
        return x, y, z

    def sample(self, t_s: float, row: FloatArray) -> GnssFix:
        """Return the fix for one row of the physics history."""
        (east, north, up), velocity = self._antenna.compute_motion(row)
        dt_s, self._t_s = t_s - self._t_s, t_s
        normal = self._normal.take(1)[0].tolist()
        errors = [std * n for std, n in zip(self._white, normal, strict=False)]
        terms = [wander.step(dt_s) for wander in self._wander]
        if self._steps is not None:
            terms.append(self._steps.step(t_s, dt_s))
        quality, std_m = self._errors.quality, self._errors.reported_std_m
        if self._outages is not None and (term := self._outages.step(t_s, dt_s)) is not None:
            terms.append(term)
            quality, std_m = GnssQuality.RTK_FLOAT, self._outages.std_m
        self.is_fixed = quality == GnssQuality.RTK_FIXED
        de, dn, du = (error + sum(t[axis] for t in terms) for axis, error in enumerate(errors))
        seen_m = self.tuning.apply(t_s, (east + de, north + dn, up + du))
        lat_deg, lon_deg, alt_m = self._antenna.to_geodetic(*seen_m)
        speed, has_velocity = self._errors.velocity_std_mps, self._errors.has_velocity
        ve, vn, vu = (v + speed * n for v, n in zip(velocity, normal[3:], strict=True))
        return GnssFix(
            t_s=t_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            pos_std_m=std_m,
            quality=quality,
            velocity_mps=self.velocity_tuning.apply(t_s, (ve, vn, vu)) if has_velocity else None,
            velocity_std_mps=max(speed, BEST_VELOCITY_STD_MPS),
        )


def _make_tunings(seed: int) -> tuple[Tuning, Tuning]:
    """Make the tunings of position and velocity."""
    return Tuning(make_stream(seed, "tuning gnss")), Tuning(
        make_stream(seed, "tuning gnss velocity")
    )


class StepProcess:
    """Steps of the position that fade: satellites and reflections come and go."""

    def __init__(self, steps: Steps, vertical_ratio: float, seed: int) -> None:
        self._steps = steps
        self._rng = make_stream(seed, "gnss steps")
        self._std_m = steps.std_m * np.array([1.0, 1.0, vertical_ratio])
        self._value_m = np.zeros(3)
        self._next_s = self._rng.exponential(steps.mean_gap_s)

    def step(self, t_s: float, dt_s: float) -> Vec3:
        self._value_m *= math.exp(-dt_s / self._steps.tau_s)
        while t_s >= self._next_s:
            self._value_m += self._std_m * self._rng.standard_normal(3)
            self._next_s += self._rng.exponential(self._steps.mean_gap_s)
        x_m, y_m, z_m = self._value_m.tolist()
        return x_m, y_m, z_m


class OutageProcess:
    """Spells in which the ambiguities are lost, and the error of the float solution in them."""

    def __init__(self, outages: FloatOutages, vertical_ratio: float, seed: int) -> None:
        self.std_m = outages.std_m
        self._outages = outages
        self._rng = make_stream(seed, "gnss outages")
        std = (outages.std_m, outages.std_m, vertical_ratio * outages.std_m)
        self._error = GaussMarkov(make_stream(seed, "gnss float"), std, outages.tau_s)
        self._start_s = self._rng.exponential(outages.mean_gap_s)
        self._end_s = self._start_s + self._sample_duration_s()

    def step(self, t_s: float, dt_s: float) -> Vec3 | None:
        """Return the float solution's error, or None while the ambiguities are fixed."""
        if t_s >= self._end_s:
            self._start_s = self._end_s + self._rng.exponential(self._outages.mean_gap_s)
            self._end_s = self._start_s + self._sample_duration_s()
            self._error.restart()
        return self._error.step(dt_s) if t_s >= self._start_s else None

    def _sample_duration_s(self) -> float:
        return float(self._rng.uniform(self._outages.min_duration_s, self._outages.max_duration_s))
