"""What board is at a line: it is heard first, then asked for its version."""

from __future__ import annotations

import re
from collections.abc import Callable

import msgspec

from agribot.core.fact_text import render
from agribot.core.facts import BoardStopped
from agribot.drivers.board.agribot_board import CAUSES
from agribot.drivers.board.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board.board_protocol import (
    LAYOUT,
    AskVersion,
    BoardImu,
    BoardKind,
    BoardMessage,
    BoardState,
    BoardVersion,
)
from agribot.drivers.imu.imu_devices import ASK_AGAIN_S, BEGINS_S
from agribot.drivers.line.byte_streams import ByteStream

LONGEST_LINE = 200
PATIENCE_S = 5.0  # a bootloader lets the program begin after one
BAUDS = {BoardKind.MOTOR: 250_000, BoardKind.IMU: 57_600}
_LINE = re.compile(rb"A-?\d+B-?\d+C-?\d+D")  # line of an IMU board that speaks by itself


class FoundBoard(msgspec.Struct, frozen=True, kw_only=True):
    """A found board, and its last words; None of what it did not say."""

    version: BoardVersion
    state: BoardState | None = None
    imu: BoardImu | None = None

    @property
    def is_understood(self) -> bool:
        """Whether its program has the table of messages that this one has."""
        return self.version.layout == LAYOUT


class BoardListener:
    """Listener to a board on a line that was just opened, with the questions that it may be asked.

    Nothing is sent to what is silent: it may be a board in its bootloader. An IMU board that was
    asked goes on in frames.
    """

    def __init__(self, opened_s: float) -> None:
        self._asked_s = opened_s + BEGINS_S - ASK_AGAIN_S
        self._decoder, self._encoder = BoardDecoder(), BoardEncoder()
        self._text = b""
        self._speaks = False
        self._said: dict[type[BoardMessage], BoardMessage] = {}
        self.has_printed = self.has_framed = False
        self.bytes = 0  # bytes received in all

    def feed(self, data: bytes) -> None:
        """Take what came, which may be nothing."""
        self.bytes += len(data)
        frames = self._decoder.feed(data)
        self._said.update({type(frame.message): frame.message for frame in frames})
        self._text = (self._text + data)[-LONGEST_LINE:] if data else b""
        is_printing = _LINE.search(self._text) is not None
        self._speaks = bool(frames) or is_printing
        self.has_framed |= bool(frames)
        self.has_printed |= is_printing

    def take_to_send(self, now_s: float) -> bytes:
        """Make the question for its version, if it speaks now and was not just asked."""
        if not self._speaks or now_s - self._asked_s < ASK_AGAIN_S:
            return b""
        self._asked_s = now_s
        return b"\0" + self._encoder.encode(AskVersion())[1]

    def forget_state(self) -> None:
        """Forget how the board was; what it is, it stays."""
        self._said = {kind: said for kind, said in self._said.items() if kind is BoardVersion}
        self.has_framed = False

    def find(self) -> FoundBoard | None:
        """Return what the board is; None before it reported its version."""
        version = self._said.get(BoardVersion)
        state, imu = self._said.get(BoardState), self._said.get(BoardImu)
        if not isinstance(version, BoardVersion):
            return None
        return FoundBoard(
            version=version,
            state=state if isinstance(state, BoardState) else None,
            imu=imu if isinstance(imu, BoardImu) else None,
        )


class BoardProbe:
    """A line that was just opened, and what the board says there."""

    def __init__(self, stream: ByteStream, now_s: Callable[[], float]) -> None:
        self._stream, self._now_s, self._opened_s = stream, now_s, now_s()
        self._board = BoardListener(self._opened_s)

    def ask(self, patience_s: float = PATIENCE_S) -> FoundBoard | None:
        """Ask the board what it is; None where none speaks that understands.

        Raises: OSError: the line broke.
        """
        while self._now_s() - self._opened_s < patience_s:
            self._board.feed(self._stream.read())
            question = self._board.take_to_send(self._now_s())
            if question:
                self._stream.write(question)
            found = self._board.find()
            if found is not None and (found.state or found.imu):
                return found
        return self._board.find()

    def listen(self, seconds: float) -> FoundBoard | None:
        """Go on reading for a while and return what the board said; None if it said nothing.

        Raises: OSError: the line broke.
        """
        self._board.forget_state()
        until_s = self._now_s() + seconds
        while self._now_s() < until_s:
            self._board.feed(self._stream.read())
        return self._board.find() if self._board.has_framed else None

    @property
    def bytes(self) -> int:
        """Count of bytes that came in all."""
        return self._board.bytes


def describe_board(found: FoundBoard) -> str:
    """Say in words which board it is, its firmware, and how it is."""
    version = found.version
    words = [f"{version.board.name.lower()} board, firmware {'.'.join(map(str, version.firmware))}"]
    if not found.is_understood:
        words.append(
            f"of another table of messages (layout {version.layout:#06x}); flash it: agribot board "
            f"flash {version.board.name.lower()}"
        )
        return ", ".join(words)  # any other answer means something else there
    if found.state is not None:
        words += _describe_state(found.state)
    if found.imu is not None:
        x, y, z = found.imu.accel_mps2
        words.append(f"acceleration {x:.2f}, {y:.2f}, {z:.2f} m/s2")
        words.append("turns at {:.2f}, {:.2f}, {:.2f} rad/s".format(*found.imu.gyro_radps))
    elif version.board is BoardKind.IMU:
        words.append("its chip does not answer; check the wires of the IMU")
    return ", ".join(words)


def _describe_state(state: BoardState) -> list[str]:
    causes = tuple(cause for bit, cause in CAUSES.items() if bit in state.stop_causes)
    flags = [flag.name or "" for flag in type(state.flags) if flag in state.flags]
    return [
        f"battery {state.battery_v:.1f} V",
        f"stopped: {render(BoardStopped(causes))}" if causes else "not stopped",
        *(name.lower().replace("_", " ") for name in flags if name != "STOP_LATCHED"),
        f"counts {' '.join(map(str, state.counts))}",
    ]
