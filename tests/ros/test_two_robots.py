"""Two robots at one ROS 1 master: neither ends the other, and each has names of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import Inbox
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.requests import Requests
from agribot.ros.ros1.connection import Ros1Connection
from agribot.ros.ros1.gateway import Ros1Gateway
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.noise_server import Ros1NoiseServer
from agribot.ros.sensor_noise import OnChange, SensorNoise
from tests import machine
from tests.record import record_samples as samples
from tests.ros.live import first
from tests.ros.ros1_system import Ros1, ask
from tests.waiting import wait_for

OUT = [topics.STATUS, topics.TF, topics.CLOCK, topics.CMD_VEL]


@pytest.fixture(scope="module")
def ros1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros1]:
    with closing(Ros1(tmp_path_factory.mktemp("two"))) as ros:
        yield ros


class Robot:
    def __init__(self, uri: str, namespace: str = "", *, allow_drive: bool = False) -> None:
        self.inbox = Inbox()
        requests = Requests(self.inbox, allow_drive=allow_drive)
        out = [topic for topic in OUT if not (allow_drive and topic is topics.CMD_VEL)]
        self.gateway = Ros1Gateway(requests, out, samples.URDF, uri, namespace)

    def say(self, text: str) -> None:
        self.gateway.publish(topics.STATUS, rosmsg.to_cdr(rosmsg.make_text(text)), 0)

    def close(self) -> None:
        self.gateway.close()


def texts(ros1: Ros1, namespace: str, *speakers: Robot) -> set[str]:
    """What a listener in a namespace hears while all robots speak."""
    heard = list[str]()

    def on_message(data: bytes) -> None:
        message: Any = load_types().deserialize_cdr(data, topics.STATUS.ros_type)
        heard.append(message.data)

    with closing(Ros1Connection("listener", print, ros1.uri, namespace)) as listener:
        listener.subscribe(topics.STATUS, on_message)

        def speak() -> list[str]:
            for index, robot in enumerate(speakers):
                robot.say(f"robot {index}")
            return heard if len(heard) > 5 else []

        wait_for(speak, "words")
    return set(heard)


@machine.needs("roscore")
def test_a_second_robot_is_refused_and_the_first_drives_on(ros1: Ros1) -> None:
    with closing(Robot(ros1.uri)) as robot:
        with pytest.raises(BridgeError, match=r"node /agribot is at the master.*--ros-namespace"):
            Robot(ros1.uri)
        assert texts(ros1, "", robot) == {"robot 0"}
        assert ros1.publishers()[topics.STATUS.name] == ["/agribot"]


@machine.needs("roscore")
def test_two_robots_have_each_their_own_topics_and_are_driven_apart(ros1: Ros1) -> None:
    left, right = Robot(ros1.uri, "left", allow_drive=True), Robot(ros1.uri, "right")
    with closing(left), closing(right):
        published = ros1.publishers()
        for name in (topics.STATUS.name, "/tf", "/clock"):
            assert published[f"/left{name}"] == ["/left/agribot"]
            assert published[f"/right{name}"] == ["/right/agribot"]
            assert name not in published
        assert ask(ros1.uri, "getParam", "/left/robot_description")[2] == samples.URDF
        assert texts(ros1, "left", left, right) == {"robot 0"}
        assert texts(ros1, "right", left, right) == {"robot 1"}
        talker = ros1.start(
            "rostopic", "pub", "-r", "20", "/left/agribot/cmd_vel", "geometry_msgs/Twist",
            "{linear: {x: 0.25}}",
        )  # fmt: skip
        hand = first(lambda: left.inbox.drain(1.0)[1], "the twist")
        assert hand.v_mps == 0.25
        ros1.stop(talker)


class Body:
    def __init__(self) -> None:
        self.tuned = list[tuple[str, str, float]]()

    def tune(self, sensor: str, parameter: str, value: float) -> None:
        self.tuned.append((sensor, parameter, value))

    def add_tuning_tap(self, tap: OnChange) -> None:
        pass


@machine.needs("roscore")
def test_the_noise_of_each_robot_is_its_own(ros1: Ros1) -> None:
    bodies = {space: Body() for space in ("left", "right")}
    noises = {space: SensorNoise(body) for space, body in bodies.items()}
    servers = [Ros1NoiseServer(noise, ros1.uri, space) for space, noise in noises.items()]
    try:
        ask(ros1.uri, "setParam", "/right/agribot/imu/rate/offset", 0.1)
        wait_for(lambda: bodies["right"].tuned, "the change")
        assert bodies["right"].tuned == [("gyro", "offset", 0.1)]
        assert bodies["left"].tuned == []
        code, _, uri = ask(ros1.uri, "lookupService", "/left/agribot/fix/position/set_parameters")
        assert code == 1 and uri.startswith("rosrpc://")
    finally:
        for server in servers:
            server.close()


@machine.needs("roscore")
def test_a_name_that_a_dead_robot_left_is_free(ros1: Ros1) -> None:
    dead = Node("agribot", ros1.uri)
    dead.advertise("/agribot/mission/status", "std_msgs/msg/String", latched=False, depth=1)
    dead._slave.shutdown()  # as after kill -9: nothing is unregistered
    dead._slave.server_close()
    with closing(Robot(ros1.uri)) as robot:
        assert texts(ros1, "", robot) == {"robot 0"}


@machine.needs("roscore")
def test_helpers_of_one_name_get_a_number(ros1: Ros1) -> None:
    names = [Node("helper", ros1.uri, may_rename=True) for _ in range(1)]
    names[0].advertise("/a", "std_msgs/msg/String", latched=False, depth=1)
    second = Node("helper", ros1.uri, may_rename=True)
    assert [names[0].name, second.name] == ["/helper", "/helper_2"]
    for node in (*names, second):
        node.close()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--ros1", "--ros-namespace", "my robot"), "letters, digits and _"),
        (("--ros2", "--ros-namespace", "left"), "--ros-domain each"),
    ],
)
def test_a_namespace_that_cannot_be_is_refused(
    options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(("sim", "--world", "empty", *options)) == 2
    assert said in capsys.readouterr().err
