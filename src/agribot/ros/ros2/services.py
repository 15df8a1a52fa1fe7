"""Services and actions of ROS 2, built here because the library of message types has none.

An action of type A is three services and two topics: A_SendGoal, A_GetResult and
action_msgs/CancelGoal, A_FeedbackMessage and action_msgs/GoalStatusArray.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.messages.char_types import replace_char

EVENT_INFO = "service_msgs/msg/ServiceEventInfo"
_SERVICES = {
    "std_srvs/srv/Trigger": ("", "bool success\nstring message\n"),
    "std_srvs/srv/SetBool": ("bool data\n", "bool success\nstring message\n"),
    "action_msgs/srv/CancelGoal": (
        "action_msgs/GoalInfo goal_info\n",
        "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
    ),
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth\n", "rcl_interfaces/ListParametersResult result\n",
    ),
    "rcl_interfaces/srv/GetParameters": (
        "string[] names\n", "rcl_interfaces/ParameterValue[] values\n",
    ),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names\n", "uint8[] types\n"),
    "rcl_interfaces/srv/DescribeParameters": (
        "string[] names\n", "rcl_interfaces/ParameterDescriptor[] descriptors\n",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "rcl_interfaces/Parameter[] parameters\n", "rcl_interfaces/SetParametersResult[] results\n",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "rcl_interfaces/Parameter[] parameters\n", "rcl_interfaces/SetParametersResult result\n",
    ),
}  # fmt: skip


class ActionText(NamedTuple):
    goal: str
    result: str
    feedback: str


NAVIGATE = "nav2_msgs/action/NavigateThroughPoses"
_NAVIGATE_GOAL = "geometry_msgs/PoseStamped[] poses\nstring behavior_tree\n"
_NAVIGATE_FEEDBACK = """geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
int16 number_of_poses_remaining
"""
NAVIGATE_TO_POSE = "nav2_msgs/action/NavigateToPose"
_TO_POSE_GOAL = "geometry_msgs/PoseStamped pose\nstring behavior_tree\n"
_TO_POSE_FEEDBACK = _NAVIGATE_FEEDBACK.replace("int16 number_of_poses_remaining\n", "")
# Results of ROS 2 Jazzy, with the text that was added later and without; the hash distinguishes
# them.
NAVIGATE_RESULTS = ("uint16 error_code\nstring error_msg\n", "uint16 error_code\n")
_UUID = "unique_identifier_msgs/UUID goal_id\n"
# Member of an empty request or response.
_PLACEHOLDER = "uint8 structure_needs_at_least_one_member\n"


@functools.cache
def load_service_types(navigate_result: str = NAVIGATE_RESULTS[0]) -> Typestore:
    """Load the messages of ROS 2 Jazzy with the services and the actions above and their hashes."""
    store = get_typestore(Stores.ROS2_JAZZY)
    replace_char(store)
    for name, (request, response) in _SERVICES.items():
        add_service(store, name, request, response)
    add_action(store, NAVIGATE, ActionText(_NAVIGATE_GOAL, navigate_result, _NAVIGATE_FEEDBACK))
    to_pose = ActionText(_TO_POSE_GOAL, navigate_result, _TO_POSE_FEEDBACK)
    add_action(store, NAVIGATE_TO_POSE, to_pose)
    return store


def add_action(store: Typestore, name: str, text: ActionText) -> None:
    for part, fields in zip(("Goal", "Result", "Feedback"), text, strict=True):
        store.register({f"{name}_{part}": _parse_fields(fields)})
    # A type of kind "action" cannot be named in .msg text, so it is put in as a field.
    goal, result, feedback = (
        (part.lower(), _make_name_node(f"{name}_{part}")) for part in ("Goal", "Result", "Feedback")
    )
    send, get = f"{name}_SendGoal", f"{name}_GetResult"
    stamp = "bool accepted\nbuiltin_interfaces/Time stamp\n"
    add_service(store, send, _UUID, stamp, request_too=goal)
    add_service(store, get, _UUID, "int8 status\n", response_too=result)
    store.register({f"{name}_FeedbackMessage": _add_field(_parse_fields(_UUID), feedback)})
    parts: list[tuple[str, Any]] = [
        goal,
        result,
        feedback,
        ("send_goal_service", _make_name_node(send)),
        ("get_result_service", _make_name_node(get)),
        ("feedback_message", _make_name_node(f"{name}_FeedbackMessage")),
    ]
    store.fielddefs[name] = ([], parts)


def add_service(
    store: Typestore,
    name: str,
    request: str,
    response: str,
    request_too: tuple[str, Any] | None = None,
    response_too: tuple[str, Any] | None = None,
) -> None:
    store.register({f"{name}_Request": _add_field(_parse_fields(request), request_too)})
    store.register({f"{name}_Response": _add_field(_parse_fields(response), response_too)})
    event: list[tuple[str, Any]] = [
        ("info", _make_name_node(EVENT_INFO)),
        ("request", _make_optional_node(f"{name}_Request")),
        ("response", _make_optional_node(f"{name}_Response")),
    ]
    service: list[tuple[str, Any]] = [
        ("request_message", _make_name_node(f"{name}_Request")),
        ("response_message", _make_name_node(f"{name}_Response")),
        ("event_message", _make_name_node(f"{name}_Event")),
    ]
    store.fielddefs[f"{name}_Event"] = ([], event)
    store.fielddefs[name] = ([], service)


def _parse_fields(text: str) -> Any:
    """Parse constants and fields of a .msg text, without a name: rosbags would add msg/ to it."""
    (definition,) = get_types_from_msg(text or _PLACEHOLDER, "agribot/msg/Part").values()
    return definition


def _add_field(definition: Any, field: tuple[str, Any] | None) -> Any:
    constants, fields = definition
    return (constants, [*fields, field] if field else fields)


def _make_name_node(ros_type: str) -> tuple[Nodetype, str]:
    return (Nodetype.NAME, ros_type)


def _make_optional_node(ros_type: str) -> tuple[Nodetype, Any]:
    return (Nodetype.SEQUENCE, (_make_name_node(ros_type), 1))
