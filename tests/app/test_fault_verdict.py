"""What counts as noticed: signs after a fault, its part named or the robot stopped."""

from __future__ import annotations

import pytest

from agribot.app.fault_verdict import judge_crushes, judge_faults
from agribot.record.events import Event, EventKind
from agribot.record.report import FaultReport
from agribot.sim.safety_judge import Crush

JUMP = "gnss.jump=2@30"


def event(t_s: float, kind: EventKind, reason: str) -> Event:
    return Event(t_s=t_s, kind=kind, reason=reason)


BEGINS = event(30.0, "injected", f"{JUMP} begins")


def judged(*events: Event) -> FaultReport:
    (found,) = judge_faults((JUMP,), events)
    return found


def test_a_fault_that_nobody_notices_has_no_reaction() -> None:
    found = judged(
        event(10.0, "stop", "GNSS silent"), BEGINS, event(31.0, "fault", "row 2 does not count")
    )
    assert (found.name, found.t_s, found.detected_s) == ("gnss.jump", 30.0, None)
    assert (found.reaction, found.reason, found.is_named) == ("none", "", False)


def test_the_first_sign_counts_for_the_time_and_the_strongest_for_the_reaction() -> None:
    found = judged(
        BEGINS,
        event(30.5, "fault", "GNSS contradicts the odometry"),
        event(32.0, "mission", "paused: GNSS jumped by 2.0 m"),
        event(32.0, "stop", "GNSS jumped by 2.0 m"),
    )
    assert (found.detected_s, found.reaction, found.is_named) == (30.5, "stopped", True)
    assert found.reason == "paused: GNSS jumped by 2.0 m"


@pytest.mark.parametrize(
    ("kind", "reason", "reaction", "is_named"),
    [
        ("stop", "off path by 0.6 m", "stopped", False),
        ("mission", "failed: off path by 0.6 m", "stopped", False),
        ("hold", "position uncertain", "held", False),
        ("limit", "GNSS is poor: slower", "slowed", True),
        ("fault", "GNSS repeats its position", "named", True),
        ("mission", "running: may be 0.5 m off the row; wait for GNSS", "slowed", False),
        ("mission", "running", "none", False),
        ("limit", "yaw rate limited", "none", False),
        ("mission", "cancelled: cancelled by session", "none", False),
        ("operator", "stop (GNSS)", "none", False),
    ],
)
def test_each_kind_of_event_is_a_reaction_of_its_own(
    kind: EventKind, reason: str, reaction: str, is_named: bool
) -> None:
    found = judged(BEGINS, event(33.0, kind, reason))
    assert (found.reaction, found.is_named) == (reaction, is_named)
    assert found.detected_s == (None if reaction == "none" else 33.0)


def test_what_stopped_the_robot_before_the_fault_is_no_sign_of_it() -> None:
    before, after = (event(t_s, "stop", f"off path by 0.{t_s:.0f} m") for t_s in (20.0, 40.0))
    assert judged(before, BEGINS, after).reaction == "none"


def test_a_stop_that_names_the_part_of_another_fault_is_that_ones() -> None:
    motor = "motor.dead=left_wheel_F@20"
    events = [
        event(20.0, "injected", f"{motor} begins"), BEGINS, event(31.0, "stop", "GNSS jumped"),
    ]  # fmt: skip
    dead, jump = judge_faults((motor, JUMP), events)
    assert (dead.reaction, jump.reaction) == ("none", "stopped")


def test_of_a_stepped_clock_the_time_that_passed_counts() -> None:
    text = "clock.step=-100@30"
    (found,) = judge_faults(
        (text,),
        [
            event(29.0, "mission", "running"),
            event(-70.0, "injected", f"{text} begins"),
            event(-69.9, "stop", "the clock went back by 100 s"),
        ],
    )
    assert found.detected_s == pytest.approx(30.1)


def test_a_fault_that_the_run_ended_before_is_not_judged() -> None:
    assert judge_faults((JUMP,), [event(20.0, "stop", "GNSS silent")]) == ()


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
