"""ROS 1 bags, rosbag2 and MCAP of any robot as a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from agribot.app.localization.bag_messages import (
    COUNTS,
    JOINTS,
    ONLY_NAMED,
    READERS,
    CountReader,
    ReadMessage,
    read_frame,
    read_stamp_s,
)
from agribot.app.localization.log import LOG_SENSORS, LogChannel, LogEntry, LogSensor
from agribot.core.errors import BridgeError, RecordingError
from agribot.core.messages import FloatArray
from agribot.record.bag.opening import open_bag
from agribot.record.bag.source import Bag, BagTopic
from agribot.record.frames_path import read_static_frames

# Odometry of other filters, of cameras and of GNSS is no measurement of the wheels, nor are the
# velocities of receivers.
_NOT_WHEELS = (
    "filter", "gps", "gnss", "fix", "navsat", "ublox", "map", "global", "vis", "slam", "truth",
    "icp", "lidar", "estimate",
)  # fmt: skip
_NMEA_VELOCITY = "/vel"  # topic of nmea_navsat_driver
_WHEELS = ("wheel", "velocity_controller", "base_controller", "diff_drive")


class BagLog:
    """A bag; `topics` names those of the sensors whose topic is not chosen by its type."""

    def __init__(
        self, path: Path, topics: Mapping[LogSensor, str], ticks_per_turn: float | None = None
    ) -> None:
        """Choose the topics.

        Raises: RecordingError: no bag, or no such topic.
        """
        self.path = path
        self.notes: list[str] = []
        self._ticks_per_turn = ticks_per_turn
        with open_bag(path) as bag:
            self.notes += bag.notes
            found = {sensor: _choose(bag, sensor, topics.get(sensor)) for sensor in LOG_SENSORS}
            if found["odom"] is None:
                self._note_unused_odometry(bag)
        self.channels = tuple(channel for channel in found.values() if channel is not None)

    def _note_unused_odometry(self, bag: Bag) -> None:
        kinds = READERS["odom"]
        unused = [topic.name for topic in bag.topics if topic.ros_type in kinds and topic.count > 1]
        if unused:
            self.notes.append(
                f"{', '.join(unused)} may be no measurement of the wheels; name it with --odom"
            )

    def entries(self) -> Iterator[LogEntry]:
        readers = self._make_readers()
        refused: Counter[str] = Counter()
        with open_bag(self.path) as bag:
            for message in bag.messages(frozenset(readers)):
                sensor, read = readers[message.topic.name]
                value = bag.value(message)
                logged_s = message.log_ns * 1e-9
                stamp_s = read_stamp_s(value) or logged_s
                try:
                    sample = read(value, stamp_s)
                except BridgeError as error:
                    refused[f"{message.topic.name}: {error}"] += 1
                    sample = None
                else:
                    if sample is None and sensor != "gnss":
                        continue  # a part of a measurement, or a message of something else
                yield LogEntry(sensor, stamp_s, logged_s, read_frame(value), sample)
        self._note_refused(refused)

    def _make_readers(self) -> dict[str, tuple[LogSensor, ReadMessage]]:
        """Make the readers of a pass, by topic."""
        readers: dict[str, tuple[LogSensor, ReadMessage]] = {}
        for channel in self.channels:
            left, comma, right = channel.source.partition(",")
            if not comma:
                make = READERS[channel.sensor][channel.kind]
                readers[channel.source] = channel.sensor, make()
                continue
            if self._ticks_per_turn is None:
                raise RecordingError(
                    f"{channel.source}: encoder counts need to know the wheel; give "
                    "--ticks-per-turn"
                )
            counts = CountReader(self._ticks_per_turn)
            readers[left] = channel.sensor, counts.read_left
            readers[right] = channel.sensor, counts.read_right
        return readers

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        with open_bag(self.path) as bag:
            return read_static_frames(bag)

    def _note_refused(self, refused: Counter[str]) -> None:
        for why, _ in refused.most_common(1):
            note = f"{refused.total()} messages left out, such as {why}"
            if note not in self.notes:
                self.notes.append(note)


def _choose(bag: Bag, sensor: LogSensor, name: str | None) -> LogChannel | None:
    """Choose the topic of a sensor: the named one, or the most trusted type; None without one."""
    kinds = READERS[sensor]
    if name is not None and "," in name and sensor == "odom":
        return _choose_counts(bag, name)
    if name is not None:
        topic = bag.find(name)
        if topic.ros_type not in kinds:
            raise RecordingError(
                f"{bag.path}: {name} is {topic.ros_type or topic.encoding}, which is no "
                f"{sensor}; {sensor} is read from {', '.join(kinds)}"
            )
        return LogChannel(sensor=sensor, source=name, kind=topic.ros_type, count=topic.count)
    able = [
        topic
        for topic in bag.topics
        if topic.count > 1 and topic.ros_type in kinds and topic.ros_type not in ONLY_NAMED
        and bag.knows(topic)
    ]  # fmt: skip
    if sensor == "odom":
        able = [topic for topic in able if not _is_of_no_wheels(topic)]
    able.sort(key=lambda topic: (_rank(topic, tuple(kinds)), -topic.count, topic.name))
    if not able:
        return None
    others = tuple(topic.name for topic in able[1:])
    return LogChannel(
        sensor=sensor, source=able[0].name, kind=able[0].ros_type, others=others,
        count=able[0].count,
    )  # fmt: skip


def _choose_counts(bag: Bag, names: str) -> LogChannel:
    """Choose the topics of the encoders of the left and the right wheel."""
    pair = [bag.find(name.strip()) for name in names.split(",")]
    kinds = [topic.ros_type for topic in pair]
    if len(pair) != 2 or any(kind not in COUNTS for kind in kinds):
        raise RecordingError(
            f"{bag.path}: --odom {names} are {', '.join(kinds)}; two topics, left and right, are "
            f"encoder counts of {', '.join(COUNTS)}"
        )
    left, right = pair
    return LogChannel(
        sensor="odom",
        source=f"{left.name},{right.name}",
        kind=right.ros_type,
        count=left.count + right.count,
    )


def _is_of_no_wheels(topic: BagTopic) -> bool:
    name = topic.name.lower()
    is_named_so = name == _NMEA_VELOCITY or any(word in name for word in _NOT_WHEELS)
    return topic.ros_type != JOINTS and is_named_so


def _rank(topic: BagTopic, kinds: tuple[str, ...]) -> tuple[int, int]:
    is_wheels = any(word in topic.name.lower() for word in _WHEELS)
    return kinds.index(topic.ros_type), 0 if is_wheels else 1
