"""Against a real ROS 1: its master, rostopic and rosbag."""

from __future__ import annotations

import math
import os
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import count
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.geo import Datum
from agribot.core.messages import Inbox
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.sensor_readers import make_readers
from agribot.ros.requests import Requests
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.connection import Ros1Connection
from agribot.ros.ros1.gateway import Ros1Gateway
from agribot.ros.ros1.types import list_outputs
from agribot.ros.tick_publisher import RunSources, TickPublisher
from agribot.ros.topic_source import TopicSource
from tests import machine
from tests.record import record_samples as samples
from tests.ros.live import first, free_port
from tests.ros.ros1_system import Ros1, ask
from tests.waiting import PATIENCE_S, wait_for

pytestmark = machine.needs("roscore")

OUT = [topic for topic in topics.TOPICS if topic.ros_type]


class Robot:
    """A run with the bridge; `drive_on` is one tick of it."""

    def __init__(self, uri: str, *, allow_drive: bool) -> None:
        self.inbox, self.said = Inbox(), list[str]()
        requests = Requests(self.inbox, allow_drive=allow_drive, report=self.said.append)
        robot, plan = samples.robot(), samples.plan()
        self.gateway = Ros1Gateway(requests, OUT, samples.URDF, uri)
        self.outlet = TickPublisher(
            [self.gateway],
            robot,
            Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5),
            samples.URDF,
            CameraLog(robot, 10.0, 80, keeps_raw=True),
            RunSources(lambda: plan, lambda: ((1.0, 2.0),), lambda: (samples.plant(1),), None),
        )
        noise = np.random.default_rng(1)
        self._ticks = (samples.tick(index, noise, with_camera=True) for index in count())

    def drive_on(self, seconds: float = 0.02) -> bool:
        self.outlet(next(self._ticks))
        time.sleep(seconds)
        return True

    def close(self) -> None:
        self.outlet.close()


@pytest.fixture(scope="module")
def ros1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros1]:
    with closing(Ros1(tmp_path_factory.mktemp("ros1"))) as ros:
        yield ros


@pytest.fixture(scope="module")
def robot(ros1: Ros1) -> Iterator[Robot]:
    with closing(Robot(ros1.uri, allow_drive=True)) as running:
        yield running


def _driving_until(robot: Robot, process: subprocess.Popen[str], what: str) -> str:
    wait_for(lambda: robot.drive_on() and process.poll() is not None, what)
    assert process.stdout is not None
    return process.stdout.read()


def test_rosbag_records_every_topic_with_the_values_sent(ros1: Ros1, robot: Robot) -> None:
    names = [output.name for topic in OUT for output in list_outputs(topic)]
    bag = ros1.folder / "run.bag"
    recorder = ros1.start("rosbag", "record", "-O", str(bag), *names)

    wait_for(lambda: robot.drive_on() and not robot.gateway.unsubscribed, "rosbag to listen")
    for _ in range(80):
        robot.drive_on()
    os.killpg(recorder.pid, signal.SIGINT)
    recorder.wait(PATIENCE_S)
    # The wrapper may end before the recorder proper has closed its file and renamed it.
    wait_for(bag.exists, "rosbag to close its file")
    with AnyReader([bag]) as reader:
        found = {c.topic: c.msgtype for c in reader.connections}
        missing = {name for name in names if name not in found}
        # There is no truth without a simulator; the robot has no lidar; no page has drawings.
        absent = (
            topics.GROUND_TRUTH, topics.IMU_BIAS, topics.SCAN,
            topics.GOAL_POSE, topics.CLICKED_POINT, topics.DRAWN_POLYGON, topics.DRAWN_ROUTE,
        )  # fmt: skip
        assert missing == {output.name for topic in absent for output in list_outputs(topic)}
        assert found["/magnetic"] == "geometry_msgs/msg/Vector3Stamped"
        assert found["/currentPose"] == "geometry_msgs/msg/Pose"
        assert found["/agribot/agribot/camera/image_raw"] == "sensor_msgs/msg/Image"

        def read(name: str) -> list[Any]:
            wanted = [c for c in reader.connections if c.topic == name]
            return [
                reader.deserialize(raw, c.msgtype)
                for c, _, raw in reader.messages(connections=wanted)
            ]

        assert {m.data for m in read("/robot_description")} == {samples.URDF}
        fields = [(m.vector.x, m.vector.y, m.vector.z) for m in read("/magnetic")]
        assert set(fields) == {(3.8e-5, 1e-6, -2.3e-5)}
        assert all(abs(m.latitude - 21.161289) < 1e-5 for m in read("/agribot/fix"))
        assert {m.linear.x for m in read("/agribot/cmd_vel")} == {samples.SPEED_MPS}
        (image, *_) = read("/agribot/camera/image_raw")
        pixels = np.asarray(image.data).reshape(48, 64, 3)
        assert np.array_equal(pixels, samples.frame(0, 0.0).image_rgb)
        (weeds, *_) = read("/agribot/weeds")
        assert [len(marker.points) for marker in weeds.markers] == [1, 0, 0]
        stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in read("/agribot/imu")]
        assert np.diff(stamps) == pytest.approx(0.005, abs=1e-8)


def test_rostopic_echo_shows_a_latched_topic_to_a_late_comer(ros1: Ros1, robot: Robot) -> None:
    robot.drive_on()
    echo = ros1.start("rostopic", "echo", "-n", "1", "/agribot/path/poses[0]/pose/position/y")
    assert float(_driving_until(robot, echo, "rostopic echo").split()[0]) == 2.0


def test_the_parameters_of_a_simulation_are_set(ros1: Ros1, robot: Robot) -> None:
    assert ask(ros1.uri, "getParam", "/use_sim_time")[2] is True
    assert ask(ros1.uri, "getParam", "/robot_description")[2] == samples.URDF
    assert robot.outlet.fault == ""


def test_rostopic_pub_drives_the_robot(ros1: Ros1, robot: Robot) -> None:
    text = "{linear: {x: 0.3}, angular: {z: -0.2}}"
    pub = ros1.start("rostopic", "pub", "-r", "10", "/agribot/cmd_vel", "geometry_msgs/Twist", text)
    got: list[tuple[float, float, str]] = []

    def heard() -> bool:
        robot.drive_on()
        got.extend((h.v_mps, h.yaw_rate_radps, h.who.name) for h in robot.inbox.drain(1.0)[1])
        return len(got) >= 3

    wait_for(heard, "twists from rostopic")
    os.killpg(pub.pid, signal.SIGINT)
    assert {(v, w) for v, w, _ in got} == {(0.3, -0.2)}
    assert got[0][2].startswith("ROS 1 node /rostopic")


def test_a_wrong_md5_sum_is_refused_with_both_sums(ros1: Ros1, robot: Robot) -> None:
    answer = _shake_hands(ros1, robot, {"topic": "/agribot/fix", "md5sum": "0" * 32})
    assert "has md5 sum 2d3a8cd499b9b4a0249fb98fd05cfa48" in answer["error"]
    answer = _shake_hands(ros1, robot, {"topic": "/agribot/nothing", "md5sum": "*"})
    assert "no such topic" in answer["error"]


def test_a_peer_that_sends_rubbish_harms_nobody(ros1: Ros1, robot: Robot) -> None:
    for rubbish in (b"", b"\xff\xff\xff\xff", struct.pack("<I", 8) + b"\xff" * 8, b"GET / HTTP"):
        with socket.create_connection(_tcpros_address(ros1), timeout=PATIENCE_S) as sock:
            sock.sendall(rubbish)
    answer = _shake_hands(ros1, robot, {"topic": "/agribot/fix", "md5sum": "*"})
    assert answer["type"] == "sensor_msgs/NavSatFix"


def _tcpros_address(ros1: Ros1) -> tuple[str, int]:
    slave_uri = ask(ros1.uri, "lookupNode", "/agribot")[2]
    _, _, (_, host, port) = ask(slave_uri, "requestTopic", "/agribot/fix", [["TCPROS"]])
    return host, port


def _shake_hands(ros1: Ros1, robot: Robot, wish: dict[str, str]) -> dict[str, str]:
    robot.drive_on()
    with socket.create_connection(_tcpros_address(ros1), timeout=PATIENCE_S) as sock:
        sock.sendall(tcpros.pack_header({"callerid": "/test", **wish}))
        return tcpros.read_header(tcpros.receive_frame(sock, tcpros.MAX_HEADER_BYTES))


def test_without_a_master_the_bridge_says_how_to_start_one() -> None:
    with pytest.raises(BridgeError, match="start roscore"):
        Ros1Gateway(Requests(Inbox()), OUT, samples.URDF, f"http://127.0.0.1:{free_port()}")


def test_a_message_cut_short_and_one_that_is_no_number() -> None:
    said: list[str] = []
    inbox = Inbox()
    requests = Requests(inbox, allow_drive=True, report=said.append)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(struct.pack("<I", 48) + b"\0" * 20)
        theirs.close()
        with pytest.raises(ConnectionError, match="in the middle of a message"):
            tcpros.receive_frame(ours, tcpros.MAX_MESSAGE_BYTES)
    requests.request_twist((math.inf, 0.0, 0.0, 0.0, 0.0, 0.0), "ROS 1")
    _, (hand,) = inbox.drain(1.0)
    assert math.isnan(hand.v_mps)
    assert "not finite" in said[0]


def test_a_sensor_may_be_a_topic_of_ros1(ros1: Ros1) -> None:
    said: list[str] = []
    with closing(Ros1Connection("listener", said.append, ros1.uri)) as link:
        known = make_readers("gnss", samples.robot())
        source = TopicSource("gnss", "/their/fix", link, known, said.append, now_s=lambda: 9.0)
        text = "{latitude: 21.25, longitude: 72.75, altitude: 4.5}"
        ros1.start("rostopic", "pub", "-r", "20", "/their/fix", "sensor_msgs/NavSatFix", text)
        got: Any = first(lambda: source.take(9.0), "a fix")
        assert (got.lat_deg, got.lon_deg, got.alt_m) == (21.25, 72.75, 4.5)
        ros1.start("rostopic", "pub", "-r", "20", "/their/fix", "std_msgs/Float64", "1.0")
        wait_for(lambda: any("Float64" in text for text in said), "the refusal")
