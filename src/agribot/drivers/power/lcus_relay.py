"""A USB relay of the LCUS family as the robot's contactor, or what holds its coil: `lcus:/dev/...`.

Four bytes at 9600 baud switch a channel: 0xA0, the channel, 1 or 0, and the sum of the three. The
relay answers nothing and has no watchdog: without a command it keeps its state. It falls off
when it loses its supply, which is that of its USB plug.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from agribot.core.errors import ConfigError
from agribot.core.facts import AnyFact, RelayLost, RelayStuck
from agribot.core.messages import ContactorSample, RobotCommand
from agribot.core.platform import Sensor
from agribot.drivers.line.byte_streams import OpenStream, SerialStream, StreamReader
from agribot.drivers.line.schemes import SourceContext, SourceUri
from agribot.drivers.line.stream_writer import StreamWriter
from agribot.drivers.line.uri_options import UriOptions

BAUD, HEAD = 9600, 0xA0
CHANNELS = 8  # channels of the largest of the family
REPEAT_S = 0.1  # period of repetition: a command that the line lost is sent again
STUCK_S = 1.0  # a line that takes nothing for this time is lost


def make_switch(channel: int, *, is_on: bool) -> bytes:
    """Make the four bytes that switch a channel, counted from 1."""
    body = bytes((HEAD, channel, int(is_on)))
    return body + bytes((sum(body) & 0xFF,))


class LcusContactor:
    """The relay holds the contactors while the robot's motors may have power, each by a channel.

    It is switched off when its line is opened, also after a loss, and when this is closed.
    """

    sensor: Sensor = "contactor"

    def __init__(
        self, name: str, open_stream: OpenStream, channels: Sequence[int],
        notify: Callable[[str], None], now_s: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """Open the line and switch it off.

        Raises: ConfigError: the line cannot be opened.
        """
        self.name, self._now_s = name, now_s
        self._on, self._off = (
            b"".join(make_switch(channel, is_on=is_on) for channel in channels)
            for is_on in (True, False)
        )
        self._is_wanted = self._is_on = self._is_lost = False
        self._asked_s, self._written_s = -math.inf, now_s()
        self._reader = StreamReader(
            f"contactor on {name}", open_stream, lambda data, arrived_s: None, now_s, notify,
            lambda stream: stream.write(self._off),
        )  # fmt: skip
        self._writer = StreamWriter(f"contactor on {name}", self._write, now_s)

    def take(self, t_s: float) -> tuple[ContactorSample, ...]:
        """Report the last command to the relay, and whether its line took that."""
        silent_s = self._now_s() - self._written_s
        fault: AnyFact | None = RelayLost(self.name) if self._is_lost else None
        if fault is None and self._asked_s > self._written_s and silent_s > STUCK_S:
            fault = RelayStuck(self.name, silent_s)
        is_closed = self._is_on and fault is None
        return (ContactorSample(t_s=t_s, is_closed=is_closed, fault=fault),)

    def write(self, command: RobotCommand) -> None:
        """Switch the relay as a command says; it may take its time."""
        is_wanted, now_s = not command.is_power_cut, self._now_s()
        if is_wanted != self._is_wanted or now_s - self._asked_s >= REPEAT_S:
            self._is_wanted, self._asked_s = is_wanted, now_s
            self._writer.send(self._on if is_wanted else self._off)

    def close(self) -> None:
        """Switch it off and let go of the line. Safe to call twice."""
        self._writer.send(self._off)
        self._writer.close()
        self._reader.close()

    def _write(self, data: bytes) -> bool:
        has_taken = self._reader.write(data)
        self._is_lost = not has_taken
        self._is_on = has_taken and data == self._on
        if has_taken:
            self._written_s = self._now_s()
        return has_taken


def open_relay(sensor: Sensor, uri: SourceUri, context: SourceContext) -> LcusContactor:
    """Open `contactor=lcus:/dev/ttyUSB3?channel=1`, with `&second=2` of a second contactor.

    Raises: ConfigError: no such line, a wrong option, or something else than the contactor.
    """
    if sensor != "contactor":
        raise ConfigError(f"{sensor} from lcus:{uri.path}: a relay switches; use contactor=lcus:")
    options = UriOptions(uri)
    channel = int(options.pop_number("channel", 1, 1, CHANNELS))
    second = int(options.pop_number("second", 0, 0, CHANNELS))
    options.check_empty()
    if second == channel:
        raise ConfigError(
            f"second={second} of {uri.path} is the first contactor's channel, too; name another"
        )
    channels = (channel, second) if second else (channel,)
    return LcusContactor(uri.path, lambda: SerialStream(uri.path, BAUD), channels, context.refuse)
