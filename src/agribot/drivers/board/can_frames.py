"""Frames of a CAN bus as bytes, and the bus as a line of them: `can:can0?board=vesc`.

A frame is 16 bytes, as Linux has it (SocketCAN, struct can_frame, little-endian): identifier and
flags, length, three bytes of nothing, eight of data.
"""

from __future__ import annotations

import errno
import struct
from typing import Any, NamedTuple

from agribot.drivers.line.byte_streams import POLL_S

EXTENDED, REMOTE = 0x8000_0000, 0x4000_0000
FRAME = struct.Struct("<IB3x8s")
LONGEST_DATA = 8
MOST_AT_ONCE = 64


class CanFrame(NamedTuple):
    """`identifier` has 29 bits where it `is_extended`, else 11; a remote one asks for its data."""

    identifier: int
    data: bytes = b""
    is_extended: bool = False
    is_remote: bool = False

    def pack(self) -> bytes:
        flags = self.is_extended * EXTENDED | self.is_remote * REMOTE
        return FRAME.pack(self.identifier | flags, len(self.data), self.data)


class CanDecoder:
    """Cuts a stream of bytes into frames; what says to be longer than a frame is left out."""

    def __init__(self) -> None:
        self._waiting = b""

    def feed(self, data: bytes) -> list[CanFrame]:
        waiting = self._waiting + data
        whole = len(waiting) // FRAME.size * FRAME.size
        self._waiting = waiting[whole:]
        return [
            CanFrame(
                number & ~(EXTENDED | REMOTE), content[:length],
                bool(number & EXTENDED), bool(number & REMOTE),
            )
            for number, length, content in FRAME.iter_unpack(waiting[:whole])
            if length <= LONGEST_DATA
        ]  # fmt: skip


class CanStream:
    """A bus of python-can. Raises: OSError: there is no such bus, or it broke."""

    def __init__(self, channel: str, interface: str = "socketcan", bitrate: int = 0) -> None:
        """Open it; `bitrate` is for adapters that are set up by it, as `slcan`."""
        import can

        self._can: Any = can
        options: dict[str, Any] = {"bitrate": bitrate} if bitrate else {}
        try:
            self._bus = can.Bus(channel=channel, interface=interface, **options)
        except (can.CanError, ValueError, NotImplementedError) as error:
            raise OSError(errno.ENODEV, str(error)) from error

    def read(self) -> bytes:
        frames: list[bytes] = []
        message = self._receive(POLL_S)
        while message is not None and len(frames) < MOST_AT_ONCE:
            if not message.is_error_frame and not message.is_fd:
                frames.append(CanFrame(
                    message.arbitration_id, bytes(message.data), message.is_extended_id,
                    message.is_remote_frame,
                ).pack())  # fmt: skip
            message = self._receive(0.0)
        return b"".join(frames)

    def write(self, data: bytes) -> None:
        for frame in CanDecoder().feed(data):
            message = self._can.Message(
                arbitration_id=frame.identifier, data=frame.data,
                is_extended_id=frame.is_extended, is_remote_frame=frame.is_remote,
                dlc=LONGEST_DATA if frame.is_remote else None,
            )  # fmt: skip
            try:
                self._bus.send(message)
            except self._can.CanError as error:
                raise OSError(errno.EIO, str(error)) from error

    def close(self) -> None:
        self._bus.shutdown()

    def _receive(self, wait_s: float) -> Any:
        try:
            return self._bus.recv(wait_s)
        except self._can.CanError as error:
            raise OSError(errno.EIO, str(error)) from error
