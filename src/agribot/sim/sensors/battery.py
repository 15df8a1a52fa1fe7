"""Battery: voltage and charge under the load of motors and electronics.

The pack is an assumption, the original robot's is not documented: six lithium-ion cells in
series, 10 Ah. Electronics: a small single-board computer, camera and receivers. What the motors
draw follows from their current: torque over the torque constant, and heat in winding, gear and
controller.
"""

from __future__ import annotations

from agribot.core.messages import BatterySample, FloatArray
from agribot.sim.state import DRAWN

BATTERY_RATE_HZ = 1.0
CAPACITY_J = 22.2 * 10.0 * 3600.0
FULL_V, EMPTY_V = 25.2, 18.0
RESISTANCE_OHM = 0.05
ELECTRONICS_W = 15.0


class Battery:
    def __init__(self) -> None:
        self._charge_ratio = 1.0
        self._drawn_j = 0.0
        self._t_s = 0.0

    def sample(self, t_s: float, row: FloatArray) -> BatterySample:
        """Return the reading for one row of the history; power is the mean since the last."""
        drawn_j = float(row[DRAWN][0])
        dt_s = t_s - self._t_s
        used_j = drawn_j - self._drawn_j + ELECTRONICS_W * dt_s
        self._drawn_j, self._t_s = drawn_j, t_s
        self._charge_ratio = min(1.0, max(0.0, self._charge_ratio - used_j / CAPACITY_J))
        open_v = EMPTY_V + (FULL_V - EMPTY_V) * self._charge_ratio
        current_a = used_j / dt_s / open_v
        return BatterySample(
            t_s=t_s,
            voltage_v=open_v - RESISTANCE_OHM * current_a,
            current_a=current_a,
            charge_ratio=self._charge_ratio,
        )
