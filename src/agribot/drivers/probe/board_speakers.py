"""Boards by what they say: the motor and the IMU board, and the original's Arduino."""

from __future__ import annotations

import math
import re

from agribot.drivers.board.board_protocol import BoardFlag, BoardKind
from agribot.drivers.board.rosserial import STRING, RosserialHost
from agribot.drivers.probe.board_probe import BoardListener, FoundBoard, describe_board
from agribot.drivers.probe.line_answers import LineAnswer

FRAMES_S = 1.5  # a board of ours that reported its version goes on in frames within that
ANSWER_S = 4.0  # time for an answer: a board is asked after two seconds, and again after one
LISTEN_S = 3.0  # time for the topics of a rosserial device
_PACKET = re.compile(rb"\xff\xfe(..)(.)", re.DOTALL)


class BoardSpeaker:
    """A board of ours, or one that prints the lines of the original's, for ROS or for anybody."""

    def __init__(self, opened_s: float) -> None:
        self._board = BoardListener(opened_s)
        self._publisher = RosserialSpeaker(opened_s, may_ask=False)
        self._heard_s = self._named_s = math.inf

    @property
    def is_heard(self) -> bool:
        return self._heard_s < math.inf

    def feed(self, data: bytes, now_s: float) -> None:
        self._board.feed(data)
        self._publisher.feed(data, now_s)
        if self._board.has_framed or self._board.has_printed:
            self._heard_s = min(self._heard_s, now_s)
        if self._board.find() is not None:
            self._named_s = min(self._named_s, now_s)

    def take_to_send(self, now_s: float) -> bytes:
        if self._board.find() is not None:
            return b""
        return self._board.take_to_send(now_s) + self._publisher.take_to_send(now_s)

    def is_done(self, now_s: float) -> bool:
        found = self._board.find()
        if found is None:
            return now_s - self._heard_s > ANSWER_S
        return bool(found.state or found.imu) or now_s - self._named_s > FRAMES_S

    def answer(self, baud: int) -> LineAnswer:
        found = self._board.find()
        if found is not None:
            return _describe_board(found, baud)
        if self._publisher.is_heard:
            return self._publisher.answer(baud)
        if self._board.has_printed:
            return LineAnswer(
                kind="letter imu", baud=baud, use="imu",
                detail=f"prints the lines of the original's IMU at {baud} baud",
                advice=("say how it is mounted: axes=x,-y,-z for one upside down",),
            )  # fmt: skip
        return LineAnswer(
            kind="unknown", baud=baud, is_good=False,
            detail=f"frames of a board of ours at {baud} baud, but it does not report its version",
            advice=("flash it: agribot board flash motor, or imu",),
        )  # fmt: skip


def _describe_board(found: FoundBoard, baud: int) -> LineAnswer:
    version, is_motor = found.version, found.version.board is BoardKind.MOTOR
    flags = found.state.flags if found.state else found.imu.flags if found.imu else BoardFlag(0)
    has_imu = found.imu is not None and BoardFlag.IMU_FAULT not in flags
    return LineAnswer(
        kind="motor board" if is_motor else "imu board", baud=baud,
        detail=describe_board(found), use="base" if is_motor else "imu",
        options=() if is_motor else (("board", "agribot"),),
        is_good=found.is_understood and (is_motor or found.imu is not None),
        numbers={
            "firmware": ".".join(map(str, version.firmware)), "layout": version.layout,
            "flags": [flag.name for flag in BoardFlag if flag in flags], "has_imu": has_imu,
            **({"battery_v": round(found.state.battery_v, 3)} if found.state else {}),
        },
    )  # fmt: skip


class RosserialSpeaker:
    """An Arduino that publishes for ROS; it is silent until a host asks it.

    It is asked for its topics once it speaks, or with `may_ask` where it is silent.
    """

    def __init__(self, opened_s: float, *, may_ask: bool) -> None:
        self._host, self._may_ask = RosserialHost(), may_ask
        self._host.open(opened_s)
        self._tail = b""
        self._heard_s = math.inf

    @property
    def is_heard(self) -> bool:
        return bool(self._host.topics)

    def feed(self, data: bytes, now_s: float) -> None:
        self._host.feed(data, now_s)
        self._tail = (self._tail + data)[-4096:]
        self._may_ask |= any(
            (sum(match[1]) + match[2][0]) % 256 == 255 for match in _PACKET.finditer(self._tail)
        )
        if self._host.topics:
            self._heard_s = min(self._heard_s, now_s)

    def take_to_send(self, now_s: float) -> bytes:
        data = self._host.take_to_send()
        return data if self._may_ask else b""

    def is_done(self, now_s: float) -> bool:
        return now_s - self._heard_s > LISTEN_S

    def answer(self, baud: int) -> LineAnswer:
        topics = self._host.topics.values()
        named = ", ".join(sorted(f"{topic.name} ({topic.message_type})" for topic in topics))
        is_imu = any(topic.message_type == STRING for topic in topics)
        return LineAnswer(
            kind="rosserial imu" if is_imu else "rosserial device", baud=baud,
            detail=f"publishes for ROS at {baud} baud: {named}", is_good=is_imu,
            use="imu" if is_imu else "", options=(("board", "rosserial"),) if is_imu else (),
            advice=() if is_imu else (f"none of its topics is the text of an IMU ({STRING})",),
        )  # fmt: skip
