"""Magnetometer: the Earth's field in body axes, iron, motor currents and noise."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.geo import rotation_from_rpy
from agribot.core.messages import FloatArray, MagSample, Vec3
from agribot.core.pose import Pose2
from agribot.sim.attitude import read_rotation
from agribot.sim.random_streams import NormalRows
from agribot.sim.sensors.noise import HectorNoise
from agribot.sim.sensors.presets import HectorMag, PhysicalMag
from agribot.sim.sensors.tuning import Tuning
from agribot.sim.state import TORQUE


class Magnetometer:
    def __init__(
        self,
        errors: PhysicalMag,
        field_enu_t: Vec3,
        rng: np.random.Generator,
        tuning: Tuning | None = None,
    ) -> None:
        self._tuning = tuning
        self._field_t = np.array(field_enu_t)
        self._noise_t = errors.noise_std_t
        self._hard_t = errors.hard_iron_std_t * rng.standard_normal(3)
        soft = errors.soft_iron_std_ratio * rng.standard_normal((3, 3))
        roll, pitch, yaw = (errors.misalignment_std_rad * rng.standard_normal(3)).tolist()
        self._soft = (np.eye(3) + (soft + soft.T) / 2.0) @ rotation_from_rpy(roll, pitch, yaw)
        self._motor_t_per_nm = errors.motor_field_std_t_per_nm * rng.standard_normal(3)
        self._normal = NormalRows(rng, 3)

    def sample(self, t_s: float, row: FloatArray) -> MagSample:
        """Return the reading for one row of the physics history."""
        field_t = self._soft @ (read_rotation(row).T @ self._field_t) + self._hard_t
        field_t += self._motor_t_per_nm * row[TORQUE] + self._noise_t * self._normal.take(1)[0]
        x, y, z = field_t.tolist()
        field = (x, y, z)
        return MagSample(t_s=t_s, field_t=_apply_tuning(self._tuning, t_s, field))


class HectorMagnetometer:
    """The original plugin: same strength as the world's field, but its own direction."""

    def __init__(
        self,
        errors: HectorMag,
        field_enu_t: Vec3,
        rng: np.random.Generator,
        tuning: Tuning | None = None,
    ) -> None:
        self._tuning = tuning
        strength_t = math.sqrt(sum(axis * axis for axis in field_enu_t))
        dip = math.radians(errors.inclination_deg)
        east = math.radians(errors.declination_deg)
        self._field_t = strength_t * np.array(
            [math.cos(dip) * math.sin(east), math.cos(dip) * math.cos(east), -math.sin(dip)]
        )
        self._noise = HectorNoise(
            rng,
            errors.drift_ratio * strength_t,
            errors.drift_frequency_hz,
            errors.gaussian_ratio * strength_t,
        )
        self._t_s = 0.0

    def sample(self, t_s: float, row: FloatArray) -> MagSample:
        """Return the reading for one row of the physics history."""
        x, y, z = (read_rotation(row).T @ self._field_t).tolist()
        ex, ey, ez = self._noise.step(t_s - self._t_s)
        self._t_s = t_s
        field = (x + ex, y + ey, z + ez)
        return MagSample(t_s=t_s, field_t=_apply_tuning(self._tuning, t_s, field))


def turn_field(field_enu_t: Vec3, declination_deg: float) -> Vec3:
    """Turn the horizontal part of a field (east, north, up) towards East."""
    east, north, up = field_enu_t
    east, north = Pose2(0.0, 0.0, math.radians(declination_deg)).resolve(east, north)
    return east, north, up


def _apply_tuning(tuning: Tuning | None, t_s: float, field_t: Vec3) -> Vec3:
    return field_t if tuning is None else tuning.apply(t_s, field_t)
