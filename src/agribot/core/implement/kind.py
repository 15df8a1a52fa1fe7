"""A kind of implement: its description, its mind, its physics; and the kinds that are known.

The kinds of this program stand in three tables, one on each side of the seam: `SPECS` here,
`agribot.autonomy.implements.kinds` and `agribot.sim.implements.kinds`. A kind from elsewhere is one
`ImplementKind`, handed to `register_implement` or
named by an installed package as an entry point of the group `agribot.implements`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

import msgspec

from agribot.core.errors import ConfigError, DescriptionError
from agribot.core.implement.hoe import HoeSpec
from agribot.core.implement.plants import PlantMap
from agribot.core.implement.point import PointSpec
from agribot.core.implement.spec import ImplementSpec
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import Estimate, FloatArray, ImplementCommand, Vec3
from agribot.core.plugins import IMPLEMENTS, find_plugin
from agribot.core.world import WorldSpec

Spec = TypeVar("Spec", bound=ImplementSpec)


class ReportLine(msgspec.Struct, frozen=True):
    """A figure of a run, such as 12 "blade lifts"; those of the runs of one job add up."""

    name: str
    value: float
    unit: str = ""


class Implement(Protocol):
    """Decides in every tick which sections work. Pure: no clock, no I/O, no threads."""

    def step(self, estimate: Estimate, plants: PlantMap, *, may_work: bool) -> ImplementCommand:
        """Call it every tick; without `may_work` the command has all sections off."""
        ...

    def report(self) -> tuple[ReportLine, ...]:
        """Return the figures of the run until now, as the implement believes them."""
        ...


class Pull(NamedTuple):
    """A force of the soil on the robot and where it acts, in the map."""

    force_map_n: Vec3
    place_map_m: Vec3


class ImplementEffect(Protocol):
    """Effect of an implement on a simulated field, and of the field on the robot."""

    def command(self, t_s: float, command: ImplementCommand) -> None:
        """Take a command given at `t_s`; one without sections switches all of them off.

        Raises: PlatformError: it is not for this implement.
        """
        ...

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Work over the tick that ends at `t_s`, between two rows of the physics history."""
        ...

    def pull(self) -> Pull | None:
        """Return the force on the robot in the coming tick; None without one."""
        ...

    @property
    def treated(self) -> dict[int, float]:
        """Plants that it worked on: index into the world's plants -> time of the first touch."""
        ...

    @property
    def worked_m2(self) -> float:
        """Ground that it worked; passing twice counts twice."""
        ...


@runtime_checkable
class WetsLeaves(Protocol):
    """Further reports of an effect that wets plants."""

    @property
    def wet_leaves(self) -> dict[int, float]:
        """Index of a crop plant in the world -> share of its leaf area that got wet, above 0."""
        ...

    @property
    def offsets_m(self) -> dict[int, float]:
        """Index of a weed -> how near the middle of a working section came to it, below 10 cm."""
        ...


class ImplementKind(NamedTuple, Generic[Spec]):
    """All that a new kind of implement brings along; the robot's description has its numbers.

    `control` gets the description and the settings of the treatment, and where the kind has
    `settings` of its own, those as `settings=`. `effect` gets the description, the world, and the
    height of base_link over the ground.
    """

    spec: type[Spec]
    control: Callable[..., Implement]
    effect: Callable[[Spec, WorldSpec, float], ImplementEffect]
    settings: type[msgspec.Struct] | None = None


SPECS: dict[str, type[ImplementSpec]] = {
    spec.kind: spec for spec in (SprayerSpec, HoeSpec, PointSpec)
}
_registered: dict[str, ImplementKind[Any]] = {}


def register_implement(kind: ImplementKind[Any]) -> None:
    """Make a kind known, so that a robot's description may have it.

    Raises: DescriptionError: another kind has its name.
    """
    name = kind.spec.kind
    if name in SPECS or _registered.get(name, kind) != kind:
        raise DescriptionError(f"there is an implement '{name}' already; choose another name")
    _registered[name] = kind


def find_registered(name: str) -> ImplementKind[Any] | None:
    return _registered.get(name)


def find_spec_type(name: str) -> type[ImplementSpec] | None:
    """Find how a kind is described: one of this program, a registered or an installed one.

    Raises: DescriptionError: an installed package has one that cannot be loaded.
    """
    if name not in SPECS and name not in _registered:
        try:
            installed = find_plugin(IMPLEMENTS, name)
        except ConfigError as error:
            raise DescriptionError(str(error)) from error
        if installed is not None:
            register_implement(installed)
    kind = _registered.get(name)
    return SPECS.get(name) if kind is None else kind.spec


def list_kinds() -> tuple[str, ...]:
    """List the built-in and the registered kinds by name."""
    return tuple(sorted({*SPECS, *_registered}))
