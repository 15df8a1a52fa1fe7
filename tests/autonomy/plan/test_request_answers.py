"""Every request that carries an id gets its own result, and no other."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.core.facts import (
    AskedElse,
    BeyondFence,
    ErrandRefused,
    Fact,
    GoalNotFinite,
    MissionEnded,
    NotResumed,
    StopHolds,
)
from agribot.core.messages import (
    AnyRequest,
    ChangeSetting,
    Estimate,
    GoTo,
    MissionStatus,
    RequestAnswer,
    RequestEvent,
    RequestWord,
    TakePlan,
)
from tests import asking
from tests.asking import go_to
from tests.autonomy.plan.planting import at
from tests.autonomy.plan.test_mission_errands import HEADLAND, Drive

BEYOND = (40.0, 0.0)


def ask(request: AnyRequest | RequestWord, id: str) -> RequestEvent:
    """A request that somebody sends under an id, which is the name, too."""
    event = asking.ask(request, id)
    return msgspec.structs.replace(event, request=msgspec.structs.replace(event.request, id=id))


def step(
    drive: Drive, where: tuple[float, float], *events: RequestEvent, v_mps: float = 0.0
) -> dict[str, Fact | None]:
    """One tick; why each request that is answered in it was refused, by its id."""
    drive.t_s += 0.02
    here: Estimate = msgspec.structs.replace(at(*where, drive.t_s), v_mps=v_mps)
    answers = drive.mission.step(here, events).status.answers
    return {answer.id: answer.fact for answer in answers}


def test_two_people_in_one_tick_are_each_told_their_own_outcome() -> None:
    drive = Drive()
    where = drive.into_row(0)
    bad_goal = ask(GoTo(x_map_m=1.0, y_map_m=math.nan), "Ann")
    good_speed = ask(ChangeSetting(setting="mission.speed_mps", value=0.3), "Bob")
    for events in ((bad_goal, good_speed), (good_speed, bad_goal)):
        told = step(drive, where, *events)
        assert told == {"Ann": ErrandRefused("goal", GoalNotFinite()), "Bob": None}


def test_each_answer_is_given_once_and_none_without_an_id() -> None:
    drive = Drive()
    where = drive.into_row(0)
    assert step(drive, where, ask("pause", "Ann"), ask("note", "")) == {"Ann": None}
    assert step(drive, where) == {}


def test_a_goal_is_answered_when_the_robot_stands_and_has_planned_its_way() -> None:
    drive = Drive()
    where = drive.into_row(0)
    assert step(drive, where, ask(go_to(HEADLAND), "Ann"), v_mps=0.4) == {}
    assert step(drive, where, v_mps=0.2) == {}
    assert step(drive, where) == {"Ann": None}


def test_a_goal_that_cannot_be_reached_is_refused_to_who_asked_for_it() -> None:
    drive = Drive()
    told = step(drive, drive.into_row(0), ask(go_to(BEYOND), "Ann"))
    assert isinstance(told["Ann"], ErrandRefused)
    assert isinstance(told["Ann"].cause, BeyondFence)


@pytest.mark.parametrize("other", [go_to(HEADLAND), "pause", "cancel", TakePlan(geojson="2")])
def test_who_asked_before_is_told_that_something_else_is_wanted(
    other: AnyRequest | RequestWord,
) -> None:
    drive = Drive()
    where = drive.into_row(0)
    step(drive, where, ask(go_to(HEADLAND), "Ann"), v_mps=0.4)
    told = step(drive, where, ask(other, "Bob"))
    assert told == {"Ann": ErrandRefused("goal", AskedElse()), "Bob": None}


def test_two_goals_in_one_tick_are_answered_both() -> None:
    drive = Drive()
    told = step(
        drive, drive.into_row(0), ask(go_to((1.0, 9.0)), "Ann"), ask(go_to(HEADLAND), "Bob")
    )
    assert told == {"Ann": ErrandRefused("goal", AskedElse()), "Bob": None}


def test_a_stopped_robot_refuses_what_would_move_it_and_takes_the_rest() -> None:
    drive = Drive()
    where = drive.into_row(0)
    step(drive, where, ask("stop", "Cid"))
    told = step(drive, where, ask("resume", "Ann"), ask("pause", "Bob"))
    assert told == {"Ann": NotResumed(StopHolds()), "Bob": None}


def test_a_mission_that_has_ended_refuses_what_it_does_not_hear_any_more() -> None:
    drive = Drive()
    where = drive.into_row(0)
    step(drive, where, ask("cancel", "Cid"))
    told = step(drive, where, ask("resume", "Ann"), ask("mark", "Bob"))
    assert told == {"Ann": NotResumed(MissionEnded()), "Bob": None}


def test_what_was_recorded_without_answers_is_still_read() -> None:
    status = (
        b'{"state":"running","reason":"","row":0,"rows_total":6,"rows_done":[],"s_m":0.0,'
        b'"length_m":1.0,"waypoints_total":0,"waypoints_reached":0}'
    )
    assert msgspec.json.decode(status, type=MissionStatus).answers == ()
    assert RequestAnswer(id="a").refusal == ""
