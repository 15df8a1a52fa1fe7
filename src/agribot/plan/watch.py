"""Looks after a drive along a route: has it strayed, does it get on, how near are plants."""

from __future__ import annotations

from agribot.config import MissionConfig
from agribot.messages import Estimate
from agribot.plan.caution import across_std_m, caution_ratio
from agribot.plan.route import Route
from agribot.plan.stall import StallWatch


class Watch:
    """Each method says in words what is wrong, and nothing where all is well."""

    def __init__(self, config: MissionConfig) -> None:
        self._stall = StallWatch(config.stall_timeout_s)
        self._limit_s = config.stall_timeout_s
        self.caution = 1.0  # share of its speed at which the robot drives here

    def restart(self) -> None:
        """The robot sets off anew."""
        self._stall.restart()

    def strayed(self, route: Route, estimate: Estimate, limit_m: float) -> str:
        x_map_m, y_map_m = estimate.x_map_m, estimate.y_map_m
        if route.progress.off_path_m <= limit_m:
            return ""
        off_m = route.progress.off_driven_path_m(x_map_m, y_map_m)
        if off_m <= limit_m:
            return ""
        return (
            f"off path by {off_m:.2f} m > {limit_m:.2f} m at East {x_map_m:.2f} m, North "
            f"{y_map_m:.2f} m; check the position source, then plan again from here"
        )

    def lost_row(self, route: Route, estimate: Estimate, config: MissionConfig) -> str:
        """In and next to the rows, no faster than the robot knows where the plants are."""
        std_m = across_std_m(estimate, route.yaw_map_rad)
        self.caution = caution_ratio(std_m, config)
        if self.caution > 0.0:
            return ""
        return (
            f"row lost: known across it to {std_m:.2f} m > {config.max_row_std_m:.2f} m; "
            "check camera and crop, or use a receiver with corrections"
        )

    def stalled(self, route: Route, t_s: float, reason: str) -> str:
        if not self._stall.is_stalled(route.progress.s_m, t_s):
            return ""
        where = f"after {route.progress.s_m:.1f} m of {route.progress.length_m:.1f} m"
        why = f" ({reason})" if reason else ""
        return f"no headway for {self._limit_s:g} s {where}{why}"

    def still_lost(self, t_s: float, reason: str) -> str:
        """The robot waits for its position."""
        if not self._stall.is_stalled(0.0, t_s):
            return ""
        return f"no position for {self._limit_s:g} s ({reason})"
