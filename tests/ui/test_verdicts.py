"""Requests wait for what the mission makes of them, and for no longer than a page does."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest

from agribot.autonomy.plan.errand import STOPPING
from agribot.core.messages import Inbox, OperatorEvent, TickRecord
from agribot.ui import verdicts
from agribot.ui.verdicts import Verdicts
from tests.record import record_samples as samples


def tick(inbox: Inbox, leg: str = "", refusal: str = "") -> TickRecord:
    record = samples.ticks(1)[0]
    events, _ = inbox.drain(record.batch.t_s)
    batch = msgspec.structs.replace(record.batch, events=events)
    status = msgspec.structs.replace(record.status, leg=leg, refusal=refusal)
    return msgspec.structs.replace(record, batch=batch, status=status)


def asked(action: str, legs: list[str], refusal: str) -> str:
    """The answer to a request while the mission goes through these legs, over and over."""
    inbox = Inbox()
    desk = Verdicts(inbox)
    event = OperatorEvent(t_s=0.0, action=action, source="Ada", numbers=(1.0, 2.0))  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(desk.ask, event)
        for number in range(1_000_000):
            if answer.done():
                break
            leg = legs[min(number, len(legs) - 1)]
            desk(tick(inbox, leg, "" if leg == STOPPING else refusal))
    return answer.result()


@pytest.mark.parametrize("refusal", ["", "goal refused: beyond the fence"])
def test_the_answer_comes_when_the_robot_stands_and_has_planned(
    refusal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 60.0)
    assert asked("goto", [STOPPING] * 20 + ["to the goal"], refusal) == refusal


def test_a_goal_that_takes_long_counts_as_taken_and_a_plan_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 0.3)
    assert asked("goto", [STOPPING], "") == ""
    assert "did not answer" in asked("plan", [STOPPING], "")


def test_a_robot_without_ticks_does_not_hold_up_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verdicts, "PATIENCE_S", 0.1)
    goal = OperatorEvent(t_s=0.0, action="goto", numbers=(1.0, 2.0))
    assert "did not answer" in Verdicts(Inbox()).ask(goal)
