"""The messages of move_base's action, which the library of message types has not."""

from __future__ import annotations

import functools

from rosbags.typesys.store import Typestore

from agribot.ros.ros1.types import add_ros1_types

_PACKAGE = "move_base_msgs/msg"
ACTION_GOAL = f"{_PACKAGE}/MoveBaseActionGoal"
ACTION_FEEDBACK = f"{_PACKAGE}/MoveBaseActionFeedback"
ACTION_RESULT = f"{_PACKAGE}/MoveBaseActionResult"
GOAL_ID = "actionlib_msgs/msg/GoalID"
GOAL_STATUS = "actionlib_msgs/msg/GoalStatus"
STATUS_ARRAY = "actionlib_msgs/msg/GoalStatusArray"
_STATUS = "Header header\nactionlib_msgs/GoalStatus status\n"
_TEXTS = {
    f"{_PACKAGE}/MoveBaseGoal": "geometry_msgs/PoseStamped target_pose\n",
    f"{_PACKAGE}/MoveBaseFeedback": "geometry_msgs/PoseStamped base_position\n",
    f"{_PACKAGE}/MoveBaseResult": "",
    ACTION_GOAL: "Header header\nactionlib_msgs/GoalID goal_id\nMoveBaseGoal goal\n",
    ACTION_FEEDBACK: _STATUS + "MoveBaseFeedback feedback\n",
    ACTION_RESULT: _STATUS + "MoveBaseResult result\n",
}


@functools.cache
def load_action_types() -> Typestore:
    """Load the messages of ROS 1 with those of the action."""
    return add_ros1_types(_TEXTS)
