"""A serial line without time of its own, whose device is understood at its own speed alone."""

from __future__ import annotations

import datetime as dt
import math
import random
from collections.abc import Callable

from tests.drivers import receiver_bytes as written
from tests.drivers.board_emulator import TICK_S, BoardEmulator

READ_S = 0.05
Device = Callable[[bytes, float], bytes]  # what it heard and the time, to what it says


class TunedLine:
    """Reading lets time pass. At a wrong speed both ends hear nonsense."""

    def __init__(self, device: Device, baud: int) -> None:
        self._device, self._baud, self._rng = device, baud, random.Random(1)
        self.t_s, self.sent = 0.0, b""
        self.first_sent_s = math.inf
        self.bauds: list[int] = []
        self._waiting = b""

    def now_s(self) -> float:
        return self.t_s

    def set_baud(self, baud: int) -> None:
        self.bauds.append(baud)

    def read(self) -> bytes:
        self.t_s += READ_S
        heard, self._waiting = self._waiting, b""
        said = self._device(heard, self.t_s)
        if self.bauds[-1:] == [self._baud]:
            return said
        return self._rng.randbytes(len(said) * self.bauds[-1] // self._baud)

    def write(self, data: bytes) -> None:
        self.sent += data
        self.first_sent_s = min(self.first_sent_s, self.t_s)
        is_right = self.bauds[-1] == self._baud
        self._waiting += data if is_right else self._rng.randbytes(len(data))

    def close(self) -> None:
        """Nothing to let go."""


def be_silent(heard: bytes, t_s: float) -> bytes:
    return b""


class MegaWithMotorBoard:
    """The motor board behind the bootloader of a Mega, which begins when its line is opened.

    A byte within the first second makes the bootloader wait for a program for good.
    """

    BOOTS_S = 1.2

    def __init__(self) -> None:
        self.board, self.is_spoiled = BoardEmulator(), False
        self._ticks = 0

    def __call__(self, heard: bytes, t_s: float) -> bytes:
        self.is_spoiled |= bool(heard) and t_s < self.BOOTS_S
        if t_s < self.BOOTS_S or self.is_spoiled:
            return b""
        self.board.feed(heard)
        out = b""
        while self._ticks * TICK_S < t_s - self.BOOTS_S:
            self._ticks += 1
            out += self.board.advance()
        return out


class SpeakingReceiver:
    """A receiver that says the messages of an epoch once in a period."""

    def __init__(
        self, say: Callable[[dt.datetime], bytes], period_s: float, version: bytes = b""
    ) -> None:
        self._say, self._period_s, self._version = say, period_s, version
        self._epochs = 0

    def __call__(self, heard: bytes, t_s: float) -> bytes:
        out = self._version if b"\xb5\x62\x0a\x04" in heard else b""
        while self._epochs * self._period_s <= t_s:
            at = written.EPOCH + dt.timedelta(seconds=self._epochs * self._period_s)
            out += self._say(at)
            self._epochs += 1
        return out
