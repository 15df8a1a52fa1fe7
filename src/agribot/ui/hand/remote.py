"""A program's line to a running robot: the page's WebSocket, without a page."""

from __future__ import annotations

import contextlib
import math
import ssl
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import NamedTuple, Self, TypeVar

import msgspec

from agribot.core.errors import ConfigError, PlatformError, add_advice
from agribot.ui import wire
from agribot.ui.address import RobotDoor
from agribot.ui.hand.blocking_socket import BlockingSocket

T = TypeVar("T")

ANSWER_S = 5.0
PING_S, CLOCK_LASTS_S = 0.5, 30.0
# Time limit of opening: a small computer at its limit is slow, most of all with TLS.
OPEN_TIMEOUT_S = 30.0


class RobotClock(NamedTuple):
    """How far the robot's clock is ahead of the one here, by an answer that took `round_s`."""

    ahead_s: float
    round_s: float
    at_s: float


def clock_of(pong: wire.Pong, now_s: float, known: RobotClock | None) -> RobotClock:
    """Estimate by the quickest of the latest answers: it errs by half of its time at most."""
    sent_s = pong.sent_ms / 1e3
    round_s = now_s - sent_s
    new = RobotClock(pong.mono_ms / 1e3 - (sent_s + now_s) / 2.0, round_s, now_s)
    if known is None or round_s <= known.round_s or now_s - known.at_s > CLOCK_LASTS_S:
        return new
    return known


class Remote:
    """A program's connection to a running robot with a page.

    Raises: PlatformError: the robot does not answer, or refuses; the text says why.
        ConfigError: the certificate cannot be read.
    """

    def __init__(self, door: RobotDoor, name: str) -> None:
        self._door, self._name = door, name
        self._stack = ExitStack()
        self._line: BlockingSocket
        self._asked = 0
        self.state: wire.State | None = None  # the newest
        self.has_seat = False
        self._pinged_s = -math.inf
        self._clock: RobotClock | None = None
        self._pending: dict[str, str] = {}
        self._verdicts: list[str] = []

    def __enter__(self) -> Self:
        headers = {"Authorization": f"Bearer {self._door.token}"}
        url = f"{self._door.url}?tab=teleop-{time.time_ns()}"
        line = BlockingSocket(url, headers, _trust(self._door), OPEN_TIMEOUT_S)
        try:
            self._line = self._stack.enter_context(line)
        except OSError as error:
            raise PlatformError(
                f"no robot answers at {self._door.url}: {error}; start one with 'agribot run --ui'"
            ) from error
        self.send(wire.UseName(name=self._name))
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(PlatformError):
            self.drive(0.0, 0.0)
            self.send(wire.LeaveSeat())
        self._stack.close()

    def take_seat(self, *, force: bool) -> None:
        refusal = self.ask(wire.TakeSeat(force=force))
        if refusal:
            raise PlatformError(f"{refusal}; take the seat with --take-over")
        self.send(wire.ScaleSpeed(ratio=1.0))  # the rates here are scaled already
        self.has_seat = True

    def ask(self, request: wire.PageRequest) -> str:
        """Send a request and wait for its answer: why it is refused, or nothing."""
        id = self._send_with_id(request)

        def settle(heard: wire.ServerMessage) -> wire.Verdict | None:
            return heard if isinstance(heard, wire.Verdict) and heard.id == id else None

        return self._await(settle).reason

    def request(self, name: str, request: wire.PageRequest) -> None:
        """Send it and go on; `verdicts` says later what became of it."""
        self._pending[self._send_with_id(request)] = name

    def _send_with_id(self, request: wire.PageRequest) -> str:
        self._asked += 1
        id = f"ask-{self._asked}"
        self.send(msgspec.structs.replace(request, id=id))
        return id

    def verdicts(self) -> list[str]:
        """Return the verdicts on requests answered since the last call, one line each."""
        verdicts, self._verdicts = self._verdicts, []
        return verdicts

    def until(self, is_it: Callable[[wire.State], bool]) -> wire.State:
        """Wait for the first state for which `is_it` holds."""

        def settle(heard: wire.ServerMessage) -> wire.State | None:
            return heard if isinstance(heard, wire.State) and is_it(heard) else None

        return self._await(settle)

    def _await(self, settle: Callable[[wire.ServerMessage], T | None]) -> T:
        end_s = time.monotonic() + ANSWER_S
        while time.monotonic() < end_s:
            heard = self._receive(0.2)
            found = None if heard is None else settle(heard)
            if found is not None:
                return found
        raise PlatformError(
            f"the robot did not answer within {ANSWER_S:g} s; check that its program runs"
        )

    def drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Stamped with the robot's clock once that is known: what comes too late is not obeyed."""
        now_s = time.monotonic()
        if now_s - self._pinged_s >= PING_S:
            self._pinged_s = now_s
            self.send(wire.Ping(sent_ms=1e3 * now_s))
        mono_ms = None if self._clock is None else 1e3 * (now_s + self._clock.ahead_s)
        self.send(wire.DriveByHand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps, mono_ms=mono_ms))

    def send(self, message: wire.PageMessage) -> None:
        try:
            self._line.send(wire.encode(message).decode())
        except OSError as error:
            raise PlatformError(
                f"the line to the robot is cut: {error}; check the network, then start again"
            ) from error

    def listen(self) -> None:
        """Take in what has arrived; the newest state stays in `state`."""
        while self._receive(0.0) is not None:
            pass

    def _receive(self, timeout_s: float) -> wire.ServerMessage | None:
        """Receive one message; None when none comes in time.

        Raises: PlatformError: the connection or the seat is lost, or no AGRIBOT server answers.
        """
        try:
            data = self._line.receive(timeout_s)
            message = None if data is None else wire.read_server_message(data)
        except OSError as error:
            raise PlatformError(
                f"the line to the robot is cut: {error}; check the network, then start again"
            ) from error
        except wire.BadMessage as error:
            raise PlatformError(
                f"the robot speaks otherwise ({error}); use the same version on both sides"
            ) from error
        if message is not None:
            self._hear(message)
        return message

    def _hear(self, message: wire.ServerMessage) -> None:
        if isinstance(message, wire.State):
            self.state = message
        elif isinstance(message, wire.SeatChange) and self.has_seat and message.seat != "you":
            raise PlatformError(
                f"{message.holder or 'somebody else'} has taken the seat; "
                "ask them, or take it back with --take-over"
            )
        elif isinstance(message, wire.Verdict) and message.id in self._pending:
            name = self._pending.pop(message.id)
            self._verdicts.append(f"{name}: {'done' if message.ok else message.reason}")
        elif isinstance(message, wire.Pong):
            self._clock = clock_of(message, time.monotonic(), self._clock)
        elif isinstance(message, wire.Bye):
            fact = f"the robot says goodbye: {message.reason}"
            raise PlatformError(add_advice(fact, "connect again"))


def _trust(door: RobotDoor) -> ssl.SSLContext | None:
    """Trust what the robot shows itself under any name: its file was read on this machine."""
    if not door.url.startswith("wss:"):
        return None
    try:
        context = ssl.create_default_context(cafile=door.cert or None)
    except OSError as error:  # an SSLError is one
        raise ConfigError(
            f"{door.cert} is no certificate in PEM: {error}; copy the robot's own"
        ) from error
    context.check_hostname = not door.cert
    return context
