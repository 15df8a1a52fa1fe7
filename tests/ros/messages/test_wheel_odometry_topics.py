"""`/odom` and the frame tree around it, of a run and of a world alone (REP-105)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.app.run_world import make_run_world
from agribot.autonomy.estimate.filter.wheel_odometry import OdometryReading, WheelOdometry
from agribot.core import topics
from agribot.core.config import load
from agribot.core.geo import Datum
from agribot.core.messages import DriveCommand, RobotCommand, TickRecord
from agribot.core.topics import Topic
from agribot.description.loader import load_robot
from agribot.ros.messages import rosmsg
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.messages.topic_writer import TopicWriter
from agribot.ros.messages.wheel_odometry import (
    UNMEASURED,
    WheelOdometryWriter,
    make_wheel_odometry,
)
from agribot.ros.messages.world_topic_writer import WorldTick, WorldTopicWriter
from agribot.sim.platform import SimPlatform
from tests.record import record_samples as samples

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)
Pose = tuple[float, float, float]


class Kept:
    """A sink that keeps the messages of each topic."""

    def __init__(self) -> None:
        self.bytes: dict[str, list[bytes]] = {}

    def __call__(self, topic: Topic, _log_ns: int, data: bytes, _publish_ns: int) -> None:
        self.bytes.setdefault(topic.name, []).append(data)

    def read(self, topic: Topic) -> list[Any]:
        return [
            load_types().deserialize_cdr(data, topic.ros_type)
            for data in self.bytes.get(topic.name, [])
        ]


def planar(transform: Any) -> Pose:
    turn = transform.rotation
    return transform.translation.x, transform.translation.y, 2.0 * math.atan2(turn.z, turn.w)


def compose(a: Pose, b: Pose) -> Pose:
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], a[2] + b[2]


def frames(message: Any) -> dict[tuple[str, str], Pose]:
    return {(t.header.frame_id, t.child_frame_id): planar(t.transform) for t in message.transforms}


def odometry_of(message: Any) -> Pose:
    pose = message.pose.pose
    return (
        pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    )  # fmt: skip


def jumping_ticks() -> list[TickRecord]:
    """A run whose estimate jumps by a metre and turns aside, as after a fix at last."""
    ticks = samples.ticks(50)
    return [
        record if k < 25 else msgspec.structs.replace(record, estimate=_moved(record))
        for k, record in enumerate(ticks)
    ]


def _moved(record: TickRecord) -> Any:
    before = record.estimate
    return msgspec.structs.replace(
        before, x_map_m=before.x_map_m + 1.0, yaw_map_rad=before.yaw_map_rad + 0.3
    )


def test_the_chain_of_frames_ends_at_the_estimate_and_odom_never_jumps() -> None:
    kept, records = Kept(), jumping_ticks()
    writer = TopicWriter(
        kept, samples.robot(), DATUM, samples.URDF, CameraLog(samples.robot(), 0.0, 80)
    )
    for record in records:
        writer(record)
    chains = [
        found for found in map(frames, kept.read(topics.TF)) if ("odom", "base_footprint") in found
    ]
    assert len(chains) == len(records)
    for chain, record in zip(chains, records, strict=True):
        x_m, y_m, yaw_rad = compose(chain["map", "odom"], chain["odom", "base_footprint"])
        assert (x_m, y_m) == pytest.approx((record.estimate.x_map_m, record.estimate.y_map_m))
        assert math.remainder(yaw_rad - record.estimate.yaw_map_rad, math.tau) == pytest.approx(0.0)
    steps_m = [
        math.dist(a["odom", "base_footprint"][:2], b["odom", "base_footprint"][:2])
        for a, b in itertools.pairwise(chains)
    ]
    assert max(steps_m) < 0.02  # a tick at 0.4 m/s, though the estimate jumped by a metre
    for chain, message in zip(chains, kept.read(topics.ODOM), strict=True):
        assert message.header.frame_id == "odom"
        assert message.child_frame_id == "base_footprint"
        assert odometry_of(message) == pytest.approx(chain["odom", "base_footprint"], abs=1e-9)


def test_a_world_alone_leaves_the_map_to_whoever_localizes() -> None:
    alone, mapped = Kept(), Kept()
    robot = samples.robot()
    camera = CameraLog(robot, 0.0, 80)
    writers = [
        WorldTopicWriter(alone, robot, samples.URDF, camera),
        WorldTopicWriter(mapped, robot, samples.URDF, camera, has_map=True),
    ]
    truths: list[Pose] = []
    for record in samples.ticks(20):
        truth = (1.0, 2.0 + 0.4 * record.batch.t_s, 1.0)
        truths.append(truth)
        for writer in writers:
            writer(WorldTick(record.batch, None, truth, (0.4, 0.0)))
    links = {link for message in alone.read(topics.TF) for link in frames(message)}
    assert ("odom", "base_footprint") in links
    assert not [link for link in links if "map" in link]
    tree: dict[tuple[str, str], Pose] = {}
    for message in mapped.read(topics.TF):
        tree |= frames(message)
    assert compose(tree["map", "odom"], tree["odom", "base_footprint"]) == pytest.approx(truths[-1])


def test_the_quick_bytes_are_those_of_the_message() -> None:
    kept, robot = Kept(), samples.robot()
    writer, odometry = WheelOdometryWriter(kept, robot), WheelOdometry(robot.drive)
    for record in samples.ticks(10):
        writer(0, record.batch)
        reading = odometry.update(record.batch.wheels[-1])
        assert reading is not None
        assert kept.bytes[topics.ODOM.name][-1] == rosmsg.to_cdr(make_wheel_odometry(reading))


def test_what_wheels_do_not_measure_is_no_certainty() -> None:
    reading = OdometryReading(
        t_s=1.0, x_m=1.0, y_m=0.0, yaw_rad=0.0, pose_cov=tuple(range(1, 10)), v_mps=0.4,
        yaw_rate_radps=0.1, twist_var=(0.1, 0.2, 0.3),
    )  # fmt: skip
    message = make_wheel_odometry(reading)
    pose, twist = (np.reshape(m.covariance, (6, 6)) for m in (message.pose, message.twist))
    assert pose[np.ix_((0, 1, 5), (0, 1, 5))].ravel().tolist() == list(range(1, 10))
    assert np.diag(twist)[[0, 1, 5]].tolist() == [0.1, 0.2, 0.3]
    for matrix in (pose, twist):
        assert np.diag(matrix)[[2, 3, 4]].tolist() == [UNMEASURED] * 3


@pytest.mark.parametrize(
    ("preset", "twist"),
    [
        ("kind", lambda t_s: (0.4, 0.3 * math.sin(t_s))),
        ("field", lambda _t_s: (0.4, 0.0)),
        ("field", lambda _t_s: (0.0, 0.5)),
    ],
    ids=["kind-curves", "field-straight", "field-spin"],
)
def test_on_soil_the_odometry_is_off_by_no_more_than_it_says(
    preset: str, twist: Callable[[float], tuple[float, float]]
) -> None:
    """Against the truth; odometry that were the truth would fail the last line."""
    error, std = _drive_on_soil(preset, twist, 6.0)
    assert (abs(error) < 3.0 * std).all()
    assert abs(error).max() > 1e-3


def _drive_on_soil(
    preset: str, twist: Callable[[float], tuple[float, float]], for_s: float
) -> tuple[Any, Any]:
    config = load(
        "farm", ["world='empty'", f"sim.preset='{preset}'", "perception.enabled=false", "seed=1"]
    )
    robot, made = load_robot(config.robot), make_run_world(config)
    platform = SimPlatform(config, made.alter_robot(robot), made.world)
    odometry, reading, begin = WheelOdometry(robot.drive, config.estimate), None, None
    while platform.truth().t_s < for_s:
        batch = platform.read()
        v_mps, rate_radps = twist(batch.t_s)
        drive = DriveCommand(v_mps=v_mps, yaw_rate_radps=rate_radps)
        platform.write(RobotCommand(t_s=batch.t_s, drive=drive))
        reading = odometry.update(batch.wheels[-1])
        begin = begin or platform.truth()
    assert reading is not None and begin is not None
    end = platform.truth()
    cos, sin = math.cos(begin.yaw_map_rad), math.sin(begin.yaw_map_rad)
    dx_m, dy_m = end.x_map_m - begin.x_map_m, end.y_map_m - begin.y_map_m
    turned_rad = math.remainder(reading.yaw_rad - (end.yaw_map_rad - begin.yaw_map_rad), math.tau)
    error = np.array(
        [reading.x_m - cos * dx_m - sin * dy_m, reading.y_m + sin * dx_m - cos * dy_m, turned_rad]
    )
    return error, np.sqrt(np.diag(np.reshape(reading.pose_cov, (3, 3))))
