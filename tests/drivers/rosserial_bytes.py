"""What an Arduino with the original's sketch sends to a rosserial host."""

from __future__ import annotations

import struct

from agribot.drivers.board import rosserial
from agribot.drivers.board.rosserial import RosserialTopic, make_packet

IMU = RosserialTopic("imu", rosserial.STRING, "992ce8a1687cec8c8bd883ec73ca41d1")
# As the original's library sends it: topic 125 is its first publisher.
NUMBER = 125
LINE = "A-7576B2476C-14524D-749E-4615F-459G"


def make_text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def make_topic(number: int = NUMBER, topic: RosserialTopic = IMU) -> bytes:
    content = struct.pack("<H", number) + b"".join(map(make_text, topic)) + struct.pack("<i", 512)
    return make_packet(rosserial.PUBLISHER, content)


def make_message(text: str = LINE) -> bytes:
    return make_packet(NUMBER, make_text(text))
