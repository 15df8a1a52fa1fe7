"""Named sets of sensor errors, one TOML file each in the folder `presets`.

A file may state only what differs from that of another preset, which `like` names.
"""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any, Literal

import msgspec

from agribot.core.errors import ConfigError
from agribot.core.messages import GnssQuality
from agribot.core.suggestions import suggest_name


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the preset structs."""


class HectorGnss(Settings, frozen=True, kw_only=True, tag_field="model", tag="hector"):
    """The error model of the original GPS plugin; no latency."""

    rate_hz: float | None = None
    drift_m: float
    drift_frequency_hz: float = 1.0 / 3600.0
    gaussian_m: float = 0.0
    velocity_gaussian_mps: float = 0.0


class Wander(Settings, frozen=True, kw_only=True):
    """A slow error: Gauss-Markov with this standard deviation per horizontal axis.

    A `common` one comes from orbits and atmosphere: a base station near by can share it.
    """

    std_m: float
    tau_s: float
    common: bool = False


class Steps(Settings, frozen=True, kw_only=True):
    """Steps of the position when satellites or reflections come and go.

    They come after exponential times, with this standard deviation per horizontal axis, and
    fade with `tau_s`.
    """

    mean_gap_s: float
    std_m: float
    tau_s: float


class FloatOutages(Settings, frozen=True, kw_only=True):
    """Spells without integer ambiguities: exponential gaps, uniform durations."""

    mean_gap_s: float
    min_duration_s: float
    max_duration_s: float
    std_m: float
    tau_s: float


class HeadingErrors(Settings, frozen=True, kw_only=True):
    """Errors of the heading from a second antenna."""

    rate_hz: float = 10.0
    std_rad: float


class PhysicalGnss(Settings, frozen=True, kw_only=True, tag_field="model", tag="physical"):
    """A receiver; the vertical errors are `vertical_ratio` times the horizontal ones."""

    rate_hz: float | None = None
    quality: GnssQuality
    reported_std_m: float
    white_std_m: float = 0.0
    wander: tuple[Wander, ...] = ()
    steps: Steps | None = None
    velocity_std_mps: float = 0.0
    has_velocity: bool = True
    vertical_ratio: float = 1.8
    latency_s: float = 0.0
    outages: FloatOutages | None = None
    heading: HeadingErrors | None = None


class ImuErrors(Settings, frozen=True, kw_only=True):
    """Densities are one-sided, per square root of hertz; biases are drawn once per run."""

    rate_hz: float | None = None
    gyro_noise_radps_per_sqrt_hz: float = 0.0
    gyro_bias_std_radps: float = 0.0
    gyro_walk_radps_per_sqrt_s: float = 0.0
    gyro_scale_std_ratio: float = 0.0
    accel_noise_mps2_per_sqrt_hz: float = 0.0
    accel_bias_std_mps2: float = 0.0
    accel_walk_mps2_per_sqrt_s: float = 0.0
    accel_scale_std_ratio: float = 0.0


class HectorMag(Settings, frozen=True, kw_only=True, tag_field="model", tag="hector"):
    """The original magnetometer: errors relative to the field's magnitude, own inclination."""

    rate_hz: float | None = None
    drift_ratio: float
    drift_frequency_hz: float
    gaussian_ratio: float
    inclination_deg: float = 60.0
    declination_deg: float = 0.0


class PhysicalMag(Settings, frozen=True, kw_only=True, tag_field="model", tag="physical"):
    """Errors that remain after calibration, T; motor currents add a field along a fixed axis."""

    rate_hz: float | None = None
    noise_std_t: float = 0.0
    hard_iron_std_t: float = 0.0
    soft_iron_std_ratio: float = 0.0
    misalignment_std_rad: float = 0.0
    motor_field_std_t_per_nm: float = 0.0


class WheelErrors(Settings, frozen=True, kw_only=True):
    """Encoders; `quantised` rounds down to whole ticks of the robot's encoder."""

    rate_hz: float = 100.0
    quantised: bool = True


class SensorPreset(Settings, frozen=True, kw_only=True):
    about: str
    gnss: HectorGnss | PhysicalGnss
    imu: ImuErrors = ImuErrors()
    mag: HectorMag | PhysicalMag | Literal["none"] = PhysicalMag()
    wheels: WheelErrors = WheelErrors()


def list_presets() -> list[str]:
    return _list_names("presets")


def load_preset(name: str) -> SensorPreset:
    """Read a preset.

    Raises: ConfigError: no preset has this name.
    """
    return msgspec.convert(_read_preset("presets", name, "sim.sensors"), SensorPreset)


def list_imus() -> list[str]:
    return _list_names("imu_presets")


def load_imu(name: str) -> ImuErrors:
    """Read the errors of an IMU.

    Raises: ConfigError: no IMU has this name.
    """
    return msgspec.convert(_read_preset("imu_presets", name, "sim.imu"), ImuErrors)


def _list_names(folder: str) -> list[str]:
    files = resources.files("agribot.sim.sensors") / folder
    return sorted(p.name.removesuffix(".toml") for p in files.iterdir())


def _read_preset(folder: str, name: str, setting: str) -> dict[str, Any]:
    known = _list_names(folder)
    if name not in known:
        hint = suggest_name(name, known)
        raise ConfigError(
            f"{setting}: unknown sensor preset '{name}'{hint}; known: {', '.join(known)}"
        )
    path = resources.files("agribot.sim.sensors") / folder / f"{name}.toml"
    read = tomllib.loads(path.read_text(encoding="utf-8"))
    base = read.pop("like", "")
    return {**_read_preset(folder, base, setting), **read} if base else read
