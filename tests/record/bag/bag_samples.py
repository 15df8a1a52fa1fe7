"""Small recordings of every kind for the tests: our own, and what other programs leave behind."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys.store import Typestore

from agribot.core.config import load
from agribot.record.bag.definitions import ros1_store, ros2_store
from agribot.record.bag.opening import open_bag
from agribot.record.bag.sinks import compress_for_ros1
from agribot.record.recorder import RunRecorder
from tests.record import record_samples as samples

GOALS = ((1.0, 2.0), (1.0, 12.0))
STEP_NS = 100_000_000
START_NS = 1_700_000_000 * 1_000_000_000


def write_run(path: Path, count: int = 150, unplaced: int = 0) -> None:
    """A closed recording of ours, with camera, truth, weed map and a file inside.

    For the first `unplaced` ticks the robot does not know yet where it is.
    """
    config = load("farm", ["seed=7", "record.image_rate_hz=2.0"])
    recorder = RunRecorder(
        path, config, samples.robot(), samples.URDF, samples.plan(), GOALS,
        lambda: (samples.plant(1), samples.plant(2, treated_s=4.0)),
    )  # fmt: skip
    for index, record in enumerate(samples.ticks(count, seed=3, with_camera=True)):
        recorder(record if index >= unplaced else samples.unplaced(record))
        recorder.truth(record.batch.t_s, (1.0, 2.0, math.pi / 2), (0.4, 0.0))
    recorder.attach("goals.json", "application/json", b"[]")
    recorder.close()


def header(store: Typestore, t_ns: int, frame: str, seq: int = 0) -> Any:
    sec, nanosec = divmod(t_ns, 1_000_000_000)
    stamp = store.types["builtin_interfaces/msg/Time"](sec, nanosec)
    kind = store.types["std_msgs/msg/Header"]
    return kind(seq, stamp, frame) if store is ros1_store() else kind(stamp, frame)


def nav_sat_fix(
    store: Typestore,
    t_ns: int,
    lat_deg: float = 49.5,
    lon_deg: float = 8.1,
    status: int = 0,
    service: int = 1,
    seq: int = 0,
) -> Any:
    return store.types["sensor_msgs/msg/NavSatFix"](
        header(store, t_ns, "gps", seq),
        store.types["sensor_msgs/msg/NavSatStatus"](status, service),
        lat_deg,
        lon_deg,
        120.5,
        np.array([0.04, 0.01, 0.0, 0.01, 0.09, 0.0, 0.0, 0.0, 0.16]),
        3,
    )


def write_ros1(path: Path, count: int = 50, compression: str = "") -> None:
    """Fixes and numbers, as a field computer of the old days logs them."""
    store = ros1_store()
    writer = rosbag1.Writer(path)
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    if compression == "LZ4":
        writer.compressor = compress_for_ros1
    with writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        text = writer.add_connection("/text", "std_msgs/msg/String", typestore=store, latching=1)
        writer.chunk_threshold = 2000
        for index in range(count):
            t_ns = START_NS + index * STEP_NS
            message = nav_sat_fix(store, t_ns, 49.5 + 1e-6 * index, seq=index)
            writer.write(fix, t_ns, store.serialize_ros1(message, fix.msgtype))
            word = store.types["std_msgs/msg/String"](f"message {index}")
            writer.write(text, t_ns, store.serialize_ros1(word, text.msgtype))


def write_rosbag2(folder: Path, count: int = 50, plugin: StoragePlugin | None = None) -> None:
    store = ros2_store()
    with rosbag2.Writer(
        folder, version=9, storage_plugin=plugin or StoragePlugin.SQLITE3
    ) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index in range(count):
            t_ns = START_NS + index * STEP_NS
            message = nav_sat_fix(store, t_ns, 49.5 + 1e-6 * index)
            writer.write(fix, t_ns, store.serialize_cdr(message, fix.msgtype))


def counts(path: Path) -> Counter[str]:
    with open_bag(path) as bag:
        return Counter(message.topic.name for message in bag.messages())


def values(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Log time and plain value of every message by topic; `seq` of ROS 1 left out."""
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with open_bag(path) as bag:
        for message in bag.messages():
            value = plain(bag.value(message)) if message.topic.is_ros else message.data
            found[message.topic.name].append((message.log_ns, value))
    return found


def plain(value: Any) -> Any:
    """Without constants, which are not sent, and with names as ROS 2 writes them."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {
            name.lower(): plain(getattr(value, name))
            for name in value.__dataclass_fields__
            if name not in ("__msgtype__", "seq") and (len(name) == 1 or not name.isupper())
        }
    return value
