"""The true state of the simulated robot; tests and metrics see it, the stack never does."""

from __future__ import annotations

import msgspec


class Truth(msgspec.Struct, frozen=True, kw_only=True):
    """The body frame in the map; `v_mps` is the velocity along the body's x axis."""

    t_s: float
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float
    v_mps: float
    yaw_rate_radps: float
    roll_rad: float
    pitch_rad: float
