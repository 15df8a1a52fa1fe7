"""Open what a person names as a log: bags, recordings, a receiver's bytes, CSV, folders of them."""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from agribot.app.localization.bag_log import BagLog
from agribot.app.localization.log import (
    LOG_SENSORS,
    WITH_GNSS,
    LogChannel,
    LogEntry,
    LogSensor,
    RobotLog,
)
from agribot.app.localization.own_log import OwnLog
from agribot.app.localization.receiver_log import ReceiverLog
from agribot.app.localization.table_log import TableLog, has_header
from agribot.core import topics
from agribot.core.errors import CHECK_PATH, RecordingError, explain_os_error
from agribot.core.messages import FloatArray
from agribot.record.bag.opening import open_bag
from agribot.record.localization.result import OUTPUT_NAMES
from agribot.record.mcap_parsing import MAGIC

OWN_RECORDING = "run.mcap"
SNIFF_BYTES = 65536
_UBX_SYNC = b"\xb5\x62"
_SENTENCE = re.compile(rb"\$[A-Z]{3,6},[^\r\n]*\*[0-9A-Fa-f]{2}")
_GPSD_REPORT = b'{"class":'
_BAG_STARTS = (MAGIC, b"#ROSBAG", b"SQLite format 3", b"\x28\xb5\x2f\xfd")


class SelectedLog:
    """Some of the sensors of a log."""

    def __init__(self, log: RobotLog, sensors: frozenset[LogSensor]) -> None:
        self._log = log
        self._sensors = sensors.union(WITH_GNSS if "gnss" in sensors else ())
        self.channels = tuple(each for each in log.channels if each.sensor in sensors)
        self.notes = log.notes

    def entries(self) -> Iterator[LogEntry]:
        return (entry for entry in self._log.entries() if entry.sensor in self._sensors)

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return self._log.read_transforms()


class JoinedLog:
    """Several files as one log, merged by their times."""

    def __init__(self, logs: Sequence[RobotLog], notes: Sequence[str]) -> None:
        self._logs, self._notes = logs, notes
        channels = {(each.sensor, each.source): each for log in logs for each in log.channels}
        self.channels: tuple[LogChannel, ...] = tuple(channels.values())

    @property
    def notes(self) -> list[str]:
        return [*self._notes, *dict.fromkeys(note for log in self._logs for note in log.notes)]

    def entries(self) -> Iterator[LogEntry]:
        return heapq.merge(*(log.entries() for log in self._logs), key=_get_logged_s)

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return {name: frame for log in self._logs for name, frame in log.read_transforms().items()}


def _get_logged_s(entry: LogEntry) -> float:
    return entry.logged_s


def open_log(
    paths: Sequence[Path], named: Mapping[LogSensor, str], ticks_per_turn: float | None = None
) -> RobotLog:
    """Open the files of a drive; `named` are topics or files of single sensors.

    Of two sources for one sensor the first counts, and a note names the other.
    Raises: RecordingError: a file that is no log, or a topic that is not there.
    """
    files = {sensor: Path(name) for sensor, name in named.items() if Path(name).is_file()}
    topic_names = {sensor: name for sensor, name in named.items() if sensor not in files}
    rest = frozenset(LOG_SENSORS) - files.keys()
    logs: list[RobotLog] = [
        SelectedLog(_open_file(path, {}, ticks_per_turn, (sensor,)), frozenset({sensor}))
        for sensor, path in files.items()
    ]
    notes: list[str] = []
    for path, is_sought in _list_files(paths):
        log = _try_file(path, topic_names, ticks_per_turn, notes, is_sought=is_sought)
        logs += [SelectedLog(log, rest)] if log is not None else []
    return JoinedLog(_keep_first(logs, notes), notes)


def find_own_recording(paths: Sequence[Path]) -> Path | None:
    """Find a recording of our own among the files of a drive."""
    for path, is_sought in _list_files(paths):
        is_mcap = path.is_file() and not is_sought and _read_start(path).startswith(MAGIC)
        if is_mcap and _has_ticks(path):
            return path
    return None


def list_bags(paths: Sequence[Path]) -> Iterator[Path]:
    """List the bags among the files of a drive."""
    for path, _ in _list_files(paths):
        if path.is_dir() or _read_start(path).startswith(_BAG_STARTS):
            yield path


def _list_files(paths: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """List the files, and whether each was only found in a folder."""
    for path in paths:
        if not path.is_dir() or (path / "metadata.yaml").exists():
            yield path, False
        elif (path / OWN_RECORDING).is_file():
            yield path / OWN_RECORDING, False
        else:
            files = (file for file in sorted(path.iterdir()) if file.is_file())
            yield from ((file, True) for file in files if file.name not in OUTPUT_NAMES)


def _try_file(
    path: Path, names: Mapping[LogSensor, str], ticks_per_turn: float | None, notes: list[str], *,
    is_sought: bool,
) -> RobotLog | None:  # fmt: skip
    """Open a file; one that was only found in a folder may be something else."""
    try:
        return _open_file(path, names, ticks_per_turn, ())
    except RecordingError as error:
        if not is_sought:
            raise
        notes.append(f"not used: {error}")
        return None


def _open_file(
    path: Path, names: Mapping[LogSensor, str], ticks_per_turn: float | None,
    sensors: Sequence[LogSensor],
) -> RobotLog:  # fmt: skip
    if path.is_dir():
        return BagLog(path, names, ticks_per_turn)
    start = _read_start(path)
    if start.startswith(_BAG_STARTS):
        return OwnLog(path) if _has_ticks(path) else BagLog(path, names, ticks_per_turn)
    if _UBX_SYNC in start or _SENTENCE.search(start):
        return ReceiverLog(path)
    if _GPSD_REPORT in start:
        return ReceiverLog(path, is_gpsd=True)
    first_line = start.decode("utf-8-sig", "replace").partition("\n")[0]
    if has_header(first_line):
        return TableLog(path, ticks_per_turn, sensors)
    if not start:
        raise RecordingError(f"{path} is empty (0 bytes); there is nothing to read")
    raise RecordingError(
        f"{path} is no log: it begins with {start[:12]!r}; give a bag, an MCAP file, NMEA or UBX "
        "of a receiver, or CSV whose first line names its columns"
    )


def _has_ticks(path: Path) -> bool:
    with open_bag(path) as bag:
        ticks = [topic for topic in bag.topics if topic.name == topics.TICK.name]
        return any(topic.count and not topic.is_ros for topic in ticks)


def _read_start(path: Path) -> bytes:
    with explain_os_error(f"cannot read {path}", CHECK_PATH), path.open("rb") as file:
        return file.read(SNIFF_BYTES)


def _keep_first(logs: Sequence[RobotLog], notes: list[str]) -> list[RobotLog]:
    """Keep the first source of each sensor; files that go on with the same topics are joined."""
    chosen: dict[LogSensor, str] = {}
    kept: list[RobotLog] = []
    for log in logs:
        sensors = set()
        for channel in log.channels:
            source = chosen.setdefault(channel.sensor, channel.source)
            if source == channel.source:
                sensors.add(channel.sensor)
            else:
                notes.append(
                    f"two sources of {channel.sensor}: {source} is used, {channel.source} is not; "
                    f"name the other with --{channel.sensor}"
                )
        kept += [SelectedLog(log, frozenset(sensors))] if sensors else []
    return kept
