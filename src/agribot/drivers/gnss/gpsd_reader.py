"""A gpsd on the network, report by report, for the node `gpsd-client`."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from agribot.core.messages import GnssFix, GnssStatus
from agribot.drivers.gnss.gpsd import write_watch
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.line.byte_streams import StreamReader, TcpStream
from agribot.ros.nodes.gpsd_client import GpsdReport

_MOST_REPORTS = 100  # largest number of waiting reports


class GpsdReader:
    """Reads the first receiver that a gpsd reports, until it is closed.

    `notify` gets what cannot be read, and each loss and return of the line.
    """

    def __init__(
        self, host: str, port: int, notify: Callable[[str], None],
        now_s: Callable[[], float] = time.time,
    ) -> None:  # fmt: skip
        """Open the line; `now_s` is since 1970.

        Raises: ConfigError: no gpsd answers there.
        """
        self._decoder, self._now_s = GpsdDecoder(notify), now_s
        self._status = GnssStatus(t_s=0.0)
        self._reports: deque[GpsdReport] = deque(maxlen=_MOST_REPORTS)
        self._reader = StreamReader(
            f"gpsd {host}:{port}", lambda: TcpStream(host, port), self._hear, time.monotonic,
            notify, lambda stream: stream.write(write_watch()),
        )  # fmt: skip

    def take(self) -> list[GpsdReport]:
        """Take what has come since the last call."""
        return [self._reports.popleft() for _ in range(len(self._reports))]

    def close(self) -> None:
        """Let go of gpsd. Safe to call twice."""
        self._reader.close()

    def _hear(self, data: bytes, arrived_s: float) -> None:
        """Decode line by line: all that is stated of a fix comes before the next one."""
        now_s = self._now_s()
        for line in data.splitlines(keepends=True):
            for stamp_s, sample in self._decoder.feed(line, arrived_s):
                if isinstance(sample, GnssFix):
                    is_accuracy_known = self._decoder.is_accuracy_known
                    self._reports.append(
                        GpsdReport(stamp_s, now_s, sample, self._status, is_accuracy_known)
                    )
                elif isinstance(sample, GnssStatus):
                    self._status = sample
                    if not stamp_s:
                        self._reports.append(GpsdReport(0.0, now_s, None, sample))
