"""A file that a thread writes: a slow disk holds up the recording, not the robot."""

from __future__ import annotations

import errno
import math
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path

WAITING_BYTES = 256_000_000  # minutes of a stalled disk; more is a fault
# Room on a full disk that the recording gives back from its end, at most half of it: the state and
# the report of the run are worth more than its last seconds.
ROOM_BYTES = 1_000_000
STALLED_S = 30.0  # a disk that takes nothing for this time at the end takes nothing more


class BackgroundFile:
    """The functions of a file that a writer needs: `write`, `tell`, `flush`, `close`.

    An error of the disk comes with the next call. Bytes reach the disk in their order.
    Raises: OSError: the file cannot be created or written, or the disk has stalled for too long.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._waiting: deque[bytes] = deque()
        self._wake = threading.Condition()
        self._waiting_bytes = self._size = 0
        self._is_closing = False
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._run_writer, name="recording", daemon=True)
        self._thread.start()

    @property
    def closed(self) -> bool:
        return self._is_closing

    def tell(self) -> int:
        """Return where the next byte goes, whether those before are on the disk yet or not."""
        return self._size

    def write(self, data: bytes | bytearray | memoryview) -> int:
        self._raise_failure()
        if self._waiting_bytes > WAITING_BYTES:
            raise OSError("the disk has not taken anything for too long")
        copied = bytes(data)
        with self._wake:
            self._waiting.append(copied)
            self._waiting_bytes += len(copied)
            self._wake.notify_all()
        self._size += len(copied)
        return len(copied)

    def flush(self) -> None:
        """Raise the last error of the disk; the thread writes on its own."""
        self._raise_failure()

    def drain(self) -> None:
        """Wait until all bytes taken until now are written, or cannot be."""
        with self._wake:
            while self._waiting_bytes and self._thread.is_alive():
                self._wake.wait(0.1)
        self._raise_failure()

    def end(self) -> None:
        """Let the thread close the file when it has written the rest."""
        with self._wake:
            self._is_closing = True
            self._wake.notify_all()

    def close(self) -> None:
        """Wait until everything is written. Safe to call twice.

        Raises: OSError: it cannot be, or the disk has stalled.
        """
        self.end()
        waiting_bytes = math.inf
        while self._thread.is_alive():
            if waiting_bytes <= self._waiting_bytes:
                raise OSError(f"the disk has not taken anything for {STALLED_S:g} s")
            waiting_bytes = self._waiting_bytes
            self._thread.join(STALLED_S)
        self._raise_failure()

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _run_writer(self) -> None:
        with self._file:
            self._write_queue()

    def _write_queue(self) -> None:
        while True:
            with self._wake:
                while not (self._waiting or self._is_closing):
                    self._wake.wait()
                if not self._waiting:
                    return
                data = self._waiting.popleft()
            try:
                self._write_all(data)
            except OSError as error:
                if error.errno in (errno.ENOSPC, errno.EDQUOT):
                    self._make_room()
                self._failure = error
                return
            with self._wake:
                self._waiting_bytes -= len(data)
                self._wake.notify_all()

    def _make_room(self) -> None:
        """Cut the end off: a file that is cut anywhere can be read up to there."""
        with suppress(OSError):  # a pipe cannot be cut
            size_bytes = self._file.tell()
            self._file.truncate(max(size_bytes - ROOM_BYTES, size_bytes // 2))

    def _write_all(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
