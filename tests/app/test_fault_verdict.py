"""What counts as noticed: signs after a fault, its part named or the robot stopped."""

from __future__ import annotations

import pytest

from agribot.app.fault_verdict import judge_crushes, judge_faults
from agribot.core.fact_text import render
from agribot.core.facts import (
    CameraAndGnssDisagree,
    CancelledBy,
    ClockWentBack,
    DeadReckoning,
    Fact,
    FixesRejected,
    GnssParts,
    GnssRepeats,
    GnssSilent,
    MayBeOffRow,
    OffPath,
    PositionUnsure,
    RowsUndriven,
    Said,
    YawRateLimited,
)
from agribot.core.messages import MissionState
from agribot.record.events import Event, EventKind, make_event
from agribot.record.report import FaultReport
from agribot.sim.safety_judge import Crush

JUMP = "gnss.jump=2@30"


JUMPED = GnssParts(2.0, 5.0)  # names the receiver alone
REPEATS, OFF_PATH = GnssRepeats(0.3), OffPath(0.6, 0.5, 1.0, 2.0)
DISAGREE = CameraAndGnssDisagree(2.0, is_left_open=True)


def event(
    t_s: float, kind: EventKind, fact: Fact | None, state: MissionState | None = None
) -> Event:
    """As the log of a run has it."""
    return make_event(t_s, kind, render(fact), fact, state)


def begins(text: str, t_s: float = 30.0) -> Event:
    return Event(t_s=t_s, kind="injected", reason=f"{text} begins")


BEGINS = begins(JUMP)


def judged(*events: Event) -> FaultReport:
    (found,) = judge_faults((JUMP,), events)
    return found


def test_a_fault_that_nobody_notices_has_no_reaction() -> None:
    found = judged(
        event(10.0, "stop", GnssSilent(3.0)), BEGINS, event(31.0, "fault", RowsUndriven((2,)))
    )
    assert (found.name, found.t_s, found.detected_s) == ("gnss.jump", 30.0, None)
    assert (found.reaction, found.reason, found.is_named) == ("none", "", False)


def test_the_first_sign_counts_for_the_time_and_the_strongest_for_the_reaction() -> None:
    found = judged(
        BEGINS,
        event(30.5, "fault", FixesRejected(5, 25)),
        event(32.0, "mission", JUMPED, "paused"),
        event(32.0, "stop", JUMPED),
    )
    assert (found.detected_s, found.reaction, found.is_named) == (30.5, "stopped", True)
    assert (found.code, found.parts) == ("gnss_parts", ("gnss",))


@pytest.mark.parametrize(
    ("kind", "fact", "state", "reaction", "is_named"),
    [
        ("stop", OFF_PATH, None, "stopped", False),
        ("mission", OFF_PATH, "failed", "stopped", False),
        ("hold", PositionUnsure(3.2, 3.0), None, "held", False),
        ("limit", DeadReckoning(GnssSilent(3.0), 0.1, 0.2, False), None, "slowed", True),
        ("fault", REPEATS, None, "named", True),
        ("mission", MayBeOffRow(0.5, 0.3), "running", "slowed", False),
        ("mission", None, "running", "none", False),
        ("limit", YawRateLimited(2.0, 1.0), None, "none", False),
        ("mission", CancelledBy("GNSS"), "cancelled", "none", False),
        ("operator", Said("stop (GNSS)"), None, "none", False),
    ],
)
def test_each_kind_of_event_is_a_reaction_of_its_own(
    kind: EventKind, fact: Fact | None, state: MissionState | None, reaction: str, is_named: bool
) -> None:
    found = judged(BEGINS, event(33.0, kind, fact, state))
    assert (found.reaction, found.is_named) == (reaction, is_named)
    assert found.detected_s == (None if reaction == "none" else 33.0)


@pytest.mark.parametrize("words", ["GNSS jumped by 2.0 m", "the receiver", "camera and GNSS"])
def test_words_name_no_part_whatever_they_say(words: str) -> None:
    found = judged(BEGINS, event(31.0, "stop", Said(words)))
    assert (found.reaction, found.is_named, found.is_one_of_two) == ("stopped", False, False)


def test_a_part_that_is_named_beside_another_is_one_of_two() -> None:
    paused = event(31.0, "mission", DISAGREE, "paused")
    found = judged(BEGINS, paused)
    assert (found.reaction, found.is_named, found.is_one_of_two) == ("stopped", False, True)
    sure = judged(BEGINS, paused, event(32.0, "fault", REPEATS))
    assert (sure.is_named, sure.is_one_of_two) == (True, False)
    assert sure.code == DISAGREE.code, "the strongest reaction"


def test_where_both_parts_are_at_fault_a_reason_that_names_both_is_right() -> None:
    shift = "camera.shifted=0.2@30"
    events = [begins(shift), BEGINS, event(31.0, "mission", DISAGREE, "paused")]
    assert [found.is_named for found in judge_faults((shift, JUMP), events)] == [True] * 2


def test_what_stopped_the_robot_before_the_fault_is_no_sign_of_it() -> None:
    before, after = (
        event(t_s, "stop", OffPath(t_s / 100.0, 0.1, t_s, 0.0)) for t_s in (20.0, 40.0)
    )
    assert judged(before, BEGINS, after).reaction == "none"


def test_a_stop_that_names_the_part_of_another_fault_is_that_ones() -> None:
    motor = "motor.dead=left_wheel_F@20"
    events = [begins(motor, 20.0), BEGINS, event(31.0, "stop", JUMPED)]
    dead, jump = judge_faults((motor, JUMP), events)
    assert (dead.reaction, jump.reaction) == ("none", "stopped")


def test_of_a_stepped_clock_the_time_that_passed_counts() -> None:
    text = "clock.step=-100@30"
    (found,) = judge_faults(
        (text,),
        [
            event(29.0, "mission", None, "running"),
            begins(text, -70.0),
            event(-69.9, "stop", ClockWentBack(100.0)),
        ],
    )
    assert found.detected_s == pytest.approx(30.1)


def test_a_fault_that_the_run_ended_before_is_not_judged() -> None:
    assert judge_faults((JUMP,), [event(20.0, "stop", GnssSilent(3.0))]) == ()


CRUSHES = [Crush(t_s=t_s, by="wheel") for t_s in (31.0, 33.0, 40.0)]


def whens(text: str, *found: FaultReport) -> list[str]:
    return [c.when for c in judge_crushes((text,), found, CRUSHES, (29.0, 35.0, 41.0))]


def test_a_crush_counts_by_when_the_robot_noticed_and_when_it_stood() -> None:
    seen = FaultReport(name="gnss.jump", t_s=30.0, detected_s=32.0, reaction="stopped")
    assert whens(JUMP, seen) == ["before_detection", "after_detection", "after_standstill"]
    missed = FaultReport(name="gnss.jump", t_s=30.0)
    assert whens(JUMP, missed) == ["before_detection"] * 3


def test_what_lies_where_hands_set_the_robot_down_is_their_doing() -> None:
    seen = FaultReport(name="carried", t_s=30.0, detected_s=30.7, reaction="stopped")
    assert whens("carried=0.5@30", seen) == ["by_fault", "after_detection", "after_standstill"]
    assert whens("carried=-2@30", seen) == ["by_fault", "by_fault", "after_standstill"]
    at_start = judge_crushes(("start.aside=1@0",), (), [Crush(t_s=0.02, by="wheel")], ())
    assert [crush.when for crush in at_start] == ["by_fault"]
