"""Errors that are set while the simulation runs, in addition to those of the preset."""

from __future__ import annotations

import numpy as np

from agribot.core.errors import ConfigError, describe_range
from agribot.core.messages import Vec3
from agribot.core.suggestions import suggest_name
from agribot.sim.sensors.noise import HectorNoise

# Parameters as hector's sensors name them, with the values that change nothing.
NEUTRAL = {
    "gaussian_noise": 0.0,
    "offset": 0.0,
    "drift": 0.0,
    "drift_frequency": 1.0 / 3600.0,
    "scale_error": 1.0,
}
# Sensors that can be tuned, and their units.
SENSORS = {
    "gnss": "m",
    "gnss_velocity": "m/s",
    "accel": "m/s^2",
    "gyro": "rad/s",
    "mag": "T",
}

# Largest noise, offset and drift of a sensor, in its unit: beyond it no receiver or chip is in use.
LARGEST = {"gnss": 100.0, "gnss_velocity": 10.0, "accel": 50.0, "gyro": 10.0, "mag": 1.0}
FASTEST_DRIFT_HZ = 100.0
LARGEST_SCALE = 10.0  # largest scale error, to both sides


def find_range(sensor: str, parameter: str) -> tuple[float, float]:
    """Find the smallest and the largest value of a parameter; both are allowed."""
    largest = LARGEST[sensor]
    return {
        "offset": (-largest, largest),
        "scale_error": (-LARGEST_SCALE, LARGEST_SCALE),
        "drift_frequency": (0.0, FASTEST_DRIFT_HZ),
    }.get(parameter, (0.0, largest))


class Tuning:
    """The same error on three axes: `value * scale_error + offset + drift + noise`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._values = dict(NEUTRAL)
        self._is_active = False
        self._noise = HectorNoise(rng, 0.0, 0.0, 0.0)
        self._t_s = 0.0

    def set(self, parameter: str, value: float) -> None:
        """Set a parameter from the next sample on; the drift starts anew at N(0, drift)."""
        self._values[parameter] = value
        self._is_active = self._values != NEUTRAL
        values = self._values
        self._noise = HectorNoise(
            self._rng, values["drift"], values["drift_frequency"], values["gaussian_noise"]
        )

    def shift(self, bias: Vec3) -> Vec3:
        """Return a bias with the offset and the drift that were added to it."""
        if not self._is_active:
            return bias
        offset, drift = self._values["offset"], self._noise.drift
        return bias[0] + offset + drift[0], bias[1] + offset + drift[1], bias[2] + offset + drift[2]

    def apply(self, t_s: float, value: Vec3) -> Vec3:
        if not self._is_active:
            return value
        dt_s, self._t_s = max(t_s - self._t_s, 0.0), t_s
        scale, offset = self._values["scale_error"], self._values["offset"]
        x, y, z = self._noise.step(dt_s)
        return (
            value[0] * scale + offset + x,
            value[1] * scale + offset + y,
            value[2] * scale + offset + z,
        )


def check_tuning(sensor: str, parameter: str, value: float) -> None:
    """Check the names and the value of an error.

    Raises: ConfigError: unknown name, or a value that the parameter cannot have.
    """
    for what, name, known in (
        ("sensor", sensor, list(SENSORS)),
        ("parameter", parameter, list(NEUTRAL)),
    ):
        if name not in known:
            hint = suggest_name(name, known)
            raise ConfigError(f"tuning: unknown {what} '{name}'{hint}; known: {', '.join(known)}")
    if not np.isfinite(value):
        raise ConfigError(
            f"tuning {sensor} {parameter} = {value}: not finite; write a finite number"
        )
    smallest, largest = find_range(sensor, parameter)
    if value < 0.0 == smallest:
        raise ConfigError(f"tuning {sensor} {parameter} = {value}: negative; give 0 or more")
    if not smallest <= value <= largest:
        unit = {"drift_frequency": "Hz", "scale_error": "times"}.get(parameter, SENSORS[sensor])
        raise ConfigError(
            f"tuning {sensor} {parameter} = {value:g}: {describe_range(smallest, largest, unit)}"
        )
