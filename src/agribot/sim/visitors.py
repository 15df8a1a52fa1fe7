"""People, animals and things that step into the way of the robot, as the seed draws them.

Each comes from one side, `ASIDE_M` beside the line along which the robot is heading, straight
across it, and stays there for a while or walks on. It is aimed at a place ahead of the robot's
front as if that went on at its speed, sees nothing, and does not give way.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np

from agribot.core.robot import Shape
from agribot.core.world import Walker, Waypoint, WorldSpec
from agribot.sim.random_streams import make_stream

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
