"""joy_teleop's table: what the axes and buttons of a gamepad do, from a YAML file.

It is read in the form of the original, of ROS 2 and of teleop_twist_joy.

Its topics are velocities here, its actions and services requests to the mission. Axes count as in
ROS's `joy`: forward and left are positive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from agribot.core.errors import CHECK_PATH, ConfigError, add_advice, explain_os_error
from agribot.core.toml_tree import check_finite
from agribot.ros.joint_step import JointStep
from agribot.ui import wire
from agribot.ui.hand.inputs import STILL, HandRequest, Wish
from agribot.ui.hand.joystick import JoystickState
from agribot.ui.hand.ros2_tables import find_commands
from agribot.ui.small_yaml import UnusableYaml, read_yaml_file

# The largest speeds that a line may ask for, those of `agribot teleop`; the robot has its own.
LIMITS = {"linear.x": 2.0, "angular.z": 3.0}
TWISTS = tuple(
    f"geometry_msgs/{folder}{name}" for name in ("Twist", "TwistStamped") for folder in ("", "msg/")
)
REQUESTS: dict[str, wire.PageRequest] = {
    "stop": wire.PressStop(),
    "clear_stop": wire.ClearStop(),
    "start": wire.ControlMission(action="start"),
    "pause": wire.ControlMission(action="pause"),
    "resume": wire.ControlMission(action="resume"),
    "cancel": wire.ControlMission(action="cancel"),
    "skip_row": wire.ControlMission(action="skip_row"),
    "nudge_left": wire.ControlMission(action="nudge_left"),
    "nudge_right": wire.ControlMission(action="nudge_right"),
    "return_home": wire.ControlMission(action="return_home"),
    "start_recording": wire.ControlRecording(action="start"),
    "stop_recording": wire.ControlRecording(action="stop"),
}

STEP = "increment"  # last part of the name of an action that moves joints by steps

Number = Annotated[int, msgspec.Meta(ge=0, le=255)]


class _Entry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class AxisMapping(_Entry, frozen=True):
    """`scale` times an axis or a button (0 or 1), plus `offset`: m/s or rad/s."""

    target: str
    axis: Number | None = None
    button: Number | None = None
    scale: float = 1.0
    offset: float = 0.0


class Constant(_Entry, frozen=True):
    target: str
    value: float


class Velocity(_Entry, frozen=True, tag_field="type", tag="topic"):
    """Drives while all of `deadman_buttons` are held."""

    deadman_buttons: Annotated[tuple[Number, ...], msgspec.Meta(min_length=1)]
    axis_mappings: tuple[AxisMapping, ...] = ()
    message_value: tuple[Constant, ...] = ()
    topic_name: str = "cmd_vel"
    message_type: str = TWISTS[0]

    @property
    def buttons(self) -> tuple[int, ...]:
        return self.deadman_buttons


class GoalContent(_Entry, frozen=True):
    """A place in the map, m, and the heading there, rad."""

    x: float
    y: float
    yaw: float | None = None

    @property
    def request(self) -> wire.PageRequest:
        return wire.GoTo(x_map_m=self.x, y_map_m=self.y, yaw_map_rad=self.yaw)


class MarkContent(_Entry, frozen=True):
    text: str = ""

    @property
    def request(self) -> wire.PageRequest:
        return wire.MarkMoment(text=self.text)


class StepContent(_Entry, frozen=True):
    """Joints of the action's controller, and how far each of them moves, rad or m."""

    joints: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    increment_by: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)]


class NoContent(_Entry, frozen=True):
    pass


class Action(_Entry, frozen=True, tag_field="type", tag="action"):
    action_name: str
    buttons: Annotated[tuple[Number, ...], msgspec.Meta(min_length=1)]
    action_goal: dict[str, Any] = {}


class Service(_Entry, frozen=True, tag_field="type", tag="service"):
    """`service_persistent` changes nothing: there is one line to the robot, and it stays open."""

    service_name: str
    buttons: Annotated[tuple[Number, ...], msgspec.Meta(min_length=1)]
    service_request: dict[str, Any] = {}
    service_persistent: bool = False


# Requests that the table's entry says more of.
CONTENTS: dict[str, type[GoalContent] | type[MarkContent]] = {
    "goto": GoalContent,
    "mark": MarkContent,
}


class TableHand:
    """A gamepad by a table. Nothing moves unless all dead-man buttons of a velocity are held.

    Of several velocities that are held, the one with the most buttons counts, of these the first.
    A request is made once, when its last button goes down, and so is a step of joints.
    """

    def __init__(
        self,
        velocities: list[Velocity],
        requests: list[tuple[tuple[int, ...], HandRequest]],
        scale: float = 1.0,
        dead_zone: float = 0.1,
        steps: Sequence[tuple[tuple[int, ...], JointStep]] = (),
    ) -> None:
        self._button_steps = steps
        self.on_step: Callable[[JointStep], None] = _ignore_step
        self._velocities = sorted(velocities, key=lambda one: -len(one.buttons))
        self._requests = requests
        self._scale, self._dead_zone = scale, dead_zone

    def wish(self, stick: JoystickState) -> Wish:
        pressed = stick.taken_presses()
        held = {number for number, is_down in stick.buttons.items() if is_down}
        driven = next((one for one in self._velocities if held.issuperset(one.buttons)), None)
        twist = STILL if driven is None else self._twist(driven, stick)
        down = held | pressed

        def is_asked(buttons: tuple[int, ...]) -> bool:
            return down.issuperset(buttons) and not pressed.isdisjoint(buttons)

        for buttons, step in self._button_steps:
            if is_asked(buttons):
                self.on_step(step)
        asked = [request for buttons, request in self._requests if is_asked(buttons)]
        return Wish(twist, tuple(asked))

    @property
    def steps(self) -> tuple[JointStep, ...]:
        """The steps of joints that the table has; `on_step` is called with one that is asked."""
        return tuple(step for _, step in self._button_steps)

    def _twist(self, velocity: Velocity, stick: JoystickState) -> tuple[float, float]:
        wanted = {constant.target: constant.value for constant in velocity.message_value}
        for one in velocity.axis_mappings:
            if one.axis is not None:
                value = -stick.axis(one.axis, self._dead_zone)  # Linux counts up and left negative
            else:
                value = float(stick.buttons.get(one.button or 0, False))
            wanted[one.target] = value * one.scale + one.offset
        return (
            self._scale * wanted.get("linear.x", 0.0),
            self._scale * wanted.get("angular.z", 0.0),
        )


def _ignore_step(_step: JointStep) -> None:
    """Ignore steps until an operator moves joints."""


def read_table(path: Path, scale: float, dead_zone: float) -> TableHand:
    """Read which stick and button does what.

    Raises: ConfigError: no such file, no table, or an entry that means nothing to this robot.
    """
    velocities: list[Velocity] = []
    requests: list[tuple[tuple[int, ...], HandRequest]] = []
    steps: list[tuple[tuple[int, ...], JointStep]] = []
    for name, entry in _commands(path).items():
        at = f"{path}: {name}"
        command = _command(entry, at)
        if isinstance(command, Velocity):
            _check_velocity(command, at)
            velocities.append(command)
        elif isinstance(command, Action) and _names_step(command):
            steps.append((command.buttons, _read_step(name.rpartition(".")[2], command, at)))
        else:
            requests.append((command.buttons, _request(name.rpartition(".")[2], command, at)))
    return TableHand(velocities, requests, scale, dead_zone, steps)


def _names_step(command: Action) -> bool:
    return command.action_name.rpartition("/")[2] == STEP


def _read_step(name: str, command: Action, at: str) -> JointStep:
    """Read a step of joints, as `CONTROLLER/increment` with the original's `increment_by`.

    Raises: ConfigError: no controller, no joints, or not a number for each of them.
    """
    controller = command.action_name.strip("/").removesuffix(STEP).strip("/")
    if not controller:
        raise ConfigError(
            f"{at}.action_name = '{command.action_name}': no controller; name that of the joints, "
            "as in mast_controller/increment"
        )
    try:
        content = msgspec.convert(command.action_goal, StepContent)
    except msgspec.ValidationError as error:
        raise ConfigError(
            f"{at}.action_goal: {error}; write it as {{joints: [NAME], increment_by: [0.05]}}"
        ) from error
    if len(content.joints) != len(content.increment_by):
        raise ConfigError(
            f"{at}.action_goal: {len(content.joints)} joints and {len(content.increment_by)} "
            "numbers in increment_by; write one for each"
        )
    return JointStep(name, controller, content.joints, content.increment_by)


def _commands(path: Path) -> dict[str, Any]:
    try:
        with explain_os_error(f"cannot read {path}", CHECK_PATH, ConfigError):
            tree = read_yaml_file(path)
    except UnusableYaml as error:
        raise ConfigError(f"{path} is not valid YAML: {error}; correct that line") from error
    check_finite(tree, str(path), "")
    try:
        commands = find_commands(tree)
    except ValueError as error:
        raise ConfigError(add_advice(f"{path}: {error}", "correct it")) from error
    if not commands:
        raise ConfigError(
            f"{path}: no commands; write a table 'teleop' of joy_teleop, or parameters of ROS 2's "
            "joy_teleop or of teleop_twist_joy"
        )
    if "teleop" in tree and (others := [str(key) for key in tree if key != "teleop"]):
        raise ConfigError(f"{path}: unknown '{others[0]}' beside 'teleop'; leave it out")
    return commands


def _command(entry: Any, at: str) -> Velocity | Action | Service:
    if isinstance(entry, dict) and "interface_type" in entry:  # the same in ROS 2
        entry = {"message_type" if k == "interface_type" else k: v for k, v in entry.items()}
        if entry.get("type") != "topic":
            del entry["message_type"]  # there is one type for each name
    try:
        command: Velocity | Action | Service = msgspec.convert(entry, Velocity | Action | Service)
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `$")
        where = where.rstrip("`")
        fact = f"{at}{where}: {message[:1].lower()}{message[1:]}"
        raise ConfigError(add_advice(fact, "correct it")) from error
    return command


def _check_velocity(command: Velocity, at: str) -> None:
    if command.topic_name.rpartition("/")[2] != "cmd_vel":
        raise ConfigError(
            f"{at}.topic_name = '{command.topic_name}': the velocity 'cmd_vel' is the only topic; "
            "name that"
        )
    if command.message_type not in TWISTS:
        raise ConfigError(
            f"{at}.message_type = '{command.message_type}': unknown; write {TWISTS[0]}"
        )
    if bool(command.axis_mappings) == bool(command.message_value):
        raise ConfigError(f"{at}: both or neither; write axis_mappings or message_value")
    for number, one in enumerate(command.axis_mappings):
        if (one.axis is None) == (one.button is None):
            raise ConfigError(
                f"{at}.axis_mappings[{number}]: both or neither; write axis or button"
            )
    largest = [(one.target, abs(one.scale) + abs(one.offset)) for one in command.axis_mappings]
    largest += [(constant.target, abs(constant.value)) for constant in command.message_value]
    for target, value in largest:
        if target not in LIMITS:
            raise ConfigError(f"{at}: target '{target}'; known are {' and '.join(LIMITS)}")
        if value > LIMITS[target]:
            raise ConfigError(f"{at}: {target} up to {value:g}; at most {LIMITS[target]:g}")
        if [other for other, _ in largest].count(target) > 1:
            raise ConfigError(f"{at}: {target} is written twice; leave one out")


def _request(name: str, command: Action | Service, at: str) -> HandRequest:
    if isinstance(command, Action):
        key, full_name, content = "action_name", command.action_name, command.action_goal
        content_key = "action_goal"
    else:
        key, full_name, content = "service_name", command.service_name, command.service_request
        content_key = "service_request"
    short_name = full_name.rpartition("/")[2]
    if short_name not in REQUESTS and short_name not in CONTENTS:
        known = ", ".join((*REQUESTS, *CONTENTS, f"CONTROLLER/{STEP}"))
        raise ConfigError(f"{at}.{key} = '{full_name}': unknown; write one of {known}")
    try:
        if short_name in CONTENTS:
            return HandRequest(name, msgspec.convert(content, CONTENTS[short_name]).request)
        msgspec.convert(content, NoContent)
    except msgspec.ValidationError as error:
        raise ConfigError(add_advice(f"{at}.{content_key}: {error}", "correct it")) from error
    return HandRequest(name, REQUESTS[short_name])
