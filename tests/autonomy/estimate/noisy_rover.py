"""A skidding rover on paper: truth and noisy samples for the filter tests, nothing of the filter.

Truth is stepped at 100 Hz: the wheels reach the commanded twist with a lag, the ground takes a
share of it, yaw gain and side slip wander, and a slope pushes to one side of the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agribot.core.config import FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    FloatArray,
    GnssFix,
    GnssQuality,
    ImuSample,
    MagSample,
    WheelSample,
)
from tests.autonomy.estimate.paper_robot import HALF_TRACK_M, RADIUS_M, YAW_MULTIPLIER

DT_S = 0.01
GRAVITY_MPS2 = 9.8
HORIZONTAL_T, VERTICAL_T = 3.8e-5, -2.3e-5
Drive = Callable[[float], tuple[float, float]]
Grip = Callable[[float], float]
Slide = Callable[[float], float]


class Errors(msgspec.Struct, frozen=True, kw_only=True):
    """Standard deviations, drawn once per recording where nothing else is said."""

    gnss_hz: float = 10.0
    latency_s: float = 0.1
    quality: GnssQuality = GnssQuality.RTK_FIXED
    pos_std_m: float = 0.014
    white_m: float = 0.008
    wander: tuple[tuple[float, float], ...] = ((0.01, 60.0),)  # std in m, memory in s
    velocity_mps: float = 0.03
    gyro_bias_radps: float = 8.7e-4
    gyro_noise_radps: float = 2.5e-3  # per sample at 200 Hz
    gyro_scale_ratio: float = 0.005
    mag_noise_rad: float = 0.026
    hard_iron_rad: float = 0.07
    slip_max_ratio: float = 0.06
    slope_rad: float = 0.026
    yaw_gain_ratio: float = 0.08


RTK = Errors()
M8N = Errors(
    gnss_hz=5.0,
    latency_s=0.15,
    quality=GnssQuality.SINGLE,
    pos_std_m=1.3,
    white_m=0.05,
    wander=((1.2, 400.0), (0.25, 30.0)),
    velocity_mps=0.05,
)
QUIET = Errors(
    white_m=0.0, wander=(), velocity_mps=0.0, gyro_bias_radps=0.0, gyro_noise_radps=0.0,
    gyro_scale_ratio=0.0, mag_noise_rad=0.0, hard_iron_rad=0.0, slip_max_ratio=0.0,
    slope_rad=0.0, yaw_gain_ratio=0.0,
)  # fmt: skip


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    """`truth` is (N, 4): t_s, x_map_m, y_map_m, yaw_map_rad; fixes carry their arrival time."""

    truth: FloatArray
    wheels: Sequence[WheelSample]
    imu: Sequence[ImuSample]
    mag: Sequence[MagSample]
    fixes: Sequence[tuple[float, GnssFix]]
    gyro_bias_radps: float = 0.0

    def pose(self, t_s: float) -> tuple[float, float, float]:
        _, x, y, yaw = self.truth[min(round(t_s / DT_S), len(self.truth) - 1)].tolist()
        return x, y, yaw


def stand(t_s: float) -> tuple[float, float]:
    return 0.0, 0.0


def rows(t_s: float) -> tuple[float, float]:
    """Three seconds standing, then 12 s straight and a half circle, alternating sides."""
    t_s -= 3.0
    if t_s < 0.0:
        return 0.0, 0.0
    turn_s = math.pi / 0.6
    lap, t_s = divmod(t_s, 12.0 + turn_s)
    return (0.4, 0.0) if t_s < 12.0 else (0.3, 0.6 * (-1.0) ** lap)


def full_grip(t_s: float) -> float:
    return 1.0


def no_slide(t_s: float) -> float:
    return 0.0


def record(
    drive: Drive,
    duration_s: float,
    seed: int = 0,
    errors: Errors = RTK,
    start: tuple[float, float, float] = (1.0, 2.0, math.pi / 2),
    antenna_body_m: tuple[float, float, float] = (0.0, 0.0, 0.6),
    grip: Grip = full_grip,
    slide_mps: Slide = no_slide,
) -> Recording:
    """Drive and write down everything; the slope falls across rows that run North.

    `grip` is the share of the wheels' motion that reaches the ground, `slide_mps` how fast the
    ground lets the robot slide to its left besides.
    """
    rng = np.random.default_rng(seed)
    truth, twist, wheels = _motion(drive, duration_s, errors, start, grip, slide_mps, rng)
    bias_radps = errors.gyro_bias_radps * rng.standard_normal()
    return Recording(
        truth=truth,
        wheels=wheels,
        imu=_imu(twist, errors, bias_radps, rng),
        mag=_mag(truth, errors, rng),
        fixes=_fixes(truth, twist, errors, antenna_body_m, rng),
        gyro_bias_radps=bias_radps,
    )


def _motion(
    drive: Drive,
    duration_s: float,
    errors: Errors,
    start: tuple[float, float, float],
    grip: Grip,
    slide_mps: Slide,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, list[WheelSample]]:
    """Truth (N, 4), twist (N, 3) forward, left, yaw rate of the step that ends there, encoders."""
    count = round(duration_s / DT_S) + 1
    lost, turned = errors.slip_max_ratio, errors.yaw_gain_ratio
    loss = (rng.uniform(0.0, lost) + _wander(lost / 3.0, 5.0, count, rng)).tolist()
    gain = (turned * rng.standard_normal() + _wander(turned / 2.0, 3.0, count, rng)).tolist()
    slope_rad = errors.slope_rad * rng.uniform(-1.5, 1.5)
    half_m = HALF_TRACK_M * YAW_MULTIPLIER
    x, y, yaw = start
    v = w = left_rad = right_rad = 0.0
    truth, twist, wheels = np.zeros((count, 4)), np.zeros((count, 3)), []
    for k in range(count):
        t_s = k * DT_S
        if k:
            v_goal, w_goal = drive(t_s)
            v = _approach(v, v_goal, 1.5)
            w = _approach(w, w_goal, 4.0)
            held = grip(t_s)
            forward, rate = held * v * (1.0 - loss[k]), held * w * (1.0 + gain[k])
            left = slope_rad * abs(forward) * math.sin(yaw) + slide_mps(t_s)
            middle = yaw + rate * DT_S / 2.0
            x += (forward * math.cos(middle) - left * math.sin(middle)) * DT_S
            y += (forward * math.sin(middle) + left * math.cos(middle)) * DT_S
            yaw += rate * DT_S
            twist[k] = forward, left, rate
        truth[k] = t_s, x, y, math.remainder(yaw, math.tau)
        left_radps, right_radps = (v - w * half_m) / RADIUS_M, (v + w * half_m) / RADIUS_M
        left_rad += left_radps * DT_S
        right_rad += right_radps * DT_S
        wheels.append(
            WheelSample(
                t_s=t_s,
                angle_rad=(right_rad, left_rad, right_rad, left_rad),
                speed_radps=(right_radps, left_radps, right_radps, left_radps),
            )
        )
    return truth, twist, wheels


def _approach(value: float, goal: float, limit: float) -> float:
    return value + max(-limit, min(limit, (goal - value) / 0.15)) * DT_S


def _wander(std: float, memory_s: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Gauss-Markov process sampled at 100 Hz."""
    decay = math.exp(-DT_S / memory_s)
    noise = (std * rng.standard_normal(count)).tolist()
    values = [noise[0]]
    for sample in noise[1:]:
        values.append(decay * values[-1] + math.sqrt(1.0 - decay * decay) * sample)
    return np.array(values)


def _imu(
    twist: FloatArray, errors: Errors, bias_radps: float, rng: np.random.Generator
) -> list[ImuSample]:
    scale = 1.0 + errors.gyro_scale_ratio * rng.standard_normal()
    noise = (errors.gyro_noise_radps * rng.standard_normal((2 * len(twist), 3))).tolist()
    samples = []
    for k, (forward, _, rate) in enumerate(twist.tolist()):
        for half in (1, 0):
            nx, ny, nz = noise[2 * k + half]
            samples.append(
                ImuSample(
                    t_s=k * DT_S - half * DT_S / 2.0,
                    gyro_radps=(nx, ny, rate * scale + bias_radps + nz),
                    accel_mps2=(0.0, forward * rate, GRAVITY_MPS2),
                )
            )
    return samples[1:]


def _mag(truth: FloatArray, errors: Errors, rng: np.random.Generator) -> list[MagSample]:
    """5 Hz. Hard iron is a fixed field of the robot, given as the heading error it makes."""
    iron_t = HORIZONTAL_T * errors.hard_iron_rad * rng.standard_normal(2)
    samples = []
    for t_s, _, _, yaw in truth[20::20].tolist():
        seen_rad = math.pi / 2.0 - yaw + errors.mag_noise_rad * rng.standard_normal()
        field_t = (
            HORIZONTAL_T * math.cos(seen_rad) + float(iron_t[0]),
            HORIZONTAL_T * math.sin(seen_rad) + float(iron_t[1]),
            VERTICAL_T,
        )
        samples.append(MagSample(t_s=t_s, field_t=field_t))
    return samples


def _fixes(
    truth: FloatArray,
    twist: FloatArray,
    errors: Errors,
    antenna_body_m: tuple[float, float, float],
    rng: np.random.Generator,
) -> list[tuple[float, GnssFix]]:
    frame = MapFrame(FieldConfig().datum)
    count, every = len(truth), round(1.0 / (errors.gnss_hz * DT_S))
    east, north = np.zeros(count), np.zeros(count)
    for std_m, memory_s in errors.wander:
        east += _wander(std_m, memory_s, count, rng)
        north += _wander(std_m, memory_s, count, rng)
    ax, ay, az = antenna_body_m
    fixes = []
    for k in range(every, count, every):
        t_s, x, y, yaw = truth[k].tolist()
        forward, left, rate = twist[k].tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        vx, vy = forward - rate * ay, left + rate * ax
        n = rng.standard_normal(5).tolist()
        lat_deg, lon_deg, alt_m = frame.geodetic_from_map(
            x + cos * ax - sin * ay + float(east[k]) + errors.white_m * n[0],
            y + sin * ax + cos * ay + float(north[k]) + errors.white_m * n[1],
            az,
        )
        fix = GnssFix(
            t_s=t_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            pos_std_m=errors.pos_std_m,
            quality=errors.quality,
            velocity_mps=(
                cos * vx - sin * vy + errors.velocity_mps * n[2],
                sin * vx + cos * vy + errors.velocity_mps * n[3],
                0.0,
            ),
            velocity_std_mps=max(errors.velocity_mps, 0.02),
        )
        fixes.append((t_s + errors.latency_s, fix))
    return fixes
