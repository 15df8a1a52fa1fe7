"""The torque that faults of motors leave, with simulated motors and with real firmware."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from agribot.core.messages import WHEEL_NAMES
from agribot.sim.random_streams import make_stream

if TYPE_CHECKING:
    from agribot.sim.faults.schedule import Fault


def draw_weak_wheel(seed: int) -> str:
    """Draw the wheel whose motor has `motor.weak`."""
    weak = make_stream(seed, "fault motor.weak")
    return WHEEL_NAMES[int(weak.integers(len(WHEEL_NAMES)))]


def list_torque_shares(on: Iterable[Fault], t_s: float, weak_wheel: str) -> dict[str, float]:
    """List what share of its torque each motor has left under the faults that are on at a time."""
    shares = dict.fromkeys(WHEEL_NAMES, 1.0)
    for fault in on:
        if fault.name == "motor.dead":
            shares[fault.wheel] = 0.0
        if fault.name == "motor.weak":
            shares[weak_wheel] = min(shares[weak_wheel], fault.find_number(t_s))
    return shares
