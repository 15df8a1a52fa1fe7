"""What a mission is doing, as values: each state holds what only that state needs."""

from __future__ import annotations

import msgspec

from agribot.autonomy.plan.mission.errand import Errand
from agribot.autonomy.plan.mission.job import Ending, MissionJob
from agribot.autonomy.plan.mission.route import Route
from agribot.core.facts import Fact
from agribot.core.messages import MissionState


class Waiting(msgspec.Struct, frozen=True, eq=False):
    """The mission waits for a position that holds, and for the way that is planned from it."""

    reason: Fact | None = None
    steady_since_s: float | None = None


class Driving(msgspec.Struct, frozen=True, eq=False):
    """Along the route of its job, at work."""

    job: MissionJob
    reason: Fact | None = None


class OnErrand(msgspec.Struct, frozen=True, eq=False):
    """Along a way beside its job: home, to a place, or back to the work."""

    errand: Errand
    route: Route
    reason: Fact | None = None


class Stopping(msgspec.Struct, frozen=True, eq=False):
    """The robot comes to rest for an errand, whose way is planned from where it stands.

    `stood` and `held` are those of the pause before.
    """

    errand: Errand
    reason: Fact
    stood: Fact | None = None
    held: Fact | None = None


class Paused(msgspec.Struct, frozen=True, eq=False):
    """The robot stands until a person resumes the mission.

    `stood` is why, as a saved mission keeps it; `held` is the same where it paused by itself.
    Resumed, it goes on with `away`, the errand that it was on, or begins `cut_off`, that of an
    earlier run; else it goes on with its job.
    """

    reason: Fact
    stood: Fact | None = None
    held: Fact | None = None
    away: OnErrand | None = None
    cut_off: Errand | None = None


class Ended(msgspec.Struct, frozen=True, eq=False):
    """`away` is the errand that it was on, `errand` one that it had not begun."""

    ending: Ending
    reason: Fact | None
    stood: Fact | None = None
    away: OnErrand | None = None
    errand: Errand | None = None


State = Waiting | Driving | OnErrand | Stopping | Paused | Ended


def name_state(state: State) -> MissionState:
    """Return the word that status, page and recording have for a state."""
    match state:
        case Waiting():
            return "waiting"
        case Driving() | OnErrand():
            return "running"
        case Stopping() | Paused():
            return "paused"
        case Ended():
            return state.ending


def find_away(state: State) -> OnErrand | None:
    """Find the errand that the robot is on, or was on when it was paused or ended."""
    if isinstance(state, OnErrand):
        return state
    return state.away if isinstance(state, Paused | Ended) else None


def find_errand(state: State) -> Errand | None:
    """Find the errand of a state, whether it has begun or not."""
    if away := find_away(state):
        return away.errand
    match state:
        case Stopping() | Ended():
            return state.errand
        case Paused():
            return state.cut_off
        case _:
            return None


def find_stood(state: State) -> Fact | None:
    """Find why the robot stands, as a saved mission keeps it; None where it drives."""
    return state.stood if isinstance(state, Stopping | Paused | Ended) else None
