"""A program's line to a running robot: the page's WebSocket, without a page."""

from __future__ import annotations

import contextlib
import math
import ssl
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, NamedTuple, Self

import msgspec

from agribot.core.errors import ConfigError, PlatformError
from agribot.ui.address import Door
from agribot.ui.line import Line

ANSWER_S = 5.0
PING_S, CLOCK_LASTS_S = 0.5, 30.0
OPEN_TIMEOUT_S = 30.0  # a small computer at its limit takes its time, most of all with TLS


class RobotClock(NamedTuple):
    """How far the robot's clock is ahead of the one here, by an answer that took `round_s`."""

    ahead_s: float
    round_s: float
    at_s: float


def clock_of(pong: dict[str, Any], now_s: float, known: RobotClock | None) -> RobotClock:
    """The quickest of the answers of late tells it best: it errs by half of its time at most."""
    round_s = now_s - pong["c"]
    new = RobotClock(pong["mono_ms"] / 1e3 - (pong["c"] + now_s) / 2.0, round_s, now_s)
    if known is None or round_s <= known.round_s or now_s - known.at_s > CLOCK_LASTS_S:
        return new
    return known


class Remote:
    """Raises: PlatformError: the robot does not answer, or refuses; the text says why.
    ConfigError: the certificate cannot be read.
    """

    def __init__(self, door: Door, name: str) -> None:
        self._door, self._name = door, name
        self._stack = ExitStack()
        self._line: Line
        self._sent = self._asked = 0
        self.state: dict[str, Any] = {}
        self.has_seat = False
        self._pinged_s = -math.inf
        self._clock: RobotClock | None = None
        self._pending: dict[str, str] = {}
        self._verdicts: list[str] = []

    def __enter__(self) -> Self:
        headers = {"Authorization": f"Bearer {self._door.token}"}
        url = f"{self._door.url}?tab=teleop-{time.time_ns()}"
        line = Line(url, headers, _trusting(self._door), OPEN_TIMEOUT_S)
        try:
            self._line = self._stack.enter_context(line)
        except OSError as error:
            raise PlatformError(
                f"no robot answers at {self._door.url}: {error}; start one with 'agribot run --ui'"
            ) from error
        self.send(k="name", name=self._name)
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(PlatformError):
            self.drive(0.0, 0.0)
            self.send(k="release")
        self._stack.close()

    def take_seat(self, *, force: bool) -> None:
        refusal = self.ask(k="take", force=force)
        if refusal:
            raise PlatformError(f"{refusal} (--take-over takes it)")
        self.send(k="scale", value=1.0)  # the rates here are scaled already
        self.has_seat = True

    def ask(self, **message: Any) -> str:
        """Send a request and wait for its answer: why it is refused, or nothing."""
        self._asked += 1
        id = f"ask-{self._asked}"
        self.send(**message, id=id)
        answer = self._awaited(lambda heard: heard["k"] == "ack" and heard["id"] == id)
        return "" if answer["ok"] else str(answer["reason"])

    def request(self, name: str, message: dict[str, Any]) -> None:
        """Send it and go on; `verdicts` says later what became of it."""
        self._asked += 1
        id = f"ask-{self._asked}"
        self._pending[id] = name
        self.send(**message, id=id)

    def verdicts(self) -> list[str]:
        """Of the requests answered since the last call, one line each."""
        verdicts, self._verdicts = self._verdicts, []
        return verdicts

    def until(self, is_it: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first state for which `is_it` holds."""
        return self._awaited(lambda heard: heard["k"] == "s" and is_it(heard))

    def _awaited(self, is_it: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        end_s = time.monotonic() + ANSWER_S
        while time.monotonic() < end_s:
            heard = self._receive(0.2)
            if heard is not None and is_it(heard):
                return heard
        raise PlatformError(f"the robot did not answer within {ANSWER_S:g} s")

    def drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Stamped with the robot's clock once that is known: what comes too late is not obeyed."""
        now_s = time.monotonic()
        if now_s - self._pinged_s >= PING_S:
            self._pinged_s = now_s
            self.send(k="ping", c=now_s)
        self._sent += 1
        clock = {} if self._clock is None else {"mono_ms": 1e3 * (now_s + self._clock.ahead_s)}
        self.send(k="drive", seq=self._sent, v=v_mps, w=yaw_rate_radps, **clock)

    def send(self, **message: Any) -> None:
        try:
            self._line.send(msgspec.json.encode(message).decode())
        except OSError as error:
            raise PlatformError(f"the line to the robot is cut: {error}") from error

    def listen(self) -> None:
        """Take in what has arrived; the newest state stays in `state`."""
        while self._receive(0.0) is not None:
            pass

    def _receive(self, timeout_s: float) -> dict[str, Any] | None:
        try:
            data = self._line.receive(timeout_s)
        except OSError as error:
            raise PlatformError(f"the line to the robot is cut: {error}") from error
        if data is None:
            return None
        message: dict[str, Any] = msgspec.json.decode(data)
        if message["k"] == "s":
            self.state = message
        elif message["k"] == "seat" and self.has_seat and message["seat"] != "you":
            raise PlatformError(f"{message['holder'] or 'somebody else'} has taken the seat")
        elif message["k"] == "ack" and message["id"] in self._pending:
            name = self._pending.pop(message["id"])
            self._verdicts.append(f"{name}: {'done' if message['ok'] else message['reason']}")
        elif message["k"] == "pong":
            self._clock = clock_of(message, time.monotonic(), self._clock)
        elif message["k"] == "bye":
            raise PlatformError(f"the robot says goodbye: {message['reason']}")
        return message


def _trusting(door: Door) -> ssl.SSLContext | None:
    """What the robot shows itself is trusted under any name: its file was read on this machine."""
    if not door.url.startswith("wss:"):
        return None
    try:
        context = ssl.create_default_context(cafile=door.cert or None)
    except OSError as error:  # an SSLError is one
        raise ConfigError(f"{door.cert} is no certificate in PEM: {error}") from error
    context.check_hostname = not door.cert
    return context
