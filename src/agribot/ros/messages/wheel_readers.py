"""Readers of what other nodes publish of the wheels: of joints, or of the base's twist alone.

By the definition of JointState its arrays may be empty, and nodes of ros2_control write NaN for
what a joint does not report: speeds then follow from the angles, or the angles from the speeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.messages import WHEEL_NAMES, Four, WheelSample
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.messages.transforms import find_wheel_joints

LONGEST_STEP_S = 1.0  # longest step between messages, to integrate or to differentiate over


class JointReader:
    """Reads the four wheels by the names of their joints, or of their links."""

    def __init__(self, robot: RobotSpec) -> None:
        joints = find_wheel_joints(robot, WHEEL_NAMES)
        self._names = tuple(joint.name for joint in joints) or WHEEL_NAMES
        self._steps = _Steps("a JointState of positions or velocities alone and")
        self._angles_rad: Four | None = None

    def __call__(self, message: Any, t_s: float) -> WheelSample | None:
        at = {name: index for index, name in enumerate(message.name)}
        if not all(name in at for name in self._names):
            raise BridgeError(f"joints {', '.join(message.name)}; send all of {self._names}")
        angles_rad = self._pick_wheels(message.position, at, "positions")
        speeds_radps = self._pick_wheels(message.velocity, at, "velocities")
        if angles_rad is not None and speeds_radps is not None:
            return WheelSample(t_s=t_s, angle_rad=angles_rad, speed_radps=speeds_radps)
        passed_s = self._steps.measure_s(message.header.stamp)
        if speeds_radps is not None:
            angles_rad = _integrate(self._angles_rad or (0.0,) * 4, speeds_radps, passed_s)
        elif angles_rad is not None and self._angles_rad is not None and passed_s:
            speeds_radps = _differentiate(self._angles_rad, angles_rad, passed_s)
        elif angles_rad is None:
            raise BridgeError("joints with neither positions nor velocities; send one of them")
        self._angles_rad = angles_rad
        if speeds_radps is None:
            return None
        return WheelSample(t_s=t_s, angle_rad=angles_rad, speed_radps=speeds_radps)

    def _pick_wheels(
        self, values: Sequence[float], at: Mapping[str, int], what: str
    ) -> Four | None:
        """Pick those of the wheels; None where the message has none of them."""
        if not len(values):
            return None
        if len(values) < len(at):
            raise BridgeError(f"{len(values)} {what} for {len(at)} joints; send one for each")
        a, b, c, d = (float(values[at[name]]) for name in self._names)
        if all(map(math.isnan, (a, b, c, d))):
            return None
        if not math.isfinite(a + b + c + d):
            raise BridgeError(f"{what} {(a, b, c, d)} are not all finite; send finite numbers")
        return (a, b, c, d)


class TwistReader:
    """Computes the wheels' rotation of a base that publishes its twist but not its wheels."""

    def __init__(self, drive: DriveSpec) -> None:
        self._drive = drive
        self._angles_rad: Four = (0.0, 0.0, 0.0, 0.0)
        self._steps = _Steps("odometry")

    def __call__(self, message: Any, t_s: float) -> WheelSample:
        twist = message.twist.twist
        v_mps, yaw_rate_radps = float(twist.linear.x), float(twist.angular.z)
        if not math.isfinite(v_mps + yaw_rate_radps):
            raise BridgeError(
                f"a twist of {v_mps} m/s and {yaw_rate_radps} rad/s is not finite; send finite "
                "numbers"
            )
        left, right = self._drive.wheel_speeds_radps(v_mps, yaw_rate_radps)
        speeds_radps = (right, left, right, left)
        passed_s = self._steps.measure_s(message.header.stamp)
        self._angles_rad = _integrate(self._angles_rad, speeds_radps, passed_s)
        return WheelSample(t_s=t_s, angle_rad=self._angles_rad, speed_radps=speeds_radps)


class _Steps:
    """The times between messages by their stamps."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._last_s: float | None = None

    def measure_s(self, stamp: Any) -> float:
        """Measure the time since the last message; 0 where it cannot be integrated over."""
        stamp_s = to_seconds(stamp)
        if stamp_s == 0.0:
            raise BridgeError(f"{self._what} without a stamp state no distance; set the stamp")
        passed_s = 0.0 if self._last_s is None else stamp_s - self._last_s
        self._last_s = stamp_s
        return passed_s if 0.0 < passed_s < LONGEST_STEP_S else 0.0


def _integrate(angles_rad: Sequence[float], speeds_radps: Four, passed_s: float) -> Four:
    a, b, c, d = (
        angle + speed * passed_s for angle, speed in zip(angles_rad, speeds_radps, strict=True)
    )
    return a, b, c, d


def _differentiate(before_rad: Four, after_rad: Four, passed_s: float) -> Four:
    a, b, c, d = (
        (after - before) / passed_s for before, after in zip(before_rad, after_rad, strict=True)
    )
    return a, b, c, d
