"""What is at a serial line: heard at one speed after the other, asked only where that is safe.

A board in its bootloader takes a byte for the first of a new program, so that what is silent is
sent nothing, unless its USB name says that it has no such bootloader, or a person says so. The
line is opened once: opening it resets an Arduino.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from agribot.drivers.imu.imu_devices import BEGINS_S
from agribot.drivers.line.byte_streams import ByteStream
from agribot.drivers.probe.board_probe import BAUDS
from agribot.drivers.probe.board_speakers import BoardSpeaker, RosserialSpeaker
from agribot.drivers.probe.controller_speakers import OdriveSpeaker, VescSpeaker
from agribot.drivers.probe.line_answers import LineAnswer, Speaker
from agribot.drivers.probe.receiver_speaker import ReceiverSpeaker

RECEIVER_BAUDS = (38_400, 115_200, 9_600, 230_400, 460_800, 921_600)
ALL_BAUDS = (*BAUDS.values(), *RECEIVER_BAUDS)
# At the first speed: a bootloader ends after one or two seconds, and a receiver speaks every one.
FIRST_S, NEXT_S = 3.5, 1.3
ASKING_S = 6.0  # time of a line that is asked while it is silent, for all who wait for a question
ASKED_BAUDS = (115_200, 57_600)
ODRIVE_LATER_S = 1.2  # delay after a VESC, whose bytes mean nothing to an ODrive
# Speed below which bytes may be no bytes at all at a higher speed, but a broken line.
SLOW_BAUD = 38_400
LIMIT_S = 40.0  # time limit of a line that does not stop to talk


class TunableStream(ByteStream, Protocol):
    """An open serial line whose speed can be changed."""

    def set_baud(self, baud: int) -> None: ...


def order_bauds(what: str) -> tuple[int, ...]:
    """Order the speeds by what a line seems to be: a device's `what`."""
    if "receiver" in what:
        first: tuple[int, ...] = RECEIVER_BAUDS
    elif "VESC" in what or "ODrive" in what:
        first = (115_200,)
    else:
        first = ALL_BAUDS
    return tuple(dict.fromkeys((*first, *ALL_BAUDS)))


def may_ask_silent(what: str) -> bool:
    """Return whether a silent device has no bootloader of an Arduino, by its USB name."""
    return "VESC" in what or what == "ODrive"


class LineProbe:
    """An open line, and what it takes to find out what is there."""

    def __init__(
        self, line: TunableStream, now_s: Callable[[], float],
        notify: Callable[[str], None] = lambda text: None, *, may_ask: bool = False,
        limit_s: float = LIMIT_S,
    ) -> None:  # fmt: skip
        """`notify` gets what is being tried; with `may_ask` also a silent device is asked."""
        self._line, self._now_s, self._notify = line, now_s, notify
        self._may_ask, self._opened_s = may_ask, now_s()
        self._until_s = self._opened_s + limit_s
        self._bytes = 0

    def find(self, bauds: tuple[int, ...]) -> LineAnswer:
        """Listen at the speeds in turn until something is understood.

        Raises: OSError: the line broke.
        """
        span_s = ASKING_S if self._may_ask else FIRST_S
        for baud in bauds:
            if self._is_silent(bauds, baud) or self._now_s() >= self._until_s:
                continue
            self._notify(f"listening at {baud} baud")
            self._line.set_baud(baud)
            answer = self._listen(baud, span_s)
            if answer is not None:
                return answer
            span_s = ASKING_S if self._may_ask else NEXT_S
        return self._give_up()

    def _is_silent(self, bauds: tuple[int, ...], baud: int) -> bool:
        """Return whether a speed need not be tried: none came at the first or a slow one."""
        tried = (bauds[0], SLOW_BAUD, *(ASKED_BAUDS if self._may_ask else ()))
        return not self._bytes and baud not in tried

    def _listen(self, baud: int, span_s: float) -> LineAnswer | None:
        begun_s = self._now_s()
        speakers = self._make_speakers()
        heard: Speaker | None = None
        while self._now_s() < self._until_s:
            data = self._line.read()
            self._bytes += len(data)
            for speaker in speakers:
                speaker.feed(data, self._now_s())
            heard = heard or next((one for one in speakers if one.is_heard), None)
            if heard is not None:
                speakers = [heard]
                if heard.is_done(self._now_s()):
                    break
            elif self._now_s() - begun_s > span_s:
                return None
            if self._now_s() - self._opened_s >= BEGINS_S:  # no bootloader listens any more
                for speaker in speakers:
                    self._send(speaker.take_to_send(self._now_s()))
        return heard.answer(baud) if heard is not None else None

    def _make_speakers(self) -> list[Speaker]:
        opened_s, may_ask = self._opened_s, self._may_ask
        begins_s = max(opened_s + BEGINS_S, self._now_s())
        return [
            BoardSpeaker(opened_s),
            ReceiverSpeaker(),
            VescSpeaker(begins_s, may_ask=may_ask),
            OdriveSpeaker(begins_s + ODRIVE_LATER_S, may_ask=may_ask),
            RosserialSpeaker(opened_s, may_ask=may_ask),
        ]

    def _send(self, data: bytes) -> None:
        if data:
            self._line.write(data)

    def _give_up(self) -> LineAnswer:
        if self._bytes:
            return LineAnswer(
                kind="unknown", is_good=False,
                detail=f"{self._bytes} bytes came that nothing here says, at any speed",
                advice=("check its wires, its ground and which program is in it",),
            )  # fmt: skip
        return LineAnswer(
            kind="silent", is_good=False,
            detail="says nothing" + (", and answers nothing" if self._may_ask else ""),
            advice=("check its power and its program",
                    *(() if self._may_ask else ("a VESC, an ODrive and an Arduino of ROS wait for "
                      "a question: if no Mega of ours is there, add --ask NODE",))),
        )  # fmt: skip
