"""What becomes of visitors, who step into the way of the robot: each begins when its time comes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.core.encounter import Encounter
from agribot.core.messages import MapPoint
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.core.world import Walker, Waypoint
from agribot.sim.truth import Truth
from agribot.sim.visitors import ASIDE_M, STANDING_MPS, Plan, Visitor
from agribot.sim.walkers import measure_gap_m, measure_outline, measure_robot_outline


class VisitLog:
    """Lets each visitor of a world begin at its time, and keeps what becomes of it."""

    def __init__(self, robot: RobotSpec, walkers: Sequence[Walker]) -> None:
        self._own = measure_robot_outline(robot)
        self._visitors = [walker for walker in walkers if isinstance(walker, Visitor)]
        self._outlines = [measure_outline(visitor.shapes) for visitor in self._visitors]
        self._visits: dict[int, Encounter] = {}

    @property
    def has_visitors(self) -> bool:
        return bool(self._visitors)

    @property
    def visits(self) -> tuple[Encounter, ...]:
        return tuple(self._visits.values())

    def update(self, truth: Truth) -> None:
        """Take in where the robot is after a tick."""
        for number, visitor in enumerate(self._visitors):
            if not visitor.way and truth.t_s >= visitor.plan.begin_s:
                self._begin(number, visitor, truth)
            if visitor.way and truth.t_s <= visitor.way[-1].t_s:
                self._visits[number] = self._follow(number, visitor, truth)

    def _begin(self, number: int, visitor: Visitor, truth: Truth) -> None:
        plan, front_m = visitor.plan, self._own.x_m + self._own.half_x_m
        ahead_m = front_m + plan.ahead_m + max(truth.v_mps, 0.0) * ASIDE_M / plan.speed_mps
        visitor.way.extend(_make_way(plan, truth, ahead_m))
        self._visits[number] = Encounter(
            figure=plan.figure, begin_s=truth.t_s, end_s=visitor.way[-1].t_s,
            ahead_m=plan.ahead_m, speed_mps=plan.speed_mps, stays_s=plan.stays_s,
            robot_mps=truth.v_mps, nearest_m=math.inf,
        )  # fmt: skip

    def _follow(self, number: int, visitor: Visitor, truth: Truth) -> Encounter:
        """Hold the visitor's place against the robot's."""
        visit, place = self._visits[number], visitor.find_place(truth.t_s)
        here = (truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        gap_m = measure_gap_m(here, self._own, place, self._outlines[number])
        stands, is_first = abs(truth.v_mps) < STANDING_MPS, visit.stood_m is None
        visit = msgspec.structs.replace(
            visit, nearest_m=min(visit.nearest_m, gap_m),
            stood_m=gap_m if stands and is_first else visit.stood_m,
        )  # fmt: skip
        if gap_m > 0.0 or visit.touched_mps is not None:
            return visit
        ahead_m = Pose2(*here).locate(*place[:2])[0]
        return msgspec.structs.replace(
            visit, touched_mps=abs(truth.v_mps), touched_ahead_m=float(ahead_m)
        )


def _make_way(plan: Plan, truth: Truth, ahead_m: float) -> list[Waypoint]:
    """Make the way across the robot's line, in the map and by the simulator's clock."""
    body = Pose2(truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
    yaw_rad = truth.yaw_map_rad - plan.side * math.pi / 2.0
    crosses_s = truth.t_s + ASIDE_M / plan.speed_mps
    leaves_s = crosses_s + plan.stays_s
    places: list[tuple[float, MapPoint]] = [
        (truth.t_s, body.transform(ahead_m, plan.side * ASIDE_M)),
        (crosses_s, body.transform(ahead_m, 0.0)),
        (leaves_s, body.transform(ahead_m, 0.0)),
        (leaves_s + ASIDE_M / plan.speed_mps, body.transform(ahead_m, -plan.side * ASIDE_M)),
    ]
    return [Waypoint(t_s=t_s, x_map_m=x, y_map_m=y, yaw_rad=yaw_rad) for t_s, (x, y) in places]
