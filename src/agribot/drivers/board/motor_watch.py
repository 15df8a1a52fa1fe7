"""Do the motors draw what their duty and their speed call for? Which torque does that make?

A motor is V = R I + k w. One that lets nothing through, or little, is carried along by the others
while its controller gives it more voltage than they need, or less than their speed makes of
itself: its current then lacks what the difference would drive. A wheel that stands or turns against
its duty is for those to judge who watch the wheels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.messages import WHEEL_NAMES, Four
from agribot.core.robot import DriveSpec

# Step of a converter of 10 bits and 0.1 V/A; readings are cut off to whole steps.
SENSOR_STEP_A = 0.049
MOST_SENSED_A = 25.0
# Uncertainty of a motor's data: 15 % of its constant, more than a third of its winding with cable
# and driver. Currents of friction and steps of the duty are missing in them.
CONSTANT_RATIO, LEFT_RATIO, LEAST_A = 0.15, 1.0 / 3.0, 1.0
TURNING_RADPS = 0.6
LASTING_S, LONGEST_STEP_S = 0.3, 0.05


class MotorWatch:
    """Follows the four motors of one board, in the order of WHEEL_NAMES."""

    def __init__(self, drive: DriveSpec, constant_vps: float, winding_ohm: float) -> None:
        """`constant_vps` is the voltage of a motor for each rad/s of its wheel, and its Nm/A."""
        self._winding_ohm, self._gear_ratio = winding_ohm, drive.gear_efficiency_ratio
        self._constant_vps = constant_vps
        self._lacking_s = [0.0] * 4
        self._can_brake = False  # whether the drivers let a motor brake is seen, not known
        self._t_s = math.inf

    def update(
        self, t_s: float, supply_v: float, duty: Sequence[float], speed_radps: Sequence[float],
        current_a: Sequence[float],
    ) -> tuple[str, ...]:  # fmt: skip
        """Name the wheels whose motors draw far too little for a while; `t_s` is the board's."""
        step_s = min(max(t_s - self._t_s, 0.0), LONGEST_STEP_S)
        self._t_s = t_s
        for k, (share, speed, amperes) in enumerate(zip(duty, speed_radps, current_a, strict=True)):
            expected_a = self._expect_a(share * supply_v, speed)
            is_lacking = amperes < LEFT_RATIO * abs(expected_a)
            self._can_brake |= expected_a < 0.0 and not is_lacking
            is_judged = expected_a > 0.0 or self._can_brake
            self._lacking_s[k] = self._lacking_s[k] + step_s if is_lacking and is_judged else 0.0
        return tuple(
            name
            for name, lacking_s in zip(WHEEL_NAMES, self._lacking_s, strict=True)
            if lacking_s > LASTING_S
        )

    def torques_nm(
        self, supply_v: float, duty: Sequence[float], speed_radps: Sequence[float],
        current_a: Sequence[float],
    ) -> Four:  # fmt: skip
        """Read the torques at the wheels out of currents that have no sign of their own."""
        a, b, c, d = (
            self._torque_nm(share * supply_v - self._constant_vps * speed, speed, amperes)
            for share, speed, amperes in zip(duty, speed_radps, current_a, strict=True)
        )
        return a, b, c, d

    def _expect_a(self, voltage_v: float, speed_radps: float) -> float:
        """Return what flows at the least through a motor, below 0 where it brakes; else 0."""
        if voltage_v * speed_radps <= 0.0 or abs(speed_radps) < TURNING_RADPS:
            return 0.0
        own_v = self._constant_vps * abs(speed_radps)
        left_v = abs(voltage_v) - own_v
        sure_v = max(abs(left_v) - CONSTANT_RATIO * own_v, 0.0)
        amperes = min(sure_v / self._winding_ohm, MOST_SENSED_A)
        return math.copysign(amperes, left_v) if amperes > LEAST_A else 0.0

    def _torque_nm(self, left_v: float, speed_radps: float, amperes: float) -> float:
        """`left_v` drives the current, so that it has its sign."""
        if left_v == 0.0:
            return 0.0
        torque_nm = math.copysign(self._constant_vps * (amperes + SENSOR_STEP_A / 2.0), left_v)
        return torque_nm * self._gear_ratio if torque_nm * speed_radps >= 0.0 else torque_nm
