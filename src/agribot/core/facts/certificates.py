"""What the certificate of a field plan is refused for, and where."""

from __future__ import annotations

from agribot.core.facts.mission import MissionNote


class _AtPlace(MissionNote, frozen=True, kw_only=True):
    """At a place in the map."""

    east_m: float
    north_m: float


class _OnLeg(_AtPlace, frozen=True, kw_only=True):
    """On a leg of the plan, counted from 0, of this kind."""

    leg_number: int
    leg_kind: str


class LegsMissing(MissionNote, frozen=True):
    """A plan has no legs."""


class LegBroken(MissionNote, frozen=True):
    """A leg has points that are no numbers, or fewer than two."""

    leg_number: int


class LegsApart(_AtPlace, frozen=True, kw_only=True):
    """A leg does not begin where the one before it ends."""

    gap_m: float


class LegTight(_AtPlace, frozen=True, kw_only=True):
    """A leg bends more than the robot can; `is_working`: with the tool on."""

    bend_radpm: float
    limit_radpm: float
    is_working: bool

    @property
    def variant(self) -> str:
        return "working" if self.is_working else "plain"


class ReachesOutside(_OnLeg, frozen=True, kw_only=True):
    """The robot reaches out of the field or into a hole."""

    depth_m: float


class NearEdge(_OnLeg, frozen=True, kw_only=True):
    """The robot comes nearer to an edge than the margin."""

    clearance_m: float
    margin_m: float


class WheelNearRow(_OnLeg, frozen=True, kw_only=True):
    """A wheel comes too close to a crop row."""

    clearance_m: float
    needed_m: float


class ToolOnCrop(_AtPlace, frozen=True, kw_only=True):
    """A tool that works no rows works over crop."""

    length_m: float


class NothingReachable(MissionNote, frozen=True):
    """The tool reaches nothing of the field."""


class GroundMissed(_AtPlace, frozen=True, kw_only=True):
    """Less of the reachable ground is worked than was asked for; this gap is the largest."""

    worked_percent: float
    needed_percent: float
    gap_m2: float
