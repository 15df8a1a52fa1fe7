"""A host of rosserial hears the topics of an Arduino, whatever else is on its line."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.drivers.board import rosserial
from agribot.drivers.board.rosserial import RosserialHost, TopicMessage, make_packet, read_string
from tests.drivers.rosserial_bytes import IMU, LINE, make_message, make_text, make_topic


def test_a_packet_is_as_the_protocol_says() -> None:
    assert make_packet(0, b"") == b"\xff\xfe\x00\x00\xff\x00\x00\xff"
    assert make_packet(10, b"\x01\x02") == b"\xff\xfe\x02\x00\xfd\x0a\x00\x01\x02\xf2"


def test_a_topic_that_was_told_gives_its_messages() -> None:
    host = RosserialHost()
    assert host.feed(b"", 0.0) == []
    assert host.take_to_send() == make_packet(0, b"") and host.take_to_send() == b""
    (message,) = host.feed(make_topic() + make_message(), 0.1)
    assert message.topic == IMU and read_string(message) == LINE
    assert (host.bad, host.skipped) == (0, 0)


def test_a_host_asks_again_until_a_device_tells_its_topics() -> None:
    host = RosserialHost()
    asked = 0
    for tenth in range(100):
        assert host.feed(make_message(), 0.1 * tenth) == []
        asked += bool(host.take_to_send())
    assert asked == 5


def test_a_device_that_asks_for_the_time_gets_it() -> None:
    host = RosserialHost()
    host.feed(b"", 0.0)
    host.take_to_send()
    host.feed(make_packet(rosserial.TIME, b""), 1_700_000_000.25)
    sent = host.take_to_send()
    assert make_packet(rosserial.TIME, struct.pack("<II", 1_700_000_000, 250_000_000)) in sent


@given(
    st.lists(
        st.text(st.characters(codec="ascii"), max_size=60) | st.just(LINE), min_size=1, max_size=8
    ),
    st.integers(1, 50),
    st.binary(max_size=40).filter(lambda junk: 0xFF not in junk),
)
def test_messages_survive_any_cutting_and_the_text_that_is_printed_between_them(
    texts: list[str], size: int, junk: bytes
) -> None:
    host = RosserialHost()
    data = make_topic() + b"".join(junk + make_message(text) + junk for text in texts)
    found = [
        message
        for at in range(0, len(data), size)
        for message in host.feed(data[at : at + size], 1.0)
    ]
    assert [read_string(message) for message in found] == texts
    assert host.bad == 0 and host.skipped <= 2 * len(junk) * len(texts)


def test_a_broken_byte_costs_one_message_and_is_counted() -> None:
    data = make_message("first") + make_message("second") + make_message("third")
    size = len(make_message("first"))
    for at in range(size, size + len(make_message("second"))):
        host = RosserialHost()
        host.feed(make_topic(), 0.0)
        broken = data[:at] + bytes([data[at] ^ 0x11]) + data[at + 1 :]
        texts = [read_string(message) for message in host.feed(broken, 0.1)]
        assert texts in (["first", "third"], ["first", "second", "third"])
        assert texts[1] == "third", "no text that was not sent"
        assert host.bad + host.skipped > 0


def test_random_bytes_give_no_message_and_take_no_memory() -> None:
    rng, host = random.Random(1), RosserialHost()
    host.feed(make_topic(), 0.0)
    found = [m for _ in range(250) for m in host.feed(rng.randbytes(1000), 0.0)]
    assert found == []
    assert len(host._waiting) < 4096
    for _ in range(3):  # what still waits for its end may swallow the first
        found += host.feed(make_message() * 40, 0.0)
    assert read_string(found[-1]) == LINE


@pytest.mark.parametrize(
    "message",
    [
        TopicMessage(IMU, b"\x09\x00\x00\x00short"),
        TopicMessage(IMU, b"\x01"),
        TopicMessage(IMU._replace(message_type="std_msgs/Int16"), make_text(LINE)),
        TopicMessage(IMU, b"\x01\x00\x00\x00\xff"),
    ],
)
def test_what_is_no_whole_text_is_refused(message: TopicMessage) -> None:
    with pytest.raises(ValueError, match=r"cut off|not std_msgs|utf-8"):
        read_string(message)


def test_a_topic_that_makes_no_sense_is_counted() -> None:
    host = RosserialHost()
    host.feed(make_packet(rosserial.PUBLISHER, b"\x7d\x00\xff\xff\xff\xff"), 0.0)
    host.feed(make_packet(rosserial.PUBLISHER, b"\x7d\x00\x01\x00\x00\x00\xff" + bytes(8)), 0.0)
    assert not host.topics and host.bad == 2
