"""What counts as noticed: signs after a fault, its part named or the robot stopped."""

from __future__ import annotations

from typing import get_args

import pytest
from agribot.app.named_parts import read_parts

from agribot.app.fault_verdict import judge_crushes, judge_faults
from agribot.core.messages import MissionState
from agribot.record.events import Event, EventKind
from agribot.record.report import FaultReport
from agribot.sim.safety_judge import Crush

JUMP = "gnss.jump=2@30"


def event(t_s: float, kind: EventKind, reason: str) -> Event:
    """As the log of a run has it: an event of the mission has its state."""
    states = get_args(MissionState) if kind == "mission" else ()
    state = next((each for each in states if reason.partition(":")[0] == each), None)
    return Event(t_s=t_s, kind=kind, reason=reason, state=state)


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


@pytest.mark.parametrize(
    ("reason", "parts"),
    [
        ("paused: GNSS crept by 0.30 m in 5 s against its own velocity, wheels and gyro", {"gnss"}),
        ("GNSS repeats its position while the wheels turned 0.3 m; check the cable", {"gnss"}),
        ("GNSS contradicts the odometry: 5 fixes rejected in a row", {"gnss"}),
        ("paused: camera and GNSS disagree by 0.40 m; look at both", {"camera", "gnss"}),
        ("paused: GNSS jumped by 0.40 m against wheels and gyro, or the robot was carried",
         {"gnss", "robot"}),
        ("paused: position jumped by 0.40 m", set()),
        ("driving -> stopped: left rear motor reports a fault; check it", {"motors"}),
        ("left front wheel does not turn: 0.0 rad/s instead of 4.3; check motor, gear", {"wheels"}),
        ("motor board: all wheels turn against the motor, as with A and B swapped", {"wheels"}),
        ("motor board: it hung, and its watchdog reset it", {"motors"}),
        ("the gyro says +0.28 rad/s, the wheels -0.04 rad/s; check the gyro", {"imu", "wheels"}),
        ("the compass turned by +35 deg that neither gyro nor wheels know of", {"compass"}),
        ("the camera's row line moved by 0.21 m though neither wheels nor gyro know of it",
         {"camera"}),
        ("wheels slip: they turn for 0.33 m/s, GNSS shows -0.00", {"ground"}),
        ("no position: GNSS silent for 3.02 s > 3.00 s, dead reckoning with 0.31 m", {"gnss"}),
        ("failed: no position for 60 s (the robot does not stand at the marked start: GNSS is 1 m)",
         {"start"}),
        ("the clock jumped by 3.02 s > 1.00 s, or the robot's program stood still",
         {"clock", "program"}),
        ("the link to the motor board broke 3 messages within 0.3 s", {"link"}),
        ("the red button is not reported for 0.30 s > 0.30 s", {"button", "inputs"}),
        ("RUNAWAY, the motors' power is cut: wheels turn too fast: 8.9 rad/s", {"motors"}),
        ("tilted by 0.60 rad > 0.60 rad", {"robot"}),
        ("off path by 0.6 m at the start of time number 3", set()),
    ],
)  # fmt: skip
def test_a_reason_names_the_parts_that_it_speaks_of(reason: str, parts: set[str]) -> None:
    assert read_parts(reason) == parts


def test_a_part_that_is_named_beside_another_is_one_of_two() -> None:
    found = judged(BEGINS, event(31.0, "mission", "paused: camera and GNSS disagree by 2.0 m"))
    assert (found.reaction, found.is_named, found.is_one_of_two) == ("stopped", False, True)
    sure = judged(
        BEGINS,
        event(31.0, "mission", "paused: camera and GNSS disagree by 2.0 m"),
        event(32.0, "fault", "GNSS repeats its position"),
    )
    assert (sure.is_named, sure.is_one_of_two) == (True, False)
    assert sure.reason == "paused: camera and GNSS disagree by 2.0 m", "the strongest reaction"


def test_where_both_parts_are_at_fault_a_reason_that_names_both_is_right() -> None:
    shift = "camera.shifted=0.2@30"
    events = [event(30.0, "injected", f"{shift} begins"), BEGINS]
    both = event(31.0, "mission", "paused: camera and GNSS disagree by 2.0 m")
    assert [found.is_named for found in judge_faults((shift, JUMP), [*events, both])] == [True] * 2


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
