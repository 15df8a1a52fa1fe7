"""How often a robot needed a person: stops, pauses and questions that only somebody can end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from agribot.core.messages import MissionState
from agribot.record.events import Event
from agribot.record.report import SafetyEvent

NEEDY_STATES = ("paused", "failed")
KNOWN_STATES = get_args(MissionState)  # other words of the mission are refusals
BY_HAND_S = 1.0  # what follows so soon on somebody's button is what that person wanted


def list_interventions(events: Sequence[Event]) -> tuple[SafetyEvent, ...]:
    """List when the robot began to need a person, and why.

    Those are stops that a person has to clear, pauses and questions of the mission, and its
    failure; what comes while it already needs somebody is no other one. What a person asked for
    is none.
    """
    found: list[SafetyEvent] = []
    is_stopped = is_waiting = False
    pressed_s = -BY_HAND_S
    for event in events:
        needed = is_stopped or is_waiting
        if event.kind == "operator":
            pressed_s = event.t_s
        elif event.kind == "gate":
            is_stopped = event.reason.partition(" -> ")[2].startswith("stopped")
        elif event.kind == "mission":
            state = event.reason.partition(":")[0]
            is_waiting = state in NEEDY_STATES or (is_waiting and state not in KNOWN_STATES)
        is_by_hand = 0.0 <= event.t_s - pressed_s < BY_HAND_S
        if (is_stopped or is_waiting) and not needed and not is_by_hand:
            found.append(SafetyEvent(t_s=event.t_s, reason=event.reason))
    return tuple(found)


def compute_km_per_intervention(distance_m: float | None, count: int) -> float | None:
    """Divide the way by the interventions; None where there were none, or nobody knows the way."""
    return None if distance_m is None or not count else distance_m / 1000.0 / count
