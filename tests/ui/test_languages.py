"""The server writes what the robot found in the language of each page, and keeps the facts."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from starlette.requests import Request

from agribot.core.fact_text import LANGUAGES, render
from agribot.core.facts import (
    ErrandRefused,
    GnssSilent,
    NoFixesYet,
    SeatNeeded,
    SensorSilent,
    StopHolds,
    StoppedBy,
    StopToClear,
)
from agribot.record.events import make_event
from agribot.ui import wire
from agribot.ui.server.answers import Unusable
from agribot.ui.server.channel import Channel
from agribot.ui.server.client import Client
from agribot.ui.server.languages import find_language, say_in
from agribot.ui.view import shown_event
from tests.ui.messages import make_state

STOP, HELD = StopToClear(StoppedBy("Ann")), SensorSilent("imu", 0.5, 0.3, "imu")
SILENT, AWAITED = GnssSilent(3.25), NoFixesYet()
REFUSED = ErrandRefused("goal", StopHolds())


def make_told() -> wire.State:
    """A state with a fact at every place that takes one."""
    return msgspec.structs.replace(
        make_state(1),
        stop=render(STOP),
        stop_fact=STOP,
        reason="words from outside",
        gate=wire.ShownGate(
            state="held", since_s=0.5, reason=render(HELD), reason_fact=HELD
        ),
        mission=wire.MissionProgress(
            state="paused", reason=render(STOP), reason_fact=STOP,
            refusal=render(REFUSED), refusal_fact=REFUSED,
        ),
        checks=[
            wire.StartCheck(name="imu", wrong=render(HELD), wrong_fact=HELD),
            wire.StartCheck(name="position", remark=render(AWAITED), remark_fact=AWAITED),
        ],
        doubts=[
            wire.SensorDoubt(
                sensor="gnss", state="silent", reason=render(SILENT), reason_fact=SILENT
            )
        ],
    )  # fmt: skip


def read_page(client: Client) -> dict[str, Any]:
    """What a page that has just come gets: the opening, then the newest state."""
    opening = msgspec.json.decode(client.take() or "")
    assert opening["kind"] == "snapshot"
    state: dict[str, Any] = msgspec.json.decode(client.take() or "")
    return state


def read_texts(state: dict[str, Any]) -> list[str]:
    """The texts of `make_told` in its order."""
    checks, doubts = state["checks"], state["doubts"]
    return [
        state["stop"], state["reason"], state["gate"]["reason"], state["mission"]["reason"],
        checks[0][1], checks[1][2], doubts[0]["reason"], state["mission"]["refusal"],
    ]  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_page_gets_every_text_in_its_language_and_no_fact(language: str) -> None:
    channel = Channel("sim")
    channel.publish_state(make_told())
    state = read_page(Client(channel, language=language))
    stop, held = render(STOP, language), render(HELD, language)
    assert read_texts(state) == [
        stop, "words from outside", held, stop, held, render(AWAITED, language),
        render(SILENT, language), render(REFUSED, language),
    ]  # fmt: skip
    assert (state["stop_kinds"], state["doubts"][0]["reason_kinds"]) == (STOP.kinds, SILENT.kinds)
    assert state["mission"]["reason_kinds"] == STOP.kinds and len(STOP.kinds) == 2
    assert state["checks"][0][3:5] == [HELD.kinds, []]
    assert b'"code"' not in msgspec.json.encode(state)
    assert b"_fact" not in msgspec.json.encode(state)


def test_pages_of_two_languages_follow_one_robot() -> None:
    channel = Channel("sim")
    german, english = Client(channel, language="de"), Client(channel)
    channel.clients |= {german, english}
    channel.publish_state(make_told())
    assert read_page(german)["stop"].startswith("angehalten von Ann;")
    assert read_page(english)["stop"] == render(STOP)
    live = wire.LiveState(mode="stopped", stop=render(STOP), stop_fact=STOP)
    german.send(live)
    assert "angehalten von Ann" in (german.take() or "")
    german.send(wire.Verdict(id="1", ok=False, reason=render(REFUSED), reason_fact=REFUSED))
    verdict = msgspec.json.decode(german.take() or "", type=wire.Verdict)
    assert verdict == wire.Verdict(id="1", ok=False, reason=render(REFUSED, "de"))


def test_the_log_has_the_facts_of_its_events_in_german() -> None:
    events = [
        make_event(1.0, "hold", render(HELD), HELD),
        make_event(2.0, "gate", f"driving -> held: {render(HELD)}", HELD, "held"),
        make_event(3.0, "row", "row 1", None),
        make_event(4.0, "clear", "", None),
    ]
    channel = Channel("sim")
    channel.publish_growth(wire.NewEvents(events=[shown_event(event) for event in events]))
    opening = msgspec.json.decode(Client(channel, language="de").take() or "")
    assert [(event["state"], event["text"]) for event in opening["events"]["events"]] == [
        ("", render(HELD, "de")), ("held", render(HELD, "de")), ("", "row 1"),
        ("", "no objection any more"),
    ]  # fmt: skip


def test_german_numbers_have_a_comma() -> None:
    (doubt,) = say_in("de", make_told()).doubts
    assert doubt.reason == "GNSS seit 3,2 s stumm"


def test_a_refused_request_is_answered_in_the_language_that_it_asks_for() -> None:
    headers = [(b"accept-language", b"de-DE,de;q=0.9")]
    answer = Unusable(409, SeatNeeded()).answer(Request({"type": "http", "headers": headers}))
    problem = msgspec.json.decode(bytes(answer.body), type=wire.Problem)
    assert (answer.status_code, problem.error) == (409, render(SeatNeeded(), "de"))


def test_a_page_that_asks_for_an_unknown_language_reads_english() -> None:
    assert [find_language(one) for one in ("hi", "xx", "")] == ["hi", "en", "en"]


def test_every_fact_of_a_message_stands_beside_its_text() -> None:
    structs = [one for one in vars(wire).values() if isinstance(one, type)]
    named = {
        (struct, field)
        for struct in structs
        if issubclass(struct, msgspec.Struct)
        for field in struct.__struct_fields__
        if field.endswith(wire.FACT)
    }
    assert len(named) >= 8
    for struct, field in named:
        assert field.removesuffix(wire.FACT) in struct.__struct_fields__, struct
