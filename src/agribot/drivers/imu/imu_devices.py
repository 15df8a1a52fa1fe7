"""IMUs on a line of bytes: what each is sent, and what it answers.

`letters` are the printed lines of the original's Arduino, `rosserial` the same lines as the text
of a topic, `agribot` the frames of the IMU board of `firmware/`, which bring the magnetometer too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

from agribot.core.errors import ConfigError
from agribot.core.messages import ImuSample, MagSample
from agribot.core.platform import Sensor
from agribot.core.stamp_clock import SampleQueue
from agribot.core.suggestions import suggest_name
from agribot.drivers.board.agribot_board import MicrosecondClock, read_board_imu
from agribot.drivers.board.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board.board_protocol import (
    LAYOUT,
    AskVersion,
    BoardImu,
    BoardKind,
    BoardVersion,
)
from agribot.drivers.board.letter_imu import LetterImuDecoder, read_axes
from agribot.drivers.board.rosserial import STRING, RosserialHost, read_string
from agribot.drivers.line.byte_streams import OpenStream, StreamReader
from agribot.drivers.line.clock_watch import ClockWatch
from agribot.drivers.line.uri_options import UriOptions

ASK_AGAIN_S = 1.0  # a board that began anew prints lines until it is asked for frames
# Opening its line resets an Arduino, whose bootloader takes a byte within its first second for the
# first of a new program, and then does not start the old one.
BEGINS_S = 2.0

Refuse = Callable[[str], None]
Measured = list[tuple[float, ImuSample | MagSample]]  # with the device's stamp, 0 where it has none


class ImuDevice(Protocol):
    """An IMU as its bytes; `has_magnetometer` says that it measures the magnetic field, too."""

    has_magnetometer: bool

    def open(self, now_s: float) -> None:
        """Begin with a device whose line was just opened."""
        ...

    def feed(self, data: bytes, now_s: float) -> Measured:
        """Take what came until now, which may be nothing."""
        ...

    def take_to_send(self) -> bytes:
        """Take the bytes that the device has to get."""
        ...


class LetterImu:
    """Prints lines and hears nothing."""

    has_magnetometer = False

    def __init__(self, options: UriOptions, refuse: Refuse) -> None:
        self._lines = LetterImuDecoder(
            read_axes(options.pop_text("axes", "x,y,z")), refuse,
            accel_g=options.pop_number("accel_g", 2.0, 1.0, 32.0),
            gyro_dps=options.pop_number("gyro_dps", 250.0, 10.0, 4000.0),
        )  # fmt: skip

    def open(self, now_s: float) -> None:
        """Do nothing: it hears nothing, and a broken line is left out."""

    def feed(self, data: bytes, now_s: float) -> Measured:
        return [(0.0, sample) for sample in self._lines.feed(data)]

    def take_to_send(self) -> bytes:
        return b""


class RosserialImu(LetterImu):
    """Publishes its lines as the text of a topic, as the original's Arduino did for ROS."""

    def __init__(self, options: UriOptions, refuse: Refuse) -> None:
        super().__init__(options, refuse)
        self._host, self._refuse = RosserialHost(), refuse

    def open(self, now_s: float) -> None:
        self._host.open(now_s)

    def feed(self, data: bytes, now_s: float) -> Measured:
        found: Measured = []
        for message in self._host.feed(data, now_s):
            if message.topic.message_type != STRING:
                continue
            try:
                found += super().feed(read_string(message).encode(), now_s)
            except ValueError as error:
                self._refuse(str(error))
        return found

    def take_to_send(self) -> bytes:
        return self._host.take_to_send()


class FrameImu:
    """Sends frames with times of its own, once it was asked which firmware it runs.

    It is asked when it says something else, and not before: until then it prints lines, and what
    is silent may be in its bootloader.
    """

    has_magnetometer = True

    def __init__(self, options: UriOptions, refuse: Refuse) -> None:
        self._axes = read_axes(options.pop_text("axes", "x,y,z"))
        self._refuse = refuse
        self._decoder, self._encoder = BoardDecoder(), BoardEncoder()
        self._clock = MicrosecondClock()
        self._mag_count: int | None = None
        self._heard_s = self._asked_s = -ASK_AGAIN_S
        self._begins_s = self._now_s = 0.0
        self._speaks = False
        self._is_refused = False

    def open(self, now_s: float) -> None:
        self._decoder, self._clock = BoardDecoder(), MicrosecondClock()
        self._heard_s = self._asked_s = -math.inf
        self._begins_s, self._speaks = now_s + BEGINS_S, False

    def feed(self, data: bytes, now_s: float) -> Measured:
        self._now_s = now_s
        self._speaks = bool(data)
        found: Measured = []
        for frame in self._decoder.feed(data):
            if isinstance(frame.message, BoardVersion):
                self._check(frame.message)
            elif isinstance(frame.message, BoardImu) and not self._is_refused:
                self._heard_s = now_s
                found += self._read(frame.message)
        return found

    def take_to_send(self) -> bytes:
        is_answered = self._now_s - max(self._heard_s, self._asked_s) < ASK_AGAIN_S
        if is_answered or not self._speaks or self._now_s < self._begins_s:
            return b""
        self._asked_s = self._now_s
        return b"\0" + self._encoder.encode(AskVersion())[1]

    def _check(self, version: BoardVersion) -> None:
        self._is_refused = version.board is not BoardKind.IMU or version.layout != LAYOUT
        if version.board is not BoardKind.IMU:
            self._refuse("this is the motor board; give it to --source base")
        elif self._is_refused:
            self._refuse(
                f"its firmware speaks another table of messages (layout {version.layout:#06x}, "
                f"wanted {LAYOUT:#06x}); flash the firmware of this version"
            )

    def _read(self, imu: BoardImu) -> Measured:
        stamp_s = self._clock.read_s(imu.t_us)
        sample, field = read_board_imu(imu, self._axes, self._mag_count)
        self._mag_count = imu.mag_count
        measured: Measured = [(stamp_s, sample)]
        return measured if field is None else [*measured, (stamp_s, field)]


_DEVICES: dict[str, Callable[[UriOptions, Refuse], ImuDevice]] = {
    "letters": LetterImu,
    "rosserial": RosserialImu,
    "agribot": FrameImu,
}


def make_imu(options: UriOptions, refuse: Refuse) -> ImuDevice:
    """Make the device that the option `board` names.

    Raises: ConfigError: no such device, or a wrong option of it.
    """
    name = options.pop_text("board", "letters")
    if name not in _DEVICES:
        raise ConfigError(
            f"board={name}{suggest_name(name, list(_DEVICES))}; IMUs: {', '.join(_DEVICES)}"
        )
    return _DEVICES[name](options, refuse)


class ImuSource:
    """An IMU behind a line; the loop takes its samples with their capture time."""

    def __init__(
        self,
        name: str,
        open_stream: OpenStream,
        device: ImuDevice,
        notify: Callable[[str], None],
        latency_s: float = 0.0,
    ) -> None:
        """Open the line and begin to read.

        Raises: ConfigError: the line cannot be opened.
        """
        self.sensor: Sensor = "imu"
        self.name = name
        self._device = device
        self._imu: SampleQueue[ImuSample] = SampleQueue(latency_s=latency_s, is_of_its_own=True)
        self._mag: SampleQueue[MagSample] = SampleQueue(latency_s=latency_s, is_of_its_own=True)
        self._clock = ClockWatch(f"IMU on {name}", lambda: self._imu.uncertainty_s)
        self._reader: StreamReader | None = None
        self._reader = StreamReader(
            f"imu from {name}", open_stream, self._read, self._imu.now_s, notify,
            lambda stream: device.open(self._imu.now_s()), hears_silence=True,
        )  # fmt: skip

    def take(self, t_s: float) -> tuple[ImuSample, ...]:
        """Take the samples captured until `t_s`."""
        return self._imu.take(t_s)

    def take_more(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take the readings of a magnetometer on the same board, and notes on its clock."""
        mag = {"mag": self._mag.take(t_s)} if self._device.has_magnetometer else {}
        return mag | {"notes": self._clock.update(t_s)}

    def close(self) -> None:
        """Let go of the line. Safe to call twice."""
        if self._reader is not None:
            self._reader.close()

    def _read(self, data: bytes, arrived_s: float) -> None:
        for stamp_s, sample in self._device.feed(data, arrived_s):
            if isinstance(sample, ImuSample):
                self._imu.put(stamp_s, arrived_s, sample)
            else:
                self._mag.put(stamp_s, arrived_s, sample)
        if self._reader is not None and (answer := self._device.take_to_send()):
            self._reader.write(answer)
