"""What a board says arrives as it was meant, or not at all and counted."""

from __future__ import annotations

import random
import time
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agribot.drivers.board import board_protocol as table
from agribot.drivers.board.board_codec import (
    FORMATS,
    BoardDecoder,
    BoardEncoder,
    BoardFrame,
    encode,
    stuff,
    unstuff,
)
from tests.drivers.board_bytes import make_all, make_line, make_state

RANGES = {
    "u8": (0, 255), "i8": (-128, 127), "u16": (0, 65535), "i16": (-32768, 32767),
    "u32": (0, 2**32 - 1), "i32": (-(2**31), 2**31 - 1),
}  # fmt: skip


@st.composite
def messages(draw: st.DrawFn, sender: str = "board") -> table.BoardMessage:
    """Draw any message of one end whose fields carry any numbers that fit the line."""
    kinds = [message for message in table.MESSAGES if message.sender == sender]
    message = draw(st.sampled_from(kinds))
    values: dict[str, Any] = {}
    for name, wire, python_type in table.list_fields(message):
        if issubclass(python_type, table.AckResult | table.BoardKind):
            values[name] = draw(st.sampled_from(list(python_type)))
            continue
        numbers = [draw(st.integers(*RANGES[wire.kind])) for _ in range(wire.length)]
        scaled = [one if wire.scale == 1.0 else one * wire.scale for one in numbers]
        if python_type is int:
            scaled = [round(one) for one in scaled]
        make: Any = python_type
        values[name] = tuple(scaled) if wire.length > 1 else make(scaled[0])
    made: table.BoardMessage = FORMATS[message.number].message(**values)
    return made


@given(st.binary(max_size=600))
def test_stuffed_bytes_have_no_zero_and_come_back(data: bytes) -> None:
    stuffed = stuff(data)
    assert 0 not in stuffed
    assert unstuff(stuffed) == data
    assert len(stuffed) <= len(data) + len(data) // 254 + 1


@given(st.binary(max_size=300))
@example(b"\x0b" + bytes(10))
def test_any_bytes_unstuff_to_what_stuffs_back_or_to_nothing(data: bytes) -> None:
    found = unstuff(data)
    if found is not None and 0xFF not in data:
        assert stuff(found) == (data or b"\x01")


@given(st.sampled_from(["host", "board"]).flatmap(messages), st.integers(0, 255))
def test_every_message_comes_back_as_it_was_sent(message: table.BoardMessage, seq: int) -> None:
    decoder = BoardDecoder(message.sender)
    (frame,) = decoder.feed(encode(seq, message))
    assert frame == BoardFrame(seq, message)
    assert (decoder.bad, decoder.unknown, decoder.lost) == (0, 0, 0)


@given(st.lists(messages(), min_size=1, max_size=12), st.integers(1, 90))
def test_frames_survive_any_cutting(sent: list[table.BoardMessage], size: int) -> None:
    encoder, decoder = BoardEncoder(), BoardDecoder()
    data = b"".join(encoder.encode(message)[1] for message in sent)
    found = [f for k in range(0, len(data), size) for f in decoder.feed(data[k : k + size])]
    assert [frame.message for frame in found] == sent
    assert (decoder.bad, decoder.lost) == (0, 0)


def test_who_joins_in_the_middle_loses_only_the_frame_that_he_missed() -> None:
    frames, sent = make_line(4)
    data = b"".join(frames)
    for cut in range(1, len(frames[0])):
        decoder = BoardDecoder()
        found = decoder.feed(data[cut:])
        assert found[-3:] == sent[1:]
        assert (decoder.bad, decoder.lost) == (0, 0)


def test_a_broken_bit_anywhere_costs_its_frame_and_at_most_the_next_and_is_counted() -> None:
    frames, sent = make_line(5)
    for bit in range(8 * len(frames[2])):
        broken = bytearray(frames[2])
        broken[bit // 8] ^= 1 << bit % 8
        decoder = BoardDecoder()
        found = decoder.feed(b"".join([*frames[:2], bytes(broken), *frames[3:]]))
        assert [f for f in found if f in sent] == found, "a frame that was not sent"
        assert found[:2] == sent[:2] and found[-1] == sent[4]
        assert decoder.bad >= 1
        assert decoder.lost == 5 - len(found)


@given(st.binary(max_size=3000), st.binary(max_size=3000))
def test_garbage_gives_no_message_and_the_next_whole_frame_is_found(a: bytes, b: bytes) -> None:
    decoder = BoardDecoder()
    assert decoder.feed(a) == decoder.feed(b"\0" + b + b"\0") == []
    frames, sent = make_line(1)
    assert decoder.feed(frames[0]) == sent


def test_a_million_random_bytes_neither_grow_nor_give_what_was_not_sent() -> None:
    rng = random.Random(1)
    decoder = BoardDecoder()
    found = [frame for _ in range(250) for frame in decoder.feed(rng.randbytes(4000))]
    # By chance one of 65536 broken frames passes the CRC, and its type must fit as well.
    assert len(found) == 0 and decoder.unknown <= 3
    assert decoder.bad > 3000


def test_a_stream_without_an_end_of_frame_takes_no_memory() -> None:
    decoder = BoardDecoder()
    for _ in range(1000):
        decoder.feed(b"\x55" * 4096)
    assert len(decoder._waiting) < 300
    frames, sent = make_line(1)
    assert decoder.feed(b"\0" + frames[0]) == sent


def test_frames_that_went_missing_are_counted_over_the_turn_of_the_numbers() -> None:
    frames, _ = make_line(600)
    kept = [frame for k, frame in enumerate(frames) if k % 100 != 50]
    decoder = BoardDecoder()
    decoder.feed(b"".join(kept))
    assert decoder.lost == 6


def test_a_frame_of_the_other_end_or_of_no_table_is_whole_but_unknown() -> None:
    decoder = BoardDecoder("host")
    assert decoder.feed(encode(0, make_state()) + encode(1, table.AskVersion())) == [
        BoardFrame(1, table.AskVersion())
    ]
    assert (decoder.unknown, decoder.bad, decoder.lost) == (1, 0, 0)


@pytest.mark.parametrize(
    ("change", "limit"),
    [
        ({"counts": (2**31, 0, 0, 0)}, "2.14748e\\+09"),
        ({"battery_v": 70.0}, "to 65.535"),
        ({"duty_ratio": (0.0, float("nan"), 0.0, 0.0)}, "to 1.27"),
    ],
)
def test_a_value_that_does_not_fit_the_line_is_refused(change: Any, limit: str) -> None:
    with pytest.raises(ValueError, match=limit):
        encode(0, make_state(**change))


def test_every_type_has_one_number_and_fits_a_frame() -> None:
    assert len(FORMATS) == len(table.MESSAGES)
    assert all(4 < kind.struct.size + 3 < 128 for kind in FORMATS.values())
    assert {m.number >= 0x80 for m in table.MESSAGES if m.sender == "board"} == {True}


def test_telemetry_takes_half_of_the_line_at_most() -> None:
    size = sum(FORMATS[m.number].struct.size + 4 for m in (table.BoardState, table.BoardImu))
    assert size * table.TELEMETRY_HZ * 10 < table.BAUD / 2


def test_a_second_of_the_line_takes_a_fiftieth_of_it_to_read() -> None:
    encoder, decoder = BoardEncoder(), BoardDecoder()
    state, _, imu, _ = make_all()
    pair = [encoder.encode(state)[1] + encoder.encode(imu)[1] for _ in range(300)]
    begun_s = time.process_time()
    found = [frame for data in pair for frame in decoder.feed(data)]
    rate_byteps = sum(map(len, pair)) / (time.process_time() - begun_s)
    assert len(found) == 600
    assert rate_byteps > 50 * table.BAUD / 10
