"""Bytes of a device: a serial line or a TCP connection that may break and come back.

A thread reads, hands on what came with the time of its arrival, and opens the line again after a
loss, first at once, then ever more rarely. The control loop never waits for it.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    import ssl

READ_BYTES = 4096
POLL_S = 0.2  # a read without a byte returns after this time
WRITE_S = 1.0  # a device that takes nothing for longer is given up on
LINE_HELP = (
    "check that it is plugged in, switched on and used by no other program, and that you may read "
    "it (group dialout)"
)
HOST_HELP = (
    "check the host and the port, that the program or device there is switched on and listens at "
    "it, and that no firewall is between"
)
FIRST_WAIT_S, LONGEST_WAIT_S = 0.2, 5.0  # between two tries to open a line


# Errors of pyserial where a line does not know a speed; Windows has no termios.
_BAUD_ERRORS: tuple[type[Exception], ...] = (ValueError,)
with contextlib.suppress(ImportError):
    import termios

    _BAUD_ERRORS += (termios.error,)


class ByteStream(Protocol):
    """An open line. Raises: OSError: it broke."""

    def read(self) -> bytes:
        """Return what came, nothing after POLL_S of silence."""
        ...

    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


OpenStream = Callable[[], ByteStream]


class SerialStream:
    """A serial line, for this program alone."""

    def __init__(self, path: str, baud: int) -> None:
        """Open it.

        Raises: OSError: there is no such line, or another program has it.
        """
        import serial

        try:
            self._port = serial.Serial(
                path, baud, timeout=POLL_S, write_timeout=WRITE_S, exclusive=True
            )
        except serial.SerialException as error:
            raise OSError(error.errno, str(error)) from error

    def read(self) -> bytes:
        import serial

        try:
            data: bytes = self._port.read(1)
            return data + self._port.read(self._port.in_waiting) if data else b""
        except (serial.SerialException, TypeError) as error:  # TypeError: closed meanwhile
            raise OSError(errno.EIO, str(error)) from error

    def write(self, data: bytes) -> None:
        import serial

        try:
            self._port.write(data)
        except (serial.SerialException, TypeError) as error:
            raise OSError(errno.EIO, str(error)) from error

    def set_baud(self, baud: int) -> None:
        """Go on at another speed, without opening the line anew, which would reset an Arduino.

        Raises: OSError: the line does not know that speed, or broke.
        """
        import serial

        errors: tuple[type[Exception], ...] = (serial.SerialException, *_BAUD_ERRORS)
        try:
            self._port.baudrate = baud
            self._port.reset_input_buffer()  # bytes of the old speed make no sense
        except errors as error:
            raise OSError(errno.EIO, f"{baud} baud: {error}") from error

    def close(self) -> None:
        self._port.close()


class UnreachableError(OSError):
    """No program answers at a host and port."""


def describe_failure(error: OSError) -> str:
    """Describe why a line cannot be opened, and what to do about it."""
    help = HOST_HELP if isinstance(error, UnreachableError) else LINE_HELP
    return f"{error.strerror or error}; {help}"


class TcpStream:
    """A TCP connection. Raises: OSError: no program answers there."""

    def __init__(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> None:
        """Connect; with `tls` encrypted, and the other end proves that it is `host`."""
        try:
            self._socket = socket.create_connection((host, port), timeout=LONGEST_WAIT_S)
        except UnicodeError as error:  # an empty label, as of two dots, or one of over 63 letters
            raise UnreachableError(errno.EINVAL, f"'{host}' can be no host's name") from error
        except OSError as error:
            raise UnreachableError(error.errno, error.strerror or str(error)) from error
        if tls is not None:
            try:
                self._socket = tls.wrap_socket(self._socket, server_hostname=host)
            except OSError:
                self._socket.close()
                raise
        self._socket.settimeout(POLL_S)

    def read(self) -> bytes:
        try:
            data = self._socket.recv(READ_BYTES)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, "the other end closed the connection")
        return data

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


class StreamReader:
    """Reads a line in a thread of its own until it is closed.

    `on_bytes(data, arrived_s)` gets what came, in that thread, and with `hears_silence` also that
    nothing came for POLL_S; `on_open(stream)` may write what the device needs first. `notify`
    gets each loss and each return, once.
    """

    def __init__(
        self,
        name: str,
        open_stream: OpenStream,
        on_bytes: Callable[[bytes, float], None],
        now_s: Callable[[], float],
        notify: Callable[[str], None],
        on_open: Callable[[ByteStream], None] = lambda stream: None,
        *,
        hears_silence: bool = False,
    ) -> None:
        """Open the line and begin to read.

        Raises: ConfigError: the line cannot be opened now.
        """
        self._name, self._open_stream, self._on_bytes = name, open_stream, on_bytes
        self._now_s, self._notify, self._on_open = now_s, notify, on_open
        self._hears_silence = hears_silence
        self._ended = threading.Event()
        self._holds_stream = threading.Lock()  # a descriptor that is written to is not closed
        try:
            self._stream: ByteStream | None = self._open()
        except OSError as error:
            raise ConfigError(f"{name}: {describe_failure(error)}") from error
        self._thread = threading.Thread(target=self._run, name=f"reads {name}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the line. Safe to call twice."""
        self._ended.set()
        self._thread.join()
        self._let_go()

    def write(self, data: bytes) -> bool:
        """Write to the device from any thread; False where it is away or takes nothing now."""
        with self._holds_stream:
            try:
                if self._stream is not None:
                    self._stream.write(data)
                    return True
            except OSError:  # the reading thread finds out, and reports it
                pass
        return False

    def _let_go(self) -> None:
        with self._holds_stream:
            if self._stream is not None:
                self._stream.close()
                self._stream = None

    def _open(self) -> ByteStream:
        stream = self._open_stream()
        try:
            self._on_open(stream)
        except OSError:
            stream.close()
            raise
        return stream

    def _run(self) -> None:
        while not self._ended.is_set():
            stream = self._stream or self._open_again()
            if stream is None:
                return
            try:
                data = stream.read()
            except OSError as error:
                self._let_go()
                self._notify(f"{self._name} is lost: {error.strerror or error}; trying again")
            else:
                if data or self._hears_silence:
                    self._on_bytes(data, self._now_s())

    def _open_again(self) -> ByteStream | None:
        """Try until it works; None where the reader was closed meanwhile."""
        wait_s = FIRST_WAIT_S
        while not self._ended.wait(wait_s):
            try:
                self._stream = self._open()
            except OSError:
                wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
                continue
            self._notify(f"{self._name} is back")
            return self._stream
        return None
