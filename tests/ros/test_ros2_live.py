"""A run on the network: another process hears every topic, exactly, and may ask."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.core import topics
from agribot.core.geo import Datum
from agribot.core.messages import Inbox, TickRecord
from agribot.core.topics import STREAM, Topic
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.dds_names import to_dds_name
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.requests import Requests
from agribot.ros.ros2 import wire
from agribot.ros.ros2.gateway import Ros2Gateway
from agribot.ros.ros2.services import load_service_types
from agribot.ros.tick_publisher import Gateway, RunSources, TickPublisher
from tests.record import record_samples as samples
from tests.ros.live import Talk, free_port, zenoh_peer
from tests.waiting import wait_for

OUT = [topic for topic in topics.TOPICS if topic.ros_type]
# What these runs lack: a page with drawings, and a lidar.
ABSENT = (
    topics.SCAN, topics.GOAL_POSE, topics.CLICKED_POINT, topics.DRAWN_POLYGON, topics.DRAWN_ROUTE,
)  # fmt: skip
SAID = [topic for topic in OUT if topic not in ABSENT]
LATCHED = [topic for topic in SAID if topic.qos.latched]
GOALS = ((1.0, 2.0), (1.0, 12.0))
DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)


class TrueState:
    x_map_m, y_map_m, yaw_map_rad, v_mps, yaw_rate_radps = 1.5, 2.5, math.pi / 2, 0.4, 0.1


def key_of(topic: Topic) -> str:
    type_hash = load_types().hash_rihs01(topic.ros_type)
    return wire.make_topic_key(0, topic.name, topic.ros_type, type_hash)


class TickCounter:
    """A gateway that counts finished ticks: the clock is the last message of each."""

    ticks = 0

    def publish(self, topic: Topic, _data: bytes, _t_ns: int) -> None:
        self.ticks += topic is topics.CLOCK

    def step(self, _record: TickRecord) -> None:
        pass

    def close(self) -> None:
        pass


def outlet_to(*gateways: Gateway) -> TickPublisher:
    robot, plan = samples.robot(), samples.plan()
    sources = RunSources(
        plan=lambda: plan,
        goals_map_m=lambda: GOALS,
        weed_map=lambda: (samples.plant(1), samples.plant(2, treated_s=4.0)),
        truth=TrueState,
        imu_bias=lambda: ((0.1, 0.0, 0.0), (0.0, 0.0, 0.01)),
    )
    camera = CameraLog(robot, 10.0, 80, keeps_raw=True)
    return TickPublisher(gateways, robot, DATUM, samples.URDF, camera, sources)


def has_heard(peer: Talk, key: str, count: int) -> bool:
    return bool(peer("count", key) == count)


@pytest.fixture(scope="module")
def records() -> list[TickRecord]:
    return samples.ticks(60, seed=3, with_camera=True)


@pytest.fixture(scope="module")
def heard(records: list[TickRecord]) -> dict[str, Any]:
    """What a peer that came late heard of the last 50 of 60 ticks.

    One tick is on its way at a time: as in ROS 2, what finds a link's buffer full is dropped.
    """
    locator = f"tcp/127.0.0.1:{free_port()}"
    counter = TickCounter()
    outlet = outlet_to(Ros2Gateway(Requests(Inbox()), OUT, router=locator), counter)
    for record in records[:10]:
        outlet(record)
    wait_for(lambda: counter.ticks == 10, "the first ticks")
    with closing(outlet), zenoh_peer(locator, *map(key_of, LATCHED)) as peer:
        wait_for(lambda: len(peer("dump")["latched"]) == len(LATCHED), "the latched topics")
        wait_for(lambda: len(peer("dump")["tokens"]) >= len(OUT) + 6, "all tokens")
        clock = key_of(topics.CLOCK)
        for count, record in enumerate(records[10:], start=1):
            outlet(record)
            wait_for(partial(has_heard, peer, clock, count), f"tick {count} of 50")
        found: dict[str, Any] = peer("dump")
    assert outlet.dropped == 0
    assert outlet.fault == ""
    return found


def messages(heard: dict[str, Any], topic: Topic) -> list[Any]:
    """Decoded; of a latched topic what the late peer was given."""
    if topic.qos.latched:
        payloads = heard["latched"][key_of(topic)]
    else:
        payloads = [payload for payload, _ in heard["heard"][key_of(topic)]]
    return [load_types().deserialize_cdr(bytes.fromhex(p), topic.ros_type) for p in payloads]


def seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


def test_every_topic_of_the_table_arrives(heard: dict[str, Any]) -> None:
    for topic in SAID:
        assert messages(heard, topic), topic.name


def test_a_peer_sees_one_node_and_each_topic_with_its_type_and_qos(heard: dict[str, Any]) -> None:
    tokens = heard["tokens"]
    assert sum("/NN/" in token for token in tokens) == 1
    for topic in OUT:
        described = (
            f"/MP/%/%/agribot/{topic.name.replace('/', '%')}/{to_dds_name(topic.ros_type)}/"
            f"{load_types().hash_rihs01(topic.ros_type)}/{wire.format_qos(topic.qos)}"
        )
        assert sum(token.endswith(described) for token in tokens) == 1, topic.name


def test_messages_are_numbered_and_carry_the_gid_of_their_publisher(heard: dict[str, Any]) -> None:
    token = next(token for token in heard["tokens"] if "%agribot%imu/" in token)
    marks = [bytes.fromhex(mark) for _, mark in heard["heard"][key_of(topics.IMU)]]
    numbers = [struct.unpack_from("<q", mark)[0] for mark in marks]
    assert numbers == list(range(41, 241))  # 10 ticks of 4 came before this peer
    assert {mark[16:] for mark in marks} == {b"\x10" + wire.compute_gid(token)}


def test_sensors_arrive_with_exact_values(heard: dict[str, Any], records: list[TickRecord]) -> None:
    late = records[10:]
    sent_imu = [sample for record in late for sample in record.batch.imu]
    for message, imu in zip(messages(heard, topics.IMU), sent_imu, strict=True):
        got = message.angular_velocity, message.linear_acceleration
        assert tuple((v.x, v.y, v.z) for v in got) == (imu.gyro_radps, imu.accel_mps2)
        assert seconds(message.header.stamp) == pytest.approx(imu.t_s, abs=1e-9)
        assert message.header.frame_id == "imu_link"
    fixes = [fix for record in late for fix in record.batch.gnss]
    for message, fix in zip(messages(heard, topics.FIX), fixes, strict=True):
        assert (message.latitude, message.longitude) == (fix.lat_deg, fix.lon_deg)
        assert message.position_covariance[0] == fix.pos_std_m**2
    for message, fix in zip(messages(heard, topics.FIX_VELOCITY), fixes, strict=True):
        assert fix.velocity_mps == (message.vector.x, message.vector.y, message.vector.z)
    wheels = [record.batch.wheels[-1] for record in late]
    for message, wheel in zip(messages(heard, topics.JOINT_STATES), wheels, strict=True):
        assert tuple(message.position) == wheel.angle_rad
        assert tuple(message.velocity) == wheel.speed_radps
    mags = [mag for record in late for mag in record.batch.mag]
    for message, mag in zip(messages(heard, topics.MAGNETIC), mags, strict=True):
        field = message.magnetic_field
        assert (field.x, field.y, field.z) == mag.field_t
    expected_deg = math.degrees(math.atan2(1e-6, 3.8e-5))
    assert messages(heard, topics.HEADING_RAW)[0].data == pytest.approx(expected_deg)


def test_decisions_arrive_with_exact_values(
    heard: dict[str, Any], records: list[TickRecord]
) -> None:
    late = records[10:]
    for message, record in zip(messages(heard, topics.ODOMETRY), late, strict=True):
        position = message.pose.pose.position
        assert (position.x, position.y) == (record.estimate.x_map_m, record.estimate.y_map_m)
        assert message.twist.twist.linear.x == record.estimate.v_mps
    for message, record in zip(messages(heard, topics.CMD_VEL), late, strict=True):
        drive = record.command.drive
        assert (message.linear.x, message.angular.z) == (drive.v_mps, drive.yaw_rate_radps)
    for message, record in zip(messages(heard, topics.CLOCK), late, strict=True):
        assert seconds(message.clock) == pytest.approx(record.batch.t_s, abs=1e-9)
    slow = late[::5]
    assert len(slow) == len(messages(heard, topics.POSE)) == 10
    for message, record in zip(messages(heard, topics.POSE), slow, strict=True):
        assert message.pose.position.y == record.estimate.y_map_m
    for message, record in zip(messages(heard, topics.DISTANCE), slow, strict=True):
        x_m, y_m = record.estimate.x_map_m, record.estimate.y_map_m
        assert message.data == math.hypot(1.0 - x_m, 2.0 - y_m)
    for message, record in zip(messages(heard, topics.ANGLE), slow, strict=True):
        x_m, y_m = record.estimate.x_map_m, record.estimate.y_map_m
        left_rad = math.atan2(2.0 - y_m, 1.0 - x_m) - record.estimate.yaw_map_rad
        assert message.data == pytest.approx(math.degrees(math.remainder(left_rad, math.tau)))
    for message, record in zip(messages(heard, topics.BEARING), slow, strict=True):
        x_m, y_m = record.estimate.x_map_m, record.estimate.y_map_m
        assert message.data == math.degrees(math.atan2(2.0 - y_m, 1.0 - x_m))
    for message, record in zip(messages(heard, topics.HEADING_FILTERED), slow, strict=True):
        turned_deg = 90.0 - math.degrees(record.estimate.yaw_map_rad)
        assert message.data == pytest.approx(turned_deg % 360.0)


def test_maps_and_models_reach_a_late_peer(heard: dict[str, Any]) -> None:
    (description,) = messages(heard, topics.ROBOT_DESCRIPTION)
    assert description.data == samples.URDF
    (path,) = messages(heard, topics.PATH)
    ends = path.poses[0].pose.position, path.poses[-1].pose.position
    assert [(p.x, p.y) for p in ends] == [(1.0, 2.0), (1.0, 12.0)]
    (goals,) = messages(heard, topics.GOALS)
    assert [(p.position.x, p.position.y) for p in goals.poses] == list(GOALS)
    (goal,) = messages(heard, topics.GOAL_FIX)
    assert goal.latitude == pytest.approx(DATUM.lat_deg + 2.0 / 110_700, abs=2e-7)
    (weeds,) = messages(heard, topics.WEEDS)
    sizes = {marker.ns: len(marker.points) for marker in weeds.markers}
    assert sizes == {"weed": 1, "treated": 1, "crop": 0}
    (static,) = messages(heard, topics.TF_STATIC)
    frames = {(t.header.frame_id, t.child_frame_id) for t in static.transforms}
    assert ("camera_link", "camera_optical_frame") in frames
    truths = messages(heard, topics.GROUND_TRUTH)
    assert {(t.pose.pose.position.x, t.twist.twist.angular.z) for t in truths} == {(1.5, 0.1)}
    last = messages(heard, topics.STATUS)[-1]
    assert msgspec.json.decode(last.data)["state"] == "running"


def test_images_arrive_compressed_raw_and_with_their_camera(heard: dict[str, Any]) -> None:
    raw = messages(heard, topics.IMAGE_RAW)
    assert (raw[0].width, raw[0].height, raw[0].encoding, raw[0].step) == (64, 48, "rgb8", 192)
    pixels = np.asarray(raw[0].data).reshape(48, 64, 3)
    assert np.array_equal(pixels, samples.frame(0, 0.0).image_rgb)
    jpegs = messages(heard, topics.IMAGE)
    assert len(jpegs) == len(raw) == len(messages(heard, topics.CAMERA_INFO)) == 10
    assert bytes(jpegs[0].data[:3]) == b"\xff\xd8\xff"
    assert messages(heard, topics.CAMERA_INFO)[0].width == 64
    assert bytes(messages(heard, topics.OVERLAY)[0].data[:3]) == b"\xff\xd8\xff"


# ------------------------------------------------------------------ asking


class Robot:
    """The receiving end of requests."""

    def __init__(self, talk: Talk, inbox: Inbox, said: list[str], gateway: Ros2Gateway) -> None:
        self.talk, self.inbox, self.said, self.gateway = talk, inbox, said, gateway

    def send(self, payload: bytes, times: int = 1, rate_hz: float = 0.0) -> None:
        time.sleep(0.01)  # a peer of its own, not part of a flood
        mark = wire.pack_attachment(1, 1, bytes(16)).hex()
        self.talk("put", key_of(topics.CMD_VEL), payload.hex(), mark, times, rate_hz)

    def call(self, name: str, ros_type: str, request: bytes) -> Any:
        key = wire.make_topic_key(0, name, ros_type, load_service_types().hash_rihs01(ros_type))
        mark = wire.pack_attachment(9, 1, bytes(range(16)))
        ((payload, answer_mark),) = self.talk("call", key, request.hex(), mark.hex())
        answered = wire.read_attachment(bytes.fromhex(answer_mark))
        assert answered is not None
        assert (answered.sequence, answered.gid) == (9, bytes(range(16)))
        return load_service_types().deserialize_cdr(bytes.fromhex(payload), f"{ros_type}_Response")


def _robot(*, allow_drive: bool) -> Iterator[Robot]:
    locator = f"tcp/127.0.0.1:{free_port()}"
    inbox, said = Inbox(), list[str]()
    requests = Requests(inbox, allow_drive=allow_drive, report=said.append)
    gateway = Ros2Gateway(requests, [topics.FIX], router=locator)
    with closing(gateway), zenoh_peer(locator) as talk:
        yield Robot(talk, inbox, said, gateway)


@pytest.fixture(scope="module")
def drivable() -> Iterator[Robot]:
    yield from _robot(allow_drive=True)


@pytest.fixture(scope="module")
def watched() -> Iterator[Robot]:
    yield from _robot(allow_drive=False)


def twist(v_mps: float, yaw_rate_radps: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<6d", v_mps, 0.0, 0.0, 0.0, 0.0, yaw_rate_radps)


def newest(robot: Robot) -> tuple[float, float] | None:
    _, hand = robot.inbox.drain(1.0)
    return (hand[0].v_mps, hand[0].yaw_rate_radps) if hand else None


def next_drive(robot: Robot) -> tuple[float, float]:
    got: list[tuple[float, float]] = []

    def arrived() -> bool:
        drive = newest(robot)
        got.extend([drive] if drive else [])
        return bool(got)

    wait_for(arrived, "a twist")
    return got[0]


def test_a_twist_from_another_process_reaches_the_inbox_exactly(drivable: Robot) -> None:
    drivable.send(twist(0.3, -0.2))
    assert next_drive(drivable) == (0.3, -0.2)


def test_a_twist_that_is_no_number_reaches_the_supervisor_as_such(drivable: Robot) -> None:
    drivable.send(twist(math.nan, 0.1))
    assert math.isnan(next_drive(drivable)[0])
    assert any("not finite" in text for text in drivable.said)


def test_bytes_that_are_no_twist_are_refused_with_their_length(drivable: Robot) -> None:
    for broken in (b"", b"\0\1\0\0", twist(0.5, 0.0)[:-3], twist(0.5, 0.0) + b"\0" * 8):
        drivable.send(broken)
    wait_for(
        lambda: sum("not geometry_msgs/Twist" in t for t in drivable.said) == 4, "the refusals"
    )
    assert newest(drivable) is None
    drivable.send(twist(0.25, 0.0))
    assert next_drive(drivable) == (0.25, 0.0)


def test_a_flood_is_thinned_out_and_named(drivable: Robot) -> None:
    drivable.send(twist(0.4, 0.0), times=5000, rate_hz=10_000.0)
    wait_for(lambda: any("faster than 200 Hz" in text for text in drivable.said), "the refusal")
    drivable.send(twist(0.0, 0.0))  # the last word is to stop, and no flood drowns it
    wait_for(lambda: newest(drivable) == (0.0, 0.0), "the stop")
    assert len(drivable.inbox.drain(2.0)[1]) == 0


def test_a_publisher_of_another_type_is_named(drivable: Robot) -> None:
    stranger = wire.NodeName(domain=0, zid="0badc0de", name="teleop")
    token = stranger.make_endpoint_token(
        1, "MP", "/agribot/cmd_vel", "geometry_msgs/msg/TwistStamped", "RIHS01_00", STREAM
    )
    drivable.talk("announce", token)
    wait_for(lambda: any("TwistStamped_" in text for text in drivable.said), "the warning")
    assert any("node teleop" in text for text in drivable.said)


def test_services_pause_stop_and_resume(drivable: Robot) -> None:
    trigger, set_bool = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
    nothing = b"\0\1\0\0\0"
    for name in ("stop", "clear_stop", "resume", "cancel"):
        answer = drivable.call(f"/agribot/{name}", trigger, nothing)
        assert answer.success, answer.message
    assert drivable.call("/agribot/pause", set_bool, b"\0\1\0\0\1").success
    assert drivable.call("/agribot/pause", set_bool, b"\0\1\0\0\0").success
    assert not drivable.call("/agribot/pause", set_bool, b"\0\1").success
    events, _ = drivable.inbox.drain(1.0)
    actions = sorted(event.request.word for event in events)
    assert actions == ["cancel", "clear_stop", "pause", "resume", "resume", "stop"]


def test_without_leave_nothing_moves_the_robot_but_everything_stops_it(watched: Robot) -> None:
    assert watched.call("/agribot/stop", "std_srvs/srv/Trigger", b"\0\1\0\0\0").success
    assert watched.call("/agribot/pause", "std_srvs/srv/SetBool", b"\0\1\0\0\1").success
    for name in ("resume", "clear_stop"):
        answer = watched.call(f"/agribot/{name}", "std_srvs/srv/Trigger", b"\0\1\0\0\0")
        assert not answer.success
        assert "--allow-drive" in answer.message
    assert not watched.call("/agribot/pause", "std_srvs/srv/SetBool", b"\0\1\0\0\0").success
    watched.send(twist(0.3, 0.0))
    watched.call("/agribot/stop", "std_srvs/srv/Trigger", b"\0\1\0\0\0")  # comes after the twist
    events, hand = watched.inbox.drain(1.0)
    assert {event.request.word for event in events} == {"stop", "pause"}
    assert not hand


def test_where_a_router_runs_already_the_node_joins_it(watched: Robot) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    first = Ros2Gateway(Requests(Inbox()), [topics.FIX], router=locator)
    second = Ros2Gateway(Requests(Inbox()), [topics.FIX], router=locator)
    assert (first.role, second.role) == ("router", "peer")
    second.close()
    first.close()
