"""The topics on which a running robot takes requests; the names of RViz's tools are among them."""

from __future__ import annotations

from agribot.core.topics import Topic

GOAL_POSE = Topic(
    name="/goal_pose",
    ros_type="geometry_msgs/msg/PoseStamped",
    direction="in",
    seed_alias="/move_base_simple/goal",
    seed_ros_type="geometry_msgs/msg/PoseStamped",
    about="a place to drive to, and how to stand there; an orientation of zeros leaves that open",
)
INITIAL_POSE = Topic(
    name="/initialpose",
    ros_type="geometry_msgs/msg/PoseWithCovarianceStamped",
    direction="in",
    about="where the robot stands; a covariance of zeros counts as 0.5 m and 15 degrees",
)
CLICKED_POINT = Topic(
    name="/clicked_point",
    ros_type="geometry_msgs/msg/PointStamped",
    direction="in",
    about="a place to note in the recording; nothing moves",
)
VISIT = Topic(
    name="/agribot/visit",
    ros_type="geometry_msgs/msg/PoseArray",
    direction="in",
    about="places to visit in this order in place of the mission; orientations are not used",
)
COMMAND = Topic(
    name="/agribot/command",
    ros_type="std_msgs/msg/String",
    direction="in",
    about="the last part of a service's name, such as stop; for clients without services",
)
INBOUND_TOPICS: tuple[Topic, ...] = (GOAL_POSE, INITIAL_POSE, CLICKED_POINT, VISIT, COMMAND)
