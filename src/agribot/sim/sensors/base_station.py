"""A second GNSS receiver at a known place, which can share the rover's slow errors."""

from __future__ import annotations

import math
from collections.abc import Callable

from agribot.core.geo import MapFrame
from agribot.core.messages import BaseFix, FloatArray, Vec3
from agribot.core.world import WorldSpec
from agribot.sim.random_streams import NormalRows, make_stream
from agribot.sim.sensors.gnss import HectorReceiver, Receiver
from agribot.sim.sensors.noise import GaussMarkov, HectorNoise
from agribot.sim.sensors.presets import HectorGnss, PhysicalGnss

BASE_RATE_HZ = 5.0
ANTENNA_HEIGHT_M = 0.25
# Names of the pole in a world: that of the farm, and the gate at its entry with a receiver on it.
POLES = ("Pole", "entry_gate")

ErrorStep = Callable[[float], Vec3]


class BaseStation:
    """A receiver at the world's pole, or at the datum without a pole.

    With `is_common` it has the slow errors of `rover`, those of orbits and atmosphere, as they
    were at the rover's last fix, and its own fast ones; else all errors are its own.
    """

    def __init__(
        self,
        errors: HectorGnss | PhysicalGnss,
        rover: HectorReceiver | Receiver,
        world: WorldSpec,
        seed: int,
        *,
        is_common: bool,
    ) -> None:
        self._place_m = _find_place(world)
        self._frame = MapFrame(world.datum)
        self._known = self._frame.geodetic_from_map(*self._place_m)
        self._rover = rover if is_common else None
        if isinstance(errors, HectorGnss):
            self._std_m = math.hypot(errors.drift_m, errors.gaussian_m)
            self._step = _make_hector_step(errors, seed, is_common)
        else:
            self._std_m = errors.reported_std_m
            self._step = _make_physical_step(errors, seed, is_common)
        self._velocity = _make_velocity(errors, seed)
        self._t_s = 0.0

    def sample(self, t_s: float, row: FloatArray) -> BaseFix:
        """Return the fix at `t_s`; the row of the physics history is the rover's."""
        dt_s, self._t_s = t_s - self._t_s, t_s
        error = self._step(dt_s)
        shared = (0.0, 0.0, 0.0) if self._rover is None else self._rover.compute_common_error()
        east, north, up = (
            place + own + common
            for place, own, common in zip(self._place_m, error, shared, strict=True)
        )
        lat_deg, lon_deg, alt_m = self._frame.geodetic_from_map(east, north, up)
        known_lat_deg, known_lon_deg, known_alt_m = self._known
        return BaseFix(
            t_s=t_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            pos_std_m=self._std_m,
            known_lat_deg=known_lat_deg,
            known_lon_deg=known_lon_deg,
            known_alt_m=known_alt_m,
            velocity_mps=self._velocity(dt_s) if self._velocity is not None else None,
        )


def _find_place(world: WorldSpec) -> Vec3:
    for obstacle in world.obstacles:
        if obstacle.name in POLES:
            return obstacle.x_map_m, obstacle.y_map_m, obstacle.z_map_m + ANTENNA_HEIGHT_M
    return 0.0, 0.0, ANTENNA_HEIGHT_M


def _make_velocity(errors: HectorGnss | PhysicalGnss, seed: int) -> ErrorStep | None:
    """Make the velocity of a standing receiver, None for one that does not report velocity."""
    if isinstance(errors, HectorGnss):
        std_mps = errors.velocity_gaussian_mps
    elif errors.has_velocity:
        std_mps = errors.velocity_std_mps
    else:
        return None
    return HectorNoise(make_stream(seed, "base station velocity"), 0.0, 0.0, std_mps).step


def _make_hector_step(errors: HectorGnss, seed: int, is_common: bool) -> ErrorStep:
    drift_m = 0.0 if is_common else errors.drift_m
    rng = make_stream(seed, "base station")
    return HectorNoise(rng, drift_m, errors.drift_frequency_hz, errors.gaussian_m).step


def _make_physical_step(errors: PhysicalGnss, seed: int, is_common: bool) -> ErrorStep:
    ratio = errors.vertical_ratio
    wanders = [
        GaussMarkov(
            make_stream(seed, f"base station wander {index}"),
            (wander.std_m, wander.std_m, ratio * wander.std_m),
            wander.tau_s,
        )
        for index, wander in enumerate(errors.wander)
        if not (is_common and wander.common)
    ]
    normal = NormalRows(make_stream(seed, "base station"), 3)
    white = (errors.white_std_m, errors.white_std_m, ratio * errors.white_std_m)

    def step(dt_s: float) -> Vec3:
        terms = [wander.step(dt_s) for wander in wanders]
        x, y, z = (
            std * n + sum(term[axis] for term in terms)
            for axis, (std, n) in enumerate(zip(white, normal.take(1)[0].tolist(), strict=True))
        )
        return x, y, z

    return step
