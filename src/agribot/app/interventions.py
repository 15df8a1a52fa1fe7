"""How often a robot needed a person: stops, pauses and questions that only somebody can end."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.facts import CameToBeCharged
from agribot.record.events import Event
from agribot.record.report import SafetyEvent

NEEDY_STATES = ("paused", "failed")
# States of a mission that is not heard: without a state it refused something; one that waits for
# its position has just begun.
SILENT_STATES = (None, "waiting")
BY_HAND_S = 1.0  # time after an operator's button within which an event is that operator's wish


def list_interventions(events: Sequence[Event]) -> tuple[SafetyEvent, ...]:
    """List when the robot began to need a person, and why.

    Those are stops that a person has to clear, pauses and questions of the mission, its failure,
    and that it came home to be charged; what comes while it already needs a person is not another
    one. What a person asked for is not one, nor a pause that the mission ends by itself, as on its
    way home.
    """
    found: list[SafetyEvent] = []
    is_stopped = is_waiting = False
    waits_since_s = math.inf
    pressed_s = -math.inf
    for event in events:
        needed = is_stopped or is_waiting
        if event.kind == "operator":
            pressed_s = event.t_s
        elif event.kind == "gate":
            is_stopped = event.state == "stopped"
        elif event.kind == "mission":
            was_waiting, is_waiting = is_waiting, _waits(event, is_waiting)
            if is_waiting and not was_waiting:
                waits_since_s = event.t_s
            if was_waiting and not is_waiting and pressed_s < waits_since_s:
                found = [one for one in found if one.t_s < waits_since_s]
        is_by_hand = 0.0 <= event.t_s - pressed_s < BY_HAND_S
        if (is_stopped or is_waiting) and not needed and not is_by_hand:
            found.append(
                SafetyEvent(
                    t_s=event.t_s, reason=event.reason,
                    code=event.code, parts=event.parts, numbers=event.numbers,
                )
            )  # fmt: skip
    return tuple(found)


def _waits(event: Event, is_waiting: bool) -> bool:
    """Whether a mission after this event, which may have waited before, waits for a person."""
    is_to_be_charged = event.code == CameToBeCharged().code
    still_waits = is_waiting and event.state in SILENT_STATES
    return event.state in NEEDY_STATES or is_to_be_charged or still_waits


def compute_km_per_intervention(distance_m: float | None, count: int) -> float | None:
    """Divide the way by the interventions; None without interventions or a known way."""
    return None if distance_m is None or not count else distance_m / 1000.0 / count
