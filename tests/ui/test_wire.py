"""The page's messages: one module says what crosses the wire, and the page's side follows it."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest

from agribot.ui import wire
from tests.ui.messages import make_state, make_weed

ROOT = Path(__file__).parents[2]
WRITE_FILES: Callable[[], dict[Path, str]] = runpy.run_path(
    str(ROOT / "scripts" / "generate_wire.py")
)["write_files"]


def test_what_is_generated_for_the_page_is_up_to_date() -> None:
    for path, text in WRITE_FILES().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run `make generate`"


def test_every_message_of_one_direction_has_a_kind_of_its_own() -> None:
    unions: tuple[Any, ...] = (
        wire.PageMessage, wire.ServerMessage, wire.RobotMessage, wire.RobotOrder, wire.Question,
    )  # fmt: skip
    for union in unions:
        kinds = [one.__struct_config__.tag for one in get_args(union)]
        assert len(set(kinds)) == len(kinds)
        assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", kind) for kind in kinds)


def test_whatever_asks_for_an_answer_carries_an_id_and_the_answer_the_same_one() -> None:
    assert all(issubclass(one, wire.Request) for one in get_args(wire.PageRequest))
    for one in (wire.Verdict, wire.Ask, wire.Answer):
        assert "id" in one.__struct_fields__


def test_a_state_and_the_weeds_come_back_from_the_wire_as_they_were() -> None:
    weeds = wire.WeedChanges(epoch=7, set=[make_weed(3), make_weed(4)], gone=[1])
    for message in (make_state(5), weeds):
        assert wire.read_server_message(wire.encode(message)) == message
        assert wire.read_robot_message(wire.encode(message)) == message


def test_a_weed_costs_no_more_than_its_columns() -> None:
    row = msgspec.json.decode(msgspec.json.encode(make_weed(3)))
    assert row == [3, 0, 1.0, 2.0, 0.02, 0.9, 0.001, 4, 1.0, 2.0, None, ""]


@pytest.mark.parametrize(
    ("text", "reason", "id"),
    [
        ('{"kind":"go_to","id":"a","x_map_m":"1","y_map_m":2}', "x_map_m", "a"),
        ('{"kind":"fly","id":"b"}', "fly", "b"),
        ('{"kind":"press_stop","id":3}', "id", ""),
        ("[1]", "object", ""),
        ("{", "not JSON", ""),
        ('{"kind":"draw_shape","shape":' + "[" * 60_000, "", ""),
        ('{"kind":"go_to","x_map_m":1e999,"y_map_m":2}', "range", ""),
    ],
)
def test_what_is_no_message_is_refused_with_what_is_wrong_and_by_its_id(
    text: str, reason: str, id: str
) -> None:
    with pytest.raises(wire.BadMessage) as refusal:
        wire.read_page_message(text)
    assert reason in str(refusal.value)
    assert refusal.value.id == id


def test_a_sender_may_leave_out_what_has_a_usual_value() -> None:
    assert wire.read_page_message('{"kind":"press_stop"}') == wire.PressStop()
    assert wire.read_page_message('{"kind":"take_seat","id":"1"}') == wire.TakeSeat(id="1")
