"""Buttons of a gamepad move joints by steps: joy_teleop's `increment_by` without its server."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from agribot.cli.main import main
from agribot.cli.run.joint_jogging import add_joint_arguments, open_jogger
from agribot.core.errors import BridgeError, ConfigError
from agribot.core.topics import Topic
from agribot.description.jog_joints import read_jog_joints
from agribot.description.loader import export_urdf
from agribot.ros.joint_jog import STATES_TYPE, JointJogger
from agribot.ros.joint_step import JointStep
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import load_types
from agribot.ui.hand.joystick import JoystickState
from agribot.ui.hand.stick_table import TableHand, read_table
from tests import machine
from tests.ros.ros1_system import Ros1
from tests.ui.test_teleop import event
from tests.waiting import wait_for

MAST = """
  <link name="mast_head"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0"
    iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="mast_tilt" type="revolute"><parent link="base_link"/><child link="mast_head"/>
    <axis xyz="0 1 0"/><limit lower="-0.5" upper="0.3" effort="5" velocity="0.2"/></joint>
  <link name="mast_foot"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0"
    iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="mast_lift" type="prismatic"><parent link="base_link"/><child link="mast_foot"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="50" velocity="1"/></joint>
</robot>
"""
TABLE = """
teleop:
  mast_up:
    type: action
    action_name: mast_controller/increment
    action_goal: {joints: [mast_tilt], increment_by: [0.1]}
    buttons: [4, 7]
"""
COMMAND = "/mast_controller/command"
UP = JointStep("mast_up", "mast_controller", ("mast_tilt",), (0.1,))


@pytest.fixture(scope="module")
def masted(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The description of the robot with a mast that tilts and lifts."""
    file = tmp_path_factory.mktemp("robot") / "masted.urdf"
    file.write_text(export_urdf("agribot").replace("</robot>", MAST))
    return str(file)


class Network:
    """Keeps what is published; `say` is a message of another node."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Any]] = []
        self.say: Callable[[str, bytes], None] = lambda ros_type, data: None

    def subscribe_any(self, name: str, on_message: Callable[[str, bytes], None]) -> None:
        assert name == "/joint_states"
        self.say = on_message

    def decode(self, ros_type: str, data: bytes) -> Any:
        if not data:
            raise BridgeError("no bytes")
        return load_types().deserialize_cdr(data, ros_type)

    def advertise(self, topic: Topic) -> None: ...

    def publish(self, topic: Topic, data: bytes) -> None:
        self.sent.append((topic.name, self.decode(topic.ros_type, data)))

    def close(self) -> None: ...

    def put_joint(self, name: str, position: float) -> None:
        none = np.zeros(0)
        state = rosmsg.make_message(
            STATES_TYPE, rosmsg.make_header(1.0, ""), [name], np.array([position]), none, none
        )
        self.say(STATES_TYPE, rosmsg.to_cdr(state))


@pytest.fixture
def jogging(masted: str) -> tuple[JointJogger, Network, list[str], list[float]]:
    network, said, clock_s = Network(), list[str](), [0.0]
    limits = read_jog_joints(masted)
    jogger = JointJogger(network, "command", [UP], limits, said.append, now_s=lambda: clock_s[0])
    return jogger, network, said, clock_s


Jogging = tuple[JointJogger, Network, list[str], list[float]]


def test_the_joints_with_ends_are_those_that_move_by_steps(masted: str) -> None:
    found = read_jog_joints(masted)
    assert list(found) == ["mast_tilt", "mast_lift"]
    assert found["mast_tilt"] == ("mast_tilt", "rad", -0.5, 0.3, 0.2)
    assert read_jog_joints("agribot") == {}


def test_a_step_begins_where_the_joint_is_and_takes_as_long_as_its_speed_allows(
    jogging: Jogging,
) -> None:
    jogger, network, said, _ = jogging
    network.put_joint("mast_tilt", -0.05)
    jogger.jog(UP)
    ((name, message),) = network.sent
    assert (name, list(message.joint_names)) == ("/mast_controller/command", ["mast_tilt"])
    (point,) = message.points
    assert point.positions == pytest.approx([0.05])
    assert point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec == pytest.approx(0.5)
    assert said == ["mast_up: mast_tilt -0.050 -> 0.050 rad"]


def test_quick_presses_add_up_while_the_joint_is_on_its_way_and_end_at_its_limit(
    jogging: Jogging,
) -> None:
    jogger, network, said, clock_s = jogging
    network.put_joint("mast_tilt", 0.05)
    for _ in range(4):
        jogger.jog(UP)
        network.put_joint("mast_tilt", 0.06)  # it has hardly moved
        clock_s[0] += 0.1
    positions = [message.points[0].positions[0] for _, message in network.sent]
    assert positions == pytest.approx([0.15, 0.25, 0.3])
    assert said[-1] == "mast_up: mast_tilt 0.300 -> 0.300 rad: at its limit"
    clock_s[0] += 60.0  # somebody has moved it since
    network.put_joint("mast_tilt", -0.4)
    jogger.jog(UP)
    assert network.sent[-1][1].points[0].positions == pytest.approx([-0.3])


def test_a_joint_that_reports_no_place_is_not_moved(jogging: Jogging) -> None:
    jogger, network, said, _ = jogging
    network.put_joint("mast_lift", 0.1)
    network.put_joint("mast_tilt", float("nan"))
    network.say(STATES_TYPE, b"")
    jogger.jog(UP)
    assert network.sent == []
    assert "nothing on /joint_states says where mast_tilt is; start the" in said[0]


def test_a_step_is_asked_for_once_when_its_last_button_goes_down(tmp_path: Path) -> None:
    path = tmp_path / "teleop.yaml"
    path.write_text(TABLE)
    hand, stick, steps = read_table(path, 1.0, 0.1), JoystickState(), list[JointStep]()
    assert hand.steps == (UP,)
    hand.on_step = steps.append
    stick.feed(event(1, 0x01, 7))
    assert hand.wish(stick).requests == () and steps == []
    stick.feed(event(1, 0x01, 4))
    hand.wish(stick)
    hand.wish(stick)
    assert steps == [UP]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mast_controller/increment", "increment", "no controller; name that of the joints"),
        ("[0.1]", "[0.1, 0.2]", "1 joints and 2 numbers in increment_by; write one for each"),
        ("joints: [mast_tilt], ", "", "write it as {joints: [NAME], increment_by: [0.05]}"),
    ],
)
def test_a_step_that_means_nothing_is_refused(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "teleop.yaml"
    path.write_text(TABLE.replace(old, new))
    with pytest.raises(ConfigError) as refusal:
        read_table(path, 1.0, 0.1)
    assert words in str(refusal.value) and "mast_up" in str(refusal.value)


def open_with(hand: TableHand, *words: str) -> ExitStack:
    parser = argparse.ArgumentParser()
    add_joint_arguments(parser)
    return open_jogger(parser.parse_args(words), hand)


def test_joints_that_the_robot_lacks_and_networks_that_are_none_are_refused(
    masted: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "teleop.yaml"
    path.write_text(TABLE)
    table = read_table(path, 1.0, 0.1)
    with pytest.raises(ConfigError, match=r"robot agribot has no joint 'mast_tilt' .* has: none;"):
        open_with(table, "--joints", "ros1:")
    with pytest.raises(ConfigError, match="mast_up moves joints; name their network"):
        open_with(table, "--description", masted)
    with pytest.raises(
        ConfigError, match="--joints tcp:: not a network; give ros1:, ros1://HOST:PORT"
    ):
        open_with(table, "--description", masted, "--joints", "tcp:")
    path.write_text("teleop: {halt: {type: action, action_name: stop, buttons: [1]}}")
    table = read_table(path, 1.0, 0.1)
    with pytest.raises(ConfigError, match="no button of the table moves a joint"):
        open_with(table, "--joints", "ros1:")
    assert main(["teleop", "keyboard", "--joints", "ros1:"]) == 2
    assert "--joints is for a joystick with a table" in capsys.readouterr().err


@pytest.fixture
def ros1(tmp_path: Path) -> Iterator[Ros1]:
    machine.require("roscore")
    with closing(Ros1(tmp_path)) as ros:
        yield ros


def test_a_button_moves_a_joint_of_a_real_ros_1_system(
    ros1: Ros1, masted: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "teleop.yaml"
    down = TABLE[TABLE.index("  mast_up") :].replace("up", "down").replace("0.1", "-0.1")
    table.write_text(TABLE + down.replace("7", "6"))
    states = "{name: [mast_tilt], position: [-0.2]}"
    ros1.start("rostopic", "pub", "-r", "20", "/joint_states", "sensor_msgs/JointState", states)
    bag = tmp_path / "steps.bag"
    recorder = ros1.start("rosbag", "record", "-l", "1", "-O", str(bag), COMMAND)
    network = ros1.uri.replace("http", "ros1")
    stick, hand = JoystickState(), read_table(table, 1.0, 0.1)
    with open_with(hand, "--description", masted, "--joints", network):
        wait_for(lambda: COMMAND in ros1.subscribers(), "rosbag to listen")
        stick.feed(event(1, 0x01, 4))

        def has_recorded() -> bool:
            for button in (7, 6):  # up and down, until the recorder's line is open
                stick.feed(event(1, 0x01, button))
                hand.wish(stick)
                stick.feed(event(0, 0x01, button))
            return recorder.poll() is not None or bag.exists()

        wait_for(has_recorded, "a step to be recorded")
    ros1.stop(recorder)
    with AnyReader([bag]) as reader:
        ((connection, _, data), *_) = reader.messages()
        message: Any = reader.deserialize(data, connection.msgtype)
    assert (connection.topic, list(message.joint_names)) == (COMMAND, ["mast_tilt"])
    assert min(abs(message.points[0].positions[0] - at) for at in (-0.1, -0.2)) < 1e-9
    assert "mast_up: mast_tilt -0.200 -> -0.100 rad" in capsys.readouterr().err
