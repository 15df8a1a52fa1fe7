"""Error processes shared by the sensors, stepped with plain floats at sensor rate."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import Vec3
from agribot.sim.random_streams import NormalRows


class HectorNoise:
    """Three-axis error of the hector_gazebo sensor model: drift plus Gaussian noise.

    The drift's noise scales with the interval, not with its square root, as in the original:
    at 5 Hz a drift of 5 m walks 0.0236 m per sample. It starts at N(0, drift), not at zero.
    Source: hector_gazebo_plugins, sensor_model.h (kinetic, melodic).
    """

    def __init__(
        self, rng: np.random.Generator, drift: float, drift_frequency_hz: float, gaussian: float
    ) -> None:
        self._rows = NormalRows(rng, 6)
        self._frequency_hz = drift_frequency_hz
        self._walk = math.sqrt(2.0 * drift_frequency_hz) * drift
        self._gaussian = gaussian
        self._drift: list[float] = (drift * self._rows.take(1)[0, :3]).tolist()

    @property
    def drift(self) -> Vec3:
        """The slow part of the last error."""
        x, y, z = self._drift
        return x, y, z

    def step(self, dt_s: float) -> Vec3:
        decay = math.exp(-dt_s * self._frequency_hz)
        normal = self._rows.take(1)[0].tolist()
        drift = self._drift
        for axis in range(3):
            drift[axis] = decay * drift[axis] + dt_s * self._walk * normal[axis]
        white = self._gaussian
        return (
            drift[0] + white * normal[3],
            drift[1] + white * normal[4],
            drift[2] + white * normal[5],
        )


class GaussMarkov:
    """Exponentially correlated three-axis error with a stationary standard deviation."""

    def __init__(self, rng: np.random.Generator, std: Vec3, tau_s: float) -> None:
        self._rows = NormalRows(rng, 3)
        self._std = std
        self._tau_s = tau_s
        self._value = [0.0, 0.0, 0.0]
        self.restart()

    def restart(self) -> None:
        """Draw a new value that owes nothing to the last one."""
        normal = self._rows.take(1)[0].tolist()
        self._value = [std * n for std, n in zip(self._std, normal, strict=True)]

    @property
    def value(self) -> Vec3:
        """The last error."""
        x, y, z = self._value
        return x, y, z

    def step(self, dt_s: float) -> Vec3:
        decay = math.exp(-dt_s / self._tau_s)
        gain = math.sqrt(1.0 - decay * decay)
        normal = self._rows.take(1)[0].tolist()
        value, std = self._value, self._std
        for axis in range(3):
            value[axis] = decay * value[axis] + gain * std[axis] * normal[axis]
        return (value[0], value[1], value[2])
