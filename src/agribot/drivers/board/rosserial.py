"""The host of rosserial, without ROS: topics that an Arduino publishes over a serial line.

Source: wiki.ros.org/rosserial/Overview/Protocol, version 2 (ROS Hydro and later): 0xFF, 0xFE, size
u16, sum of it, topic u16, content, sum of both. An Arduino may print text between its packets, as
the original's does.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

SYNC = b"\xff\xfe"
LONGEST_CONTENT = 2048
PUBLISHER, SUBSCRIBER, LOG, TIME = 0, 1, 7, 10
FIRST_TOPIC = 100  # first number that is not one of the protocol's own
# Pause before the next question while no topic is known, and after a silence: longer than the
# second in which the bootloader of an Arduino would take the question for a program to flash.
ASK_AGAIN_S = 2.0
STRING = "std_msgs/String"
_HEAD_BYTES = 7


class RosserialTopic(NamedTuple):
    """A device's topic: its name, the type of its messages and their checksum."""

    name: str
    message_type: str
    md5: str


class TopicMessage(NamedTuple):
    """A message of a topic, as its bytes."""

    topic: RosserialTopic
    content: bytes


class RosserialHost:
    """Finds messages in a stream of bytes and says what has to be sent to the device.

    `bad` counts packets that were broken or made no sense, `skipped` the bytes between packets;
    `logs` holds what the device logged last.
    """

    def __init__(self) -> None:
        self.topics: dict[int, RosserialTopic] = {}
        self.logs: list[str] = []
        self.bad = self.skipped = 0
        self._waiting = bytearray()
        self._to_send = bytearray()
        self._asked_s = -ASK_AGAIN_S
        self._now_s = 0.0

    def open(self, now_s: float) -> None:
        """Begin with a device whose line was just opened, which resets an Arduino."""
        self._waiting.clear()
        self._to_send.clear()
        self._asked_s = now_s

    def feed(self, data: bytes, now_s: float) -> list[TopicMessage]:
        """Take what came until now; the time goes to a device that asks for it, Unix time."""
        self._now_s = now_s
        self._waiting += data
        found = []
        while packet := self._take_packet():
            message = self._handle(*packet)
            if message is not None:
                found.append(message)
                self._asked_s = now_s
        if now_s - self._asked_s >= ASK_AGAIN_S or now_s < self._asked_s:
            self._ask()
        return found

    def take_to_send(self) -> bytes:
        """Take the bytes that the device has to get."""
        data = bytes(self._to_send)
        self._to_send.clear()
        return data

    def _ask(self) -> None:
        self._asked_s = self._now_s
        self._to_send += make_packet(PUBLISHER, b"")

    def _take_packet(self) -> tuple[int, bytes] | None:
        waiting = self._waiting
        while True:
            start = waiting.find(SYNC)
            skipped = start if start >= 0 else len(waiting) - waiting.endswith(SYNC[:1])
            self.skipped += skipped
            del waiting[:skipped]
            if start < 0 or len(waiting) < _HEAD_BYTES:
                return None
            size = int.from_bytes(waiting[2:4], "little")
            if sum(waiting[2:5]) % 256 != 255 or size > LONGEST_CONTENT:
                self._drop()
                continue
            end = _HEAD_BYTES + size
            if len(waiting) <= end:
                return None
            if sum(waiting[5 : end + 1]) % 256 != 255:
                self._drop()
                continue
            packet = int.from_bytes(waiting[5:7], "little"), bytes(waiting[_HEAD_BYTES:end])
            del waiting[: end + 1]
            return packet

    def _drop(self) -> None:
        """Go on behind a false start, which may hide a whole packet."""
        self.bad += 1
        del self._waiting[:2]

    def _handle(self, topic: int, content: bytes) -> TopicMessage | None:
        if topic >= FIRST_TOPIC:
            return self._find_message(topic, content)
        if topic == TIME:
            seconds = int(self._now_s)
            nanoseconds = int((self._now_s - seconds) * 1e9)
            self._to_send += make_packet(TIME, struct.pack("<II", seconds, nanoseconds))
        elif topic == PUBLISHER:
            self._add_topic(content)
        elif topic == LOG:
            self.logs = [*self.logs[-99:], content[5:].decode(errors="replace")]
        elif topic != SUBSCRIBER:
            self.bad += 1
        return None

    def _find_message(self, topic: int, content: bytes) -> TopicMessage | None:
        """Ask again where the topic is unknown: another host started the device's topics."""
        known = self.topics.get(topic)
        if known is not None:
            return TopicMessage(known, content)
        if self._now_s - self._asked_s >= ASK_AGAIN_S:
            self._ask()
        return None

    def _add_topic(self, content: bytes) -> None:
        try:
            number, texts = int.from_bytes(content[:2], "little"), []
            rest = content[2:]
            for _ in range(3):
                text, rest = _take_text(rest)
                texts.append(text.decode())
        except (struct.error, ValueError):
            self.bad += 1
            return
        self.topics[number] = RosserialTopic(*texts)


def make_packet(topic: int, content: bytes) -> bytes:
    """Make a packet of either side."""
    size = len(content).to_bytes(2, "little")
    body = topic.to_bytes(2, "little") + content
    return SYNC + size + bytes([255 - sum(size) % 256]) + body + bytes([255 - sum(body) % 256])


def read_string(message: TopicMessage) -> str:
    """Read the text of a std_msgs/String.

    Raises: ValueError: it is of another type, cut off, or no UTF-8.
    """
    if message.topic.message_type != STRING:
        raise ValueError(
            f"topic {message.topic.name} carries {message.topic.message_type}, not {STRING}"
        )
    try:
        text, _ = _take_text(message.content)
    except struct.error as error:
        raise ValueError(f"a {STRING} of topic {message.topic.name} is cut off") from error
    return text.decode()


def _take_text(data: bytes) -> tuple[bytes, bytes]:
    (size,) = struct.unpack_from("<I", data)
    return struct.unpack_from(f"<{size}s", data, 4)[0], data[4 + size :]
