"""A recording of several files: none grows too large, and the disk does not fill up.

The first part is `run.mcap`, the next ones `run-0001.mcap` and so on. Each begins with the files
and the latched topics, so that it can be read alone.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agribot.core.config import RecordConfig
from agribot.core.errors import RecordingError
from agribot.core.topics import Topic
from agribot.record.mcap_file import McapFile
from agribot.record.mcap_records import list_later_parts, list_parts, part_path

_MB = 1_000_000
_LIVE_RATIO = 0.9  # share of the clock's pace; a simulation that runs ahead of it can wait


class RecordingParts:
    """Write like one McapFile. The limits are checked at each `flush`, every second.

    Over `max_total_mb`, or with less than `min_free_mb` left on the disk, the oldest finished
    parts go. Where none is left to go, or the disk fails, recording ends and `ended_because` says
    why; the robot drives on.
    Raises: RecordingError: the file cannot be created or written, before the first message.
    """

    def __init__(self, path: Path, limits: RecordConfig) -> None:
        self.path = path
        self.ended_because = ""
        self._limits = limits
        self._number = self._oldest = 0
        self._kept_files: list[tuple[str, str, bytes]] = []
        self._descriptions: list[tuple[str, dict[str, str]]] = []
        self._latched: dict[str, tuple[Topic, bytes]] = {}
        self._has_messages = False
        self._is_disk_full = False
        self._finished_bytes: dict[int, int] = {}
        self._now_ns = self._flushed_ns = 0
        self._flushed_wall_s = 0.0
        later = [part for _, part in list_later_parts(path)]
        for stale in (*list_parts(path)[1:], *later):  # parts of an earlier run in the same folder
            stale.unlink(missing_ok=True)
        self._file = McapFile(path)
        self._ending: list[McapFile] = []  # parts on their way to the disk

    @property
    def closed(self) -> bool:
        return self._file.closed

    def write(self, topic: Topic, log_ns: int, data: bytes, publish_ns: int) -> None:
        if self.ended_because:
            return
        self._has_messages = True
        if topic.qos.latched:
            self._latched[topic.name] = (topic, data)
        self._now_ns = log_ns
        try:
            self._file.write(topic, log_ns, data, publish_ns)
        except RecordingError as error:
            self._end_early(error)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file; those that come before the first message are in every part."""
        if not self._has_messages:
            self._kept_files.append((name, media_type, data))
        if not self._file.closed:
            with self._end_on_error():
                self._file.attach(name, media_type, data)

    def describe(self, name: str, values: dict[str, str]) -> None:
        self._descriptions.append((name, values))
        self._file.describe(name, values)

    def flush(self) -> None:
        """Flush; wait for the disk only where simulated time runs faster than the clock."""
        if self.ended_because:
            return
        wall_s, passed_s = time.monotonic(), (self._now_ns - self._flushed_ns) * 1e-9
        is_live = wall_s - self._flushed_wall_s >= _LIVE_RATIO * passed_s
        self._flushed_ns, self._flushed_wall_s = self._now_ns, wall_s
        with self._end_on_error():
            if is_live:
                self._file.flush()
            else:
                self._file.drain()
            if 0 < self._limits.max_file_mb * _MB <= self._file.size_bytes:
                self._begin_part()
            self._make_room()

    def fill_disk(self, *, is_full: bool) -> None:
        """Let the disk count as full, as a fault."""
        self._is_disk_full = is_full

    def drain(self) -> None:
        """Wait for the disk."""
        self._file.drain()

    def close(self) -> None:
        for file in (*self._ending, self._file):
            with self._end_on_error():
                file.close()
        self._ending.clear()

    @contextmanager
    def _end_on_error(self) -> Iterator[None]:
        """End the recording, and nothing else, when the disk fails after the first message."""
        try:
            yield
        except (RecordingError, OSError) as error:
            if not self._has_messages:
                raise
            self._end_early(error)

    def _end_early(self, error: Exception) -> None:
        self.ended_because = self.ended_because or str(error)

    def _begin_part(self) -> None:
        self._file.end()
        self._ending.append(self._file)
        self._finished_bytes[self._number] = self._file.size_bytes
        self._number += 1
        self._file = McapFile(part_path(self.path, self._number))
        for name, values in self._descriptions:
            self._file.describe(name, {**values, "part": str(self._number)})
        for file in self._kept_files:
            self._file.attach(*file)
        for topic, data in self._latched.values():
            self._file.write(topic, self._now_ns, data, self._now_ns)
        self._file.flush()

    def _make_room(self) -> None:
        while why := self._find_excess():
            if not self._finished_bytes:
                self.ended_because = why
                self._file.close()
                return
            oldest = min(self._finished_bytes)
            part_path(self.path, oldest).unlink(missing_ok=True)
            del self._finished_bytes[oldest]

    def _find_excess(self) -> str:
        """Say why room is needed; empty when it is not."""
        limits = self._limits
        total_mb = (sum(self._finished_bytes.values()) + self._file.size_bytes) / _MB
        if 0 < limits.max_total_mb < total_mb:
            return f"the recording reached {total_mb:.0f} MB, more than record.max_total_mb"
        free_mb = 0 if self._is_disk_full else shutil.disk_usage(self.path.parent).free / _MB
        if self._is_disk_full or free_mb < limits.min_free_mb:
            return (
                f"only {free_mb:.0f} MB are left on the disk, less than record.min_free_mb "
                f"({limits.min_free_mb:g})"
            )
        return ""
