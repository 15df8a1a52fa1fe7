"""What the gate does to a command, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from agribot.core.facts.base import Fact, Severity

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class CommandNotFinite(Fact, frozen=True):
    """A drive command is no number."""

    v_mps: float
    yaw_rate_radps: float


class ImplementNotFinite(Fact, frozen=True):
    """A command to the implement is no number."""

    setpoints: str


class NoPosition(Fact, frozen=True):
    """There is no position to drive by."""

    cause: AnyFact


class PositionNotFinite(Fact, frozen=True):
    """The position is no number."""


class PositionOld(Fact, frozen=True):
    """The position is of another time."""

    old_s: float
    limit_s: float


class PositionUnsure(Fact, frozen=True):
    """The position is too uncertain."""

    std_m: float
    limit_m: float


class HeadingUnsure(Fact, frozen=True):
    """The heading is too uncertain."""

    std_rad: float
    limit_rad: float


class LeavesBox(Fact, frozen=True):
    """The robot is about to leave the box around its path, or has left it."""

    x_map_m: float
    y_map_m: float
    is_inside: bool

    @property
    def variant(self) -> str:
        return "inside" if self.is_inside else "outside"


class BeyondField(Fact, frozen=True):
    """The robot is beyond the edge of the field."""

    x_map_m: float
    y_map_m: float


class LeavesField(Fact, frozen=True):
    """The robot is about to leave the field; `is_by_hand`: a person takes it there."""

    x_map_m: float
    y_map_m: float
    is_by_hand: bool

    @property
    def variant(self) -> str:
        return "hand" if self.is_by_hand else "plan"


class NearEdgeAndDoubted(Fact, frozen=True):
    """Too near to the edge for sensors that contradict each other."""

    x_map_m: float
    y_map_m: float
    aside_m: float


class NearEdgeAndUnsure(Fact, frozen=True):
    """Too near to the edge for a position of this sigma."""

    x_map_m: float
    y_map_m: float
    std_m: float


class _AtKeepOut(Fact, frozen=True):
    """Place where an area to keep out of is touched, and that of the robot."""

    area_x_map_m: float
    area_y_map_m: float
    x_map_m: float
    y_map_m: float


class EntersKeepOut(_AtKeepOut, frozen=True):
    """The robot is about to enter an area to keep out of."""


class InKeepOut(_AtKeepOut, frozen=True):
    """The robot is in an area to keep out of."""


class MissionIdle(Fact, frozen=True):
    """No mission drives the robot."""

    severity: ClassVar[Severity] = "note"
    state: str
    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class ToolEarly(Fact, frozen=True):
    """The tool works before the robot drives."""


class ToolAtRest(Fact, frozen=True):
    """The tool must not work: the robot stands, or no mission drives it."""

    severity: ClassVar[Severity] = "note"


class ToolBackwards(Fact, frozen=True):
    """The tool does not work backwards."""

    severity: ClassVar[Severity] = "note"


class SpeedLimited(Fact, frozen=True):
    """A command was too fast."""

    severity: ClassVar[Severity] = "note"
    speed_mps: float
    limit_mps: float


class YawRateLimited(Fact, frozen=True):
    """A command turned too fast."""

    severity: ClassVar[Severity] = "note"
    yaw_rate_radps: float
    limit_radps: float


class StoppedBy(Fact, frozen=True):
    """Somebody pressed STOP."""

    by: str


class StoppedAgainBy(Fact, frozen=True):
    """Somebody pressed STOP, and often."""

    by: str
    times: int


class Disarmed(Fact, frozen=True):
    """A machine begins stopped."""


class NotCleared(Fact, frozen=True):
    """A stop of an earlier run, not cleared since a date and time."""

    cause: AnyFact
    since: str


class StopToClear(Fact, frozen=True):
    """The robot stands until the stop is cleared."""

    cause: AnyFact


class StopCleared(Fact, frozen=True):
    """A person cleared the stop; `then` is why the robot still stands."""

    severity: ClassVar[Severity] = "note"
    by: str
    then: AnyFact | None = None

    @property
    def variant(self) -> str:
        return ("known" if self.by else "unknown") if self.then is None else "then"


class DrivenByHand(Fact, frozen=True):
    """Somebody drives."""

    severity: ClassVar[Severity] = "note"
    by: str


class MissionSetsOff(Fact, frozen=True):
    """All that is checked before the start is good."""

    severity: ClassVar[Severity] = "note"


class MissionGoesOn(Fact, frozen=True):
    """The mission drives again."""

    severity: ClassVar[Severity] = "note"


class Over(Fact, frozen=True):
    """What held the robot is over."""

    severity: ClassVar[Severity] = "note"
    cause: AnyFact | None = None
