from __future__ import annotations

import os
from pathlib import Path
from typing import get_args

import pytest

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.ui import wire
from agribot.ui.hand.inputs import STILL
from agribot.ui.hand.joystick import JoystickState
from agribot.ui.hand.stick_table import REQUESTS, TableHand, read_table
from tests.ui.conftest import Robot
from tests.ui.test_teleop import event, teleop
from tests.waiting import PATIENCE_S

EXAMPLE = Path(__file__).parents[2] / "examples" / "teleop.yaml"
BUTTON, AXIS, AT_START = 0x01, 0x02, 0x80
FORWARD = event(-32767, AXIS, 1)


def press(number: int) -> bytes:
    return event(1, BUTTON, number)


def let_go(number: int) -> bytes:
    return event(0, BUTTON, number)


def table(folder: Path, text: str) -> TableHand:
    path = folder / "teleop.yaml"
    path.write_text(text, encoding="utf-8")
    return read_table(path, 1.0, 0.1)


def velocity(rest: str) -> str:
    return f"teleop:\n  walk:\n    type: topic\n    topic_name: cmd_vel\n{rest}"


def test_each_velocity_drives_only_while_its_own_dead_man_buttons_are_held() -> None:
    hand, stick = read_table(EXAMPLE, 1.0, 0.1), JoystickState()
    stick.feed(FORWARD + event(-32767, AXIS, 0))
    assert hand.wish(stick).twist == STILL
    stick.feed(press(4))
    assert hand.wish(stick).twist == (0.4, 0.6)
    stick.feed(press(5))
    assert hand.wish(stick).twist == (0.8, 1.0)
    stick.feed(let_go(4))
    assert hand.wish(stick).twist == (0.1, 0.0)
    stick.feed(let_go(5))
    assert hand.wish(stick).twist == STILL


def test_scale_and_offset_act_on_axes_and_buttons_and_the_option_on_all(tmp_path: Path) -> None:
    text = velocity(
        "    deadman_buttons: [7]\n    axis_mappings:\n"
        "      - {axis: 3, target: linear.x, scale: -0.5, offset: 0.25}\n"
        "      - {button: 2, target: angular.z, scale: 0.75, offset: -0.25}\n"
    )
    table(tmp_path, text)
    hand, stick = read_table(tmp_path / "teleop.yaml", 0.5, 0.1), JoystickState()
    stick.feed(press(7))
    assert hand.wish(stick).twist == (0.125, -0.125)
    stick.feed(event(-32767, AXIS, 3) + press(2))
    assert hand.wish(stick).twist == (-0.125, 0.25)


def test_a_request_is_made_once_when_its_last_button_goes_down() -> None:
    hand, stick = read_table(EXAMPLE, 1.0, 0.1), JoystickState()
    stick.feed(press(3))
    assert hand.wish(stick).requests == ()
    stick.feed(press(4))
    (asked,) = hand.wish(stick).requests
    assert (asked.name, asked.request) == ("resume", wire.ControlMission(action="resume"))
    assert hand.wish(stick).requests == ()
    stick.feed(let_go(3))
    assert hand.wish(stick).requests == ()


def test_a_tap_between_two_looks_counts_and_a_button_held_from_the_start_does_not() -> None:
    hand, stick = read_table(EXAMPLE, 1.0, 0.1), JoystickState()
    stick.feed(event(1, BUTTON | AT_START, 0))
    assert hand.wish(stick).requests == ()
    stick.feed(press(1) + let_go(1))
    assert [asked.request for asked in hand.wish(stick).requests] == [wire.PressStop()]


def test_the_table_knows_every_request_that_the_page_may_make() -> None:
    requests = REQUESTS.values()
    missions = {one.action for one in requests if isinstance(one, wire.ControlMission)}
    recordings = {one.action for one in requests if isinstance(one, wire.ControlRecording)}
    assert missions == {*get_args(wire.MissionAction)}
    assert recordings == {*get_args(wire.RecordingAction)}


REFUSED = {
    "{}": "no commands; write a table 'teleop' of joy_teleop",
    "a: {ros__parameters: {require_enable_button: false, axis_linear: {x: 1}}}": (
        "require_enable_button is off: nothing drives here without a button held"
    ),
    "a: {ros__parameters: {inverted_reverse: true, enable_button: 4}}": "inverted_reverse is on",
    "a: {ros__parameters: {enable_button: 4, axis_linear: {x: 1, y: 2}}}": (
        "a.normal: target 'linear.y'; known are linear.x and angular.z"
    ),
    "teleop: [": "not valid YAML",
    "teleop: {a: {type: topic}}\njoy: 1": "unknown 'joy'",
    "teleop: {a: {type: dance}}": "teleop.a.type: invalid value 'dance'",
    "teleop: {a: {type: action, action_name: pause, buttons: []}}": "teleop.a.buttons: ",
    "teleop: {a: {type: action, action_name: wave, buttons: [1]}}": "action_name = 'wave': unknown",
    "teleop: {a: {type: action, action_name: goto, buttons: [1], action_goal: {x: 1}}}": "`y`",
    "teleop: {a: {type: action, action_name: pause, buttons: [1], action_goal: {x: 1}}}": "`x`",
    "teleop: {a: {type: service, service_name: mark, buttons: [1], wait: 2}}": "`wait`",
    velocity("    message_value: [{target: linear.x, value: 0.1}]"): "deadman_buttons",
    velocity(
        "    deadman_buttons: []\n    message_value: [{target: linear.x, value: 0.1}]"
    ): "dead",
    velocity(
        "    deadman_buttons: [-1]\n    message_value: [{target: linear.x, value: 1}]"
    ): ">= 0",
    velocity("    deadman_buttons: [4]"): "write axis_mappings or message_value",
    velocity("    deadman_buttons: [4]\n    axis_mappings: [{target: linear.x}]"): "axis or button",
    velocity("    deadman_buttons: [4]\n    axis_mappings: [{axis: 1, target: linear.y}]"): (
        "target 'linear.y'; known are linear.x and angular.z"
    ),
    velocity(
        "    deadman_buttons: [4]\n    axis_mappings: [{axis: 1, target: linear.x, gain: 2}]"
    ): ("axis_mappings[0]: object contains unknown field `gain`"),
    velocity("    deadman_buttons: [4]\n    message_value: [{target: linear.x, value: 2.5}]"): (
        "linear.x up to 2.5; at most 2"
    ),
    velocity("    deadman_buttons: [4]\n    message_value: [{target: linear.x, value: .nan}]"): (
        "write a finite number"
    ),
    velocity(
        "    deadman_buttons: [4]\n"
        "    message_value: [{target: linear.x, value: 1}, {target: linear.x, value: 1}]"
    ): "written twice",
    "teleop: {a: {type: topic, topic_name: arm, deadman_buttons: [4]}}": "topic_name = 'arm'",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_table_that_means_nothing_to_this_robot_is_refused_by_its_key(
    text: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as refusal:
        table(tmp_path, text)
    assert REFUSED[text] in str(refusal.value)
    assert "teleop.yaml" in str(refusal.value)


def test_a_gamepad_with_a_table_drives_and_asks_a_real_server(robot: Robot, tmp_path: Path) -> None:
    device = tmp_path / "js0"
    os.mkfifo(device)
    stick = os.open(device, os.O_RDWR)
    process = teleop(robot, "joystick", "--joy", str(device), "--config", str(EXAMPLE))
    try:
        robot.wait_for(wire.DriveOrder)
        os.write(stick, FORWARD)
        os.write(stick, press(4))
        driven = robot.wait_for(wire.DriveOrder, lambda order: order.v_mps > 0.0)
        assert driven.v_mps == pytest.approx(0.4)
        os.write(stick, press(2))
        robot.wait_for_request("skip_row")
        os.write(stick, press(9))
        mark = robot.wait_for_request("mark")
        assert mark.request == wire.MarkMoment(text="seen from the gamepad")
        assert mark.who == wire.Who("teleop joystick")
        os.write(stick, let_go(4) + press(0) + press(1))
        robot.wait_for_request("pause")
        robot.wait_for_request("stop")
        os.close(stick)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
        assert "skip_row: done" in errors
        robot.wait_for(wire.DriveOrder, lambda _: robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0)
    finally:
        process.kill()
        process.communicate()


ROS_2 = """
joy_teleop:
  ros__parameters:
    use_sim_time: false
    drive:
      type: topic
      interface_type: geometry_msgs/msg/Twist
      topic_name: cmd_vel
      deadman_buttons: [5]
      axis_mappings:
        linear-x: {axis: 1, scale: 0.7, offset: 0.0}
        angular-z: {axis: 0, scale: 1.0}
    creep:
      type: topic
      interface_type: geometry_msgs/msg/TwistStamped
      topic_name: /cmd_vel
      deadman_buttons: [6]
      message_value:
        header-frame_id: {value: base_link}
        twist-linear-x: {value: 0.1}
    halt: {type: action, interface_type: a_msgs/action/Stop, action_name: stop, buttons: [1]}
"""
TWIST_JOY = """
joy_node: {ros__parameters: {deadzone: 0.3}}
teleop_twist_joy_node:
  ros__parameters:
    axis_linear: {x: 1}
    scale_linear: {x: 0.7}
    scale_linear_turbo: {x: 1.5}
    axis_angular: {yaw: 0}
    scale_angular: {yaw: 0.4}
    enable_button: 5
    enable_turbo_button: 6
    publish_stamped_twist: true
"""
DOTTED = """
/**:
  ros__parameters: {axis_linear.x: 1, scale_linear.x: 0.7, axis_angular.yaw: 0,
                    scale_angular.yaw: 1.0, enable_button: 5}
"""
ROS_1 = "{axis_linear: 1, scale_linear: 0.7, axis_angular: 0, scale_angular: 1.0, enable_button: 5}"


@pytest.mark.parametrize(
    ("text", "twist"),
    [(ROS_2, (0.7, 1.0)), (TWIST_JOY, (0.7, 0.4)), (DOTTED, (0.7, 1.0)), (ROS_1, (0.7, 1.0))],
    ids=["joy_teleop", "teleop_twist_joy", "names with points", "ROS 1"],
)
def test_parameter_files_of_ros_drive_as_they_do_there(
    text: str, twist: tuple[float, float], tmp_path: Path
) -> None:
    hand, stick = table(tmp_path, text), JoystickState()
    stick.feed(FORWARD + event(-32767, AXIS, 0))
    assert hand.wish(stick).twist == STILL
    stick.feed(press(5))
    assert hand.wish(stick).twist == twist


def test_a_stamped_twist_and_an_action_of_ros_2_are_read(tmp_path: Path) -> None:
    hand, stick = table(tmp_path, ROS_2), JoystickState()
    stick.feed(press(6) + press(1))
    wish = hand.wish(stick)
    assert wish.twist == (0.1, 0.0)
    assert [(asked.name, asked.request) for asked in wish.requests] == [("halt", wire.PressStop())]


def test_the_turbo_button_of_teleop_twist_joy_drives_alone_and_wins(tmp_path: Path) -> None:
    hand, stick = table(tmp_path, TWIST_JOY), JoystickState()
    stick.feed(FORWARD + press(6))
    assert hand.wish(stick).twist == (1.5, 0.0)
    stick.feed(press(5))
    assert hand.wish(stick).twist == (1.5, 0.0)


def test_a_table_is_checked_before_a_robot_is_looked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "teleop.yaml"
    path.write_text("joy_teleop: {}")
    assert main(["teleop", "joystick", "--config", str(path), "--url", "ws://localhost:1"]) == 2
    assert "no commands" in capsys.readouterr().err
