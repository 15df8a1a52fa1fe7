"""What counts as needing a person: stops, pauses, questions, each once."""

from __future__ import annotations

from typing import get_args

import pytest

from agribot.app.interventions import compute_km_per_intervention, list_interventions
from agribot.core.fact_text import render
from agribot.core.facts import CameToBeCharged, ReturnedHome
from agribot.core.messages import GateState, MissionState
from agribot.record.events import Event, EventKind, make_event


def event(t_s: float, kind: EventKind, reason: str) -> Event:
    """As the log of a run has it; where a state is no known one, it is a refusal."""
    before, arrow, after = reason.partition(" -> ")
    name = (after if arrow else before).partition(":")[0]
    states = get_args(GateState if kind == "gate" else MissionState)
    is_change = kind in ("gate", "mission")
    state = next((each for each in states if is_change and each == name), None)
    return Event(t_s=t_s, kind=kind, reason=reason, state=state)


CHARGED = make_event(
    200.0, "mission", f"cancelled: {render(CameToBeCharged())}", CameToBeCharged(), "cancelled"
)
STOPPED = event(10.0, "gate", "driving -> stopped: the bumper touches something")
CLEARED = event(30.0, "gate", "stopped -> driving: cleared")
PAUSED = event(50.0, "mission", "paused: which row?")
PRESSED = event(59.9, "operator", "resume (page)")
RUNNING = event(60.0, "mission", "running")


def test_each_stop_and_each_question_counts_once() -> None:
    found = list_interventions(
        [event(0.0, "mission", "running"), STOPPED, CLEARED, PAUSED, PRESSED, RUNNING]
    )
    assert [(one.t_s, one.reason) for one in found] == [
        (10.0, STOPPED.reason),
        (50.0, "paused: which row?"),
    ]


def test_what_comes_while_a_person_is_needed_already_is_no_other_one() -> None:
    failed = event(12.0, "mission", "failed: no headway for 60 s")
    refused = event(13.0, "mission", "goto refused: the robot stands")
    assert len(list_interventions([STOPPED, failed, CLEARED, refused, PAUSED])) == 1


@pytest.mark.parametrize(
    "passing",
    [
        event(10.0, "gate", "driving -> held: GNSS silent"),
        event(10.0, "stop", "GNSS silent"),
        event(10.0, "hold", "no position"),
        event(10.0, "mission", "running: may be 0.5 m off the row"),
        event(10.0, "mission", "done"),
    ],
)
def test_what_ends_by_itself_needs_nobody(passing: Event) -> None:
    assert list_interventions([passing]) == ()


def test_what_a_person_asked_for_is_no_intervention_that_the_robot_needed() -> None:
    press = event(9.98, "operator", "pause (page)")
    assert list_interventions([press, event(10.0, "mission", "paused: by the page")]) == ()
    late = event(20.0, "mission", "paused: GNSS jumped by 2 m")
    assert len(list_interventions([press, late])) == 1


def test_a_pause_that_the_mission_ends_by_itself_needed_nobody() -> None:
    assert list_interventions([STOPPED, CLEARED, PAUSED, RUNNING])[1:] == ()


def test_a_robot_that_comes_home_to_be_charged_needs_a_person_once() -> None:
    """Also where that person lets it go on from there, in a run of its own."""
    found = list_interventions(
        [
            event(100.0, "mission", "paused: stops to return home, as the battery wants"),
            event(100.5, "mission", "running"),
            CHARGED,
            event(201.0, "mission", "waiting: waiting for the estimate to settle"),
            event(202.0, "mission", "paused: was cut off: away from its work; resume goes on"),
            event(202.1, "operator", "resume (page)"),
            event(202.2, "mission", "running"),
        ]
    )
    assert [one.t_s for one in found] == [200.0]


@pytest.mark.parametrize("name", ["Ada", "the battery", "Ada, called by the battery"])
def test_a_person_who_calls_the_robot_home_is_not_taken_for_its_battery(name: str) -> None:
    fact = ReturnedHome(name)
    home = make_event(200.0, "mission", f"cancelled: {render(fact)}", fact, "cancelled")
    assert list_interventions([home]) == ()


def test_the_state_of_the_gate_counts_and_not_its_words() -> None:
    stop = Event(t_s=10.0, kind="gate", reason="driving -> halted: bumper", state="stopped")
    hold = Event(t_s=10.0, kind="gate", reason="driving -> stopped: bumper", state="held")
    assert [one.reason for one in list_interventions([stop])] == [stop.reason]
    assert list_interventions([hold]) == ()


def test_the_way_for_each_is_unknown_without_any() -> None:
    assert compute_km_per_intervention(2500.0, 2) == 1.25
    assert compute_km_per_intervention(2500.0, 0) is None
    assert compute_km_per_intervention(None, 2) is None
