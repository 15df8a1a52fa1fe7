"""People, animals and things that step into the way of the robot, as the seed draws them.

Each comes from one side, `ASIDE_M` beside the line along which the robot is heading, straight
across it, and stays there for a while or walks on. It is aimed at a place ahead of the robot's
front as if that went on at its speed, sees nothing, and does not give way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agribot.core.messages import MapPoint
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec, Shape
from agribot.core.world import Walker, Waypoint, WorldSpec
from agribot.sim.random_streams import make_stream
from agribot.sim.truth import Truth
from agribot.sim.walkers import measure_gap_m, measure_outline, measure_robot_outline

# Slowest and fastest of each figure, m/s. Walking people: 0.5 to 1.6, Bohannon 1997, Age Ageing 26.
SPEEDS_MPS = {
    "person_walking": (0.5, 1.6),
    "person_standing": (0.5, 1.6),
    "person_kneeling": (0.3, 0.6),
    "dog": (0.8, 3.0),
    "crate": (0.3, 1.0),
}
FIRST_S, EVERY_S, LATER_S = 12.0, 24.0, 6.0  # first time, time between two, random delay
AHEAD_M = (0.3, 5.0)  # place of its line ahead of the robot's front
ASIDE_M = 3.0
STAY_S, STAY_RATIO = (3.0, 8.0), 0.6  # time in the robot's way, and share of those that stay
PARKED_M = 200.0  # distance from the start of one that has not come yet
STANDING_MPS = 0.02
MOVING_MPS = 0.05  # least speed of a robot that meets somebody


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What was drawn of one; `side` is 1 from the left and -1 from the right."""

    figure: str
    begin_s: float
    side: int
    ahead_m: float
    speed_mps: float
    stays_s: float


class Encounter(msgspec.Struct, frozen=True, kw_only=True):
    """An encounter: what was drawn, and what became of it by the truth.

    `robot_mps` is the robot's speed as it began, `nearest_m` the smallest distance between the
    outlines, `stood_m` that at which the robot came to stand first, None where it did not.
    `touched_mps` is the robot's speed at the first touch, None without one, and `touched_ahead_m`
    how far ahead of the robot's middle that of the figure was then.
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


class Visitor(Walker, frozen=True):
    """A walker whose way is known once it has begun; until then, and after it, it is far away."""

    plan: Plan
    way: list[Waypoint]

    def find_place(self, t_s: float) -> tuple[float, float, float]:
        """Return x, y and yaw in the map."""
        way = tuple(self.way)
        if not way or not way[0].t_s <= t_s <= way[-1].t_s:
            return Walker.find_place(self, 0.0)
        walker = Walker(name="", kind="", shapes=(), waypoints=way, loops=False)
        return walker.find_place(t_s)


def add_visitors(
    world: WorldSpec, count: int, seed: int, load_figure: Callable[[str], tuple[Shape, ...]]
) -> WorldSpec:
    """Put people, animals and things into a world that will step into the robot's way."""
    x_m, y_m = world.spawn_xy_map_m
    parked = Waypoint(t_s=0.0, x_map_m=x_m + PARKED_M, y_map_m=y_m, yaw_rad=0.0)
    visitors = tuple(
        Visitor(
            name=f"visitor {number}", kind=plan.figure, shapes=load_figure(plan.figure),
            waypoints=(parked,), loops=False, plan=plan, way=[],
        )
        for number, plan in enumerate(draw_plans(count, seed), 1)
    )  # fmt: skip
    return msgspec.structs.replace(world, walkers=(*world.walkers, *visitors))


def draw_plans(count: int, seed: int) -> tuple[Plan, ...]:
    rng = make_stream(seed, "visitors")
    return tuple(_draw(rng, FIRST_S + EVERY_S * k) for k in range(count))


def _draw(rng: np.random.Generator, from_s: float) -> Plan:
    figure = str(rng.choice(list(SPEEDS_MPS)))
    stays = rng.random() < STAY_RATIO
    return Plan(
        figure=figure, begin_s=from_s + float(rng.uniform(0.0, LATER_S)),
        side=int(rng.choice((-1, 1))), ahead_m=float(rng.uniform(*AHEAD_M)),
        speed_mps=float(rng.uniform(*SPEEDS_MPS[figure])),
        stays_s=float(rng.uniform(*STAY_S)) if stays else 0.0,
    )  # fmt: skip


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
