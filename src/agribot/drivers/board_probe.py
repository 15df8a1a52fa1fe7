"""What board is at a line: it is heard first, then asked for its version."""

from __future__ import annotations

import re
from collections.abc import Callable

import msgspec

from agribot.drivers.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board_protocol import (
    AskVersion,
    BoardImu,
    BoardKind,
    BoardMessage,
    BoardState,
    BoardVersion,
)
from agribot.drivers.byte_streams import ByteStream
from agribot.drivers.imu_devices import ASK_AGAIN_S, BEGINS_S

LONGEST_LINE = 200
PATIENCE_S = 5.0  # a bootloader lets the program begin after one
BAUDS = {BoardKind.MOTOR: 250_000, BoardKind.IMU: 57_600}
_LINE = re.compile(rb"A-?\d+B-?\d+C-?\d+D")  # of an IMU board that nobody has asked


class FoundBoard(msgspec.Struct, frozen=True, kw_only=True):
    """What a board is, and its last words; None of what it did not say."""

    version: BoardVersion
    state: BoardState | None = None
    imu: BoardImu | None = None


class BoardProbe:
    """A line that was just opened, and what the board says there.

    Nothing is sent to what is silent: it may be a board in its bootloader. An IMU board that was
    asked goes on in frames.
    """

    def __init__(self, stream: ByteStream, now_s: Callable[[], float]) -> None:
        self._stream, self._now_s, self._opened_s = stream, now_s, now_s()
        self._asked_s = self._opened_s + BEGINS_S - ASK_AGAIN_S
        self._decoder, self._encoder = BoardDecoder(), BoardEncoder()
        self._text = b""
        self._said: dict[type[BoardMessage], BoardMessage] = {}

    def ask(self, patience_s: float = PATIENCE_S) -> FoundBoard | None:
        """Ask the board what it is; None where none speaks that understands.

        Raises: OSError: the line broke.
        """
        while self._now_s() - self._opened_s < patience_s:
            speaks = self._hear()
            if speaks and self._now_s() - self._asked_s >= ASK_AGAIN_S:
                self._asked_s = self._now_s()
                self._stream.write(b"\0" + self._encoder.encode(AskVersion())[1])
            found = self._find()
            if found is not None and (found.state or found.imu):
                return found
        return self._find()

    def listen(self, seconds: float) -> FoundBoard | None:
        """Go on hearing for a while, and tell what was said last.

        Raises: OSError: the line broke.
        """
        until_s = self._now_s() + seconds
        while self._now_s() < until_s:
            self._hear()
        return self._find()

    def _hear(self) -> bool:
        """Take what came; whether that was a board of ours."""
        data = self._stream.read()
        frames = self._decoder.feed(data)
        self._said.update({type(frame.message): frame.message for frame in frames})
        self._text = (self._text + data)[-LONGEST_LINE:] if data else b""
        return bool(frames) or _LINE.search(self._text) is not None

    def _find(self) -> FoundBoard | None:
        version = self._said.get(BoardVersion)
        state, imu = self._said.get(BoardState), self._said.get(BoardImu)
        if not isinstance(version, BoardVersion):
            return None
        return FoundBoard(
            version=version,
            state=state if isinstance(state, BoardState) else None,
            imu=imu if isinstance(imu, BoardImu) else None,
        )
