"""What a simulated robot and a figure in its way did, by the truth of the simulator."""

from __future__ import annotations

import msgspec


class Encounter(msgspec.Struct, frozen=True, kw_only=True):
    """An encounter with a figure that stepped into the way of a simulated robot.

    It was aimed at `ahead_m` from the robot's front, at `speed_mps`, and stayed for `stays_s`.
    `robot_mps` is the robot's speed as it began, `nearest_m` the smallest distance between the
    outlines, `stood_m` that at which the robot came to stand, null where it did not. `touched_mps`
    is the robot's speed at the first touch, null without one, and `touched_ahead_m` how far ahead
    of the robot's middle that of the figure was then.
    """

    figure: str
    begin_s: float
    end_s: float
    ahead_m: float
    speed_mps: float
    stays_s: float
    robot_mps: float
    nearest_m: float
    stood_m: float | None = None
    touched_mps: float | None = None
    touched_ahead_m: float | None = None
