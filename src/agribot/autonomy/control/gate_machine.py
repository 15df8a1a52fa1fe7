"""The states of the gate: one table, and a reason for every way from one to another."""

from __future__ import annotations

from typing import NamedTuple

from agribot.core.fact_text import render
from agribot.core.facts import (
    DrivenByHand,
    Fact,
    MissionGoesOn,
    MissionSetsOff,
    Over,
    StopCleared,
    find_kind,
)
from agribot.core.messages import Check, GateState, GateStatus


class Seen(NamedTuple):
    """Causes of the state in a tick; None and empty where it is not so."""

    stopped: Fact | None  # why the latch is closed
    hand: str  # driver by hand
    held: Fact | None  # a cause that passes by itself
    idle: Fact | None  # why the mission does not drive
    limited: Fact | None
    cleared_by: str  # person that has just cleared a stop


class StateRow(NamedTuple):
    """One state, for people: what passes the gate, and what ends it."""

    state: GateState
    passes: str
    ends: str


# The first that applies is the state.
STATES = (
    StateRow("stopped", "nothing, the tool is off", "a person who clears the stop"),
    StateRow("by hand", "what a person asks for, within what holds for a hand", "the hand lets go"),
    StateRow("standby", "nothing but braking", "the mission drives"),
    StateRow("checking", "nothing: an item of the list before the start is not good", "it is good"),
    StateRow("held", "nothing until the hazard is over", "the hazard is over"),
    StateRow("slowed", "the command, slower along the same curve", "the command is within limits"),
    StateRow("driving", "the command", "any of the above"),
)


class GateMachine:
    """Call `step` once a tick; a mission that begins is `checking` until its list is good.

    One that waits for something has its list published, too, in `standby`.
    """

    def __init__(self) -> None:
        self.status = GateStatus()
        self.is_started = False
        self._checks: tuple[Check, ...] = ()

    def step(self, seen: Seen, warning: Fact | None, checks: tuple[Check, ...]) -> None:
        """Take in a tick; `checks` is looked at while the mission has not started."""
        before = self.status
        state: GateState
        fact: Fact | None
        state, fact = self._choose(seen)
        if state == before.state and state == "driving":
            fact = before.fact
        outcome: tuple[Check, ...] = ()
        is_to_start = state in ("checking", "held", "slowed", "driving")
        if (is_to_start or (state == "standby" and checks)) and not self.is_started:
            is_new = _name_bad(checks) != _name_bad(self._checks)
            self.is_started = state not in ("checking", "standby")
            if is_new or not self._checks or self.is_started:
                outcome = self._checks = checks
        if (state, fact, warning, outcome) != (
            before.state,
            before.fact,
            before.warning_fact,
            (),
        ) or (before.checks):
            self.status = GateStatus(
                state=state, reason=render(fact), warning=render(warning), checks=outcome,
                fact=fact, warning_fact=warning,
            )  # fmt: skip

    def end_mission(self) -> None:
        """Go through the list anew before whatever comes next."""
        self.is_started, self._checks = False, ()

    def _choose(self, seen: Seen) -> tuple[GateState, Fact]:
        """Go through the states in the order of the table."""
        held: GateState = "held" if self.is_started or seen.hand else "checking"
        if seen.stopped is not None:
            return "stopped", seen.stopped
        if seen.hand and seen.held is None:
            return "by hand", DrivenByHand(seen.hand)
        if seen.idle is not None and not seen.hand:
            by = seen.cleared_by
            return "standby", StopCleared(by, seen.idle) if by else seen.idle
        if seen.held is not None:
            return held, seen.held
        if seen.limited is not None:
            return "slowed", seen.limited
        return "driving", _why_driving(self.status, seen, is_started=self.is_started)


def _name_bad(checks: tuple[Check, ...]) -> list[tuple[str, tuple[object, ...]]]:
    """Name the items that are not good, and why, less the numbers, which change all the time."""
    return [(check.name, find_kind(check.fact)) for check in checks if not check.is_ok]


def _why_driving(before: GateStatus, seen: Seen, *, is_started: bool) -> Fact:
    if before.state == "stopped":
        return StopCleared(seen.cleared_by)
    if not is_started:
        return MissionSetsOff()
    if before.state in ("held", "slowed", "checking"):
        return Over(before.fact)
    return MissionGoesOn()
