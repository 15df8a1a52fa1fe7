"""Requests wait for what the mission makes of them, and for no longer than a page does."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import msgspec
import pytest

from agribot.core.facts import BeyondFence, ErrandRefused, Fact, GoalNotFinite, NoAnswer
from agribot.core.messages import (
    AnyRequest,
    ChangeSetting,
    GoTo,
    Inbox,
    RequestAnswer,
    RequestEvent,
    TakePlan,
    TickRecord,
    Who,
)
from agribot.ui.robot_side import verdicts
from agribot.ui.robot_side.verdicts import Verdicts
from tests.autonomy.plan.planting import at
from tests.autonomy.plan.test_mission_errands import Drive
from tests.record import record_samples as samples

GOAL = GoTo(x_map_m=1.0, y_map_m=2.0)
BEYOND = ErrandRefused("goal", BeyondFence(1.0, 2.0, 0.3))
# None: not settled in this tick.
Outcome = Literal["taken"] | Fact | None


def tick(inbox: Inbox, heard: set[str], refusal: Outcome = None) -> TickRecord:
    """A tick that answers all requests until now, unless `refusal` is None."""
    record = samples.ticks(1)[0]
    events, _ = inbox.drain(record.batch.t_s)
    heard |= {event.request.id for event in events}
    fact = refusal if isinstance(refusal, Fact) else None
    answers = () if refusal is None else tuple(RequestAnswer(id=id, fact=fact) for id in heard)
    batch = msgspec.structs.replace(record.batch, requests=events)
    status = msgspec.structs.replace(record.status, answers=answers)
    return msgspec.structs.replace(record, batch=batch, status=status)


def find_answer(request: AnyRequest, refusals: list[Outcome]) -> Fact | None:
    """What a request gets as answer during these ticks, the last one repeated."""
    inbox, heard = Inbox(), set[str]()
    desk = Verdicts(inbox)
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(desk.ask, request, Who("Ada"))
        for number in range(1_000_000):
            if answer.done():
                break
            desk(tick(inbox, heard, refusals[min(number, len(refusals) - 1)]))
    return answer.result()


@pytest.mark.parametrize("refusal", ["taken", BEYOND])
def test_the_answer_comes_when_the_robot_stands_and_has_planned(
    refusal: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 60.0)
    answer = find_answer(GOAL, [*[None] * 20, refusal])
    assert answer == (BEYOND if refusal == BEYOND else None)


def test_a_goal_that_takes_long_counts_as_taken_and_a_plan_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 0.3)
    assert find_answer(GOAL, [None]) is None
    assert find_answer(TakePlan(geojson="a plan"), [None]) == NoAnswer(0.3)


def test_a_robot_without_ticks_does_not_hold_up_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 0.1)
    assert Verdicts(Inbox()).ask(GOAL, Who("Ada")) == NoAnswer(0.1)


def test_two_people_who_ask_in_one_tick_are_each_told_their_own_outcome() -> None:
    drive, inbox = Drive(), Inbox()
    desk, record = Verdicts(inbox), samples.ticks(1)[0]
    bad_goal = GoTo(x_map_m=1.0, y_map_m=math.nan)
    good_speed = ChangeSetting(setting="mission.speed_mps", value=0.3)
    with ThreadPoolExecutor(2) as pool:
        told = [pool.submit(desk.ask, request, Who("Ada")) for request in (bad_goal, good_speed)]
        events: tuple[RequestEvent, ...] = ()
        while len(events) < 2:
            events += inbox.drain(0.0)[0]
        goal = drive.mission.step(at(*drive.start, drive.t_s), events)
        batch = msgspec.structs.replace(record.batch, requests=events)
        desk(msgspec.structs.replace(record, batch=batch, status=goal.status))
        ann, bob = (answer.result() for answer in told)
    assert ann == ErrandRefused("goal", GoalNotFinite())
    assert bob is None
    assert drive.mission.speed_mps == 0.3
