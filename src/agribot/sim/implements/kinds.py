"""The effects of this program's implements by their kind, and of those that were registered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.core.errors import DescriptionError, PlatformError
from agribot.core.implement.kind import ImplementEffect, Pull, find_registered
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import FloatArray, ImplementCommand
from agribot.core.world import WorldSpec
from agribot.sim.implements.hoe import HoeEffect
from agribot.sim.implements.point import PointEffect
from agribot.sim.implements.sprayer import SprayEffect

KINDS: dict[str, Callable[[Any, WorldSpec, float], ImplementEffect]] = {
    "sprayer": SprayEffect,
    "hoe": HoeEffect,
    "point": PointEffect,
}


class NoImplement:
    """A robot without an implement: it works nothing, and takes no command for one."""

    worked_m2 = 0.0

    def command(self, t_s: float, command: ImplementCommand) -> None:
        if command.sections_on:
            raise PlatformError(
                f"command for {len(command.sections_on)} sections; the robot has no implement, "
                "as its description says"
            )

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        pass

    def pull(self) -> Pull | None:
        return None

    @property
    def treated(self) -> dict[int, float]:
        return {}


def fit_effect(
    spec: ImplementSpec | None, world: WorldSpec, base_height_m: float
) -> ImplementEffect:
    """Make what an implement does in a world.

    Raises: DescriptionError: its kind is not registered.
    """
    if spec is None:
        return NoImplement()
    kind = find_registered(spec.kind)
    effect = KINDS.get(spec.kind) if kind is None else kind.effect
    if effect is None:
        raise DescriptionError(
            f"the simulator has no implement '{spec.kind}'; register its kind first"
        )
    return effect(spec, world, base_height_m)
