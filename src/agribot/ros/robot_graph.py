"""The parts of the robot's own program, and the topics between them.

Inside the robot there is no bus: an arrow is a value that the one part hands to the other, under
the name that it has in recordings and on networks.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from agribot.core import topics
from agribot.core.topics import TOPICS, Topic
from agribot.ros.graph import Graph, GraphTopic


class _Part(NamedTuple):
    name: str
    says: tuple[Topic, ...] = ()
    hears: tuple[Topic, ...] = ()


_PARTS = (
    _Part(
        "sensors",
        (topics.FIX, topics.FIX_VELOCITY, topics.EXTENDED_FIX, topics.POLE_FIX, topics.IMU,
         topics.POLE_FIX_VELOCITY, topics.MAGNETIC, topics.JOINT_STATES, topics.ODOM,
         topics.BUMPER, topics.BATTERY),
    ),
    _Part("lidar", (topics.SCAN,)),
    _Part("camera", (topics.IMAGE, topics.IMAGE_RAW, topics.CAMERA_INFO)),
    _Part(
        "estimate",
        (topics.ODOMETRY, topics.POSE, topics.TF, topics.HEADING_RAW, topics.HEADING_FILTERED),
        (topics.FIX, topics.FIX_VELOCITY, topics.POLE_FIX, topics.IMU, topics.MAGNETIC,
         topics.JOINT_STATES, topics.OVERLAY),
    ),
    _Part("perceive", (topics.OVERLAY,), (topics.IMAGE,)),
    _Part("weed map", (topics.WEEDS,), (topics.OVERLAY, topics.ODOMETRY)),
    _Part("implement", (), (topics.WEEDS, topics.ODOMETRY)),
    _Part(
        "mission",
        (topics.PATH, topics.GOALS, topics.GOAL_FIX, topics.GOAL_POSE, topics.STATUS,
         topics.CALIBRATED),
        (topics.ODOMETRY,),
    ),
    _Part(
        "follower",
        (topics.DISTANCE, topics.BEARING, topics.ANGLE),
        (topics.PATH, topics.ODOMETRY),
    ),
    _Part("supervisor", (topics.CMD_VEL, topics.TICK),
          (topics.ANGLE, topics.STATUS, topics.ODOMETRY,
           topics.BUMPER, topics.BATTERY)),
    _Part("motors", (), (topics.CMD_VEL,)),
    _Part("description", (topics.ROBOT_DESCRIPTION, topics.TF_STATIC)),
    _Part("page", (topics.CLICKED_POINT, topics.DRAWN_POLYGON, topics.DRAWN_ROUTE),
          (topics.ODOMETRY, topics.STATUS, topics.WEEDS, topics.PATH)),
    _Part("recorder", (), (topics.TICK,)),
    _Part("simulator", (topics.CLOCK, topics.GROUND_TRUTH, topics.IMU_BIAS)),
)  # fmt: skip
# Topic of each sensor's samples.
SENSOR_TOPICS = {"gnss": topics.FIX, "imu": topics.IMU, "mag": topics.MAGNETIC,
                 "wheels": topics.JOINT_STATES, "frames": topics.IMAGE}  # fmt: skip


def make_robot_graph(
    rates_hz: Mapping[str, float] | None = None,
    absent: Sequence[str] = (),
    bridges: Sequence[str] = (),
) -> Graph:
    """Make the graph of a run: without the parts that are `absent`, with its `bridges`.

    `rates_hz` are measured ones by topic name; without any, those of the table are shown.
    """
    publishers: defaultdict[str, list[str]] = defaultdict(list)
    subscribers: defaultdict[str, list[str]] = defaultdict(list)
    parts = [part for part in _PARTS if part.name not in absent]
    parts += [_Part(f"bridge {name}", (), (topics.TICK,)) for name in bridges]
    for part in parts:
        for topic in part.says:
            publishers[topic.name].append(part.name)
        for topic in part.hears:
            subscribers[topic.name].append(part.name)
    found = tuple(
        GraphTopic(
            name=topic.name,
            ros_type=topic.ros_type,
            publishers=tuple(publishers[topic.name]),
            subscribers=tuple(subscribers[topic.name]),
            rate_hz=topic.rate_hz if rates_hz is None else rates_hz.get(topic.name),
        )
        for topic in TOPICS
        if publishers[topic.name]
    )
    return Graph(network="robot", nodes=tuple(part.name for part in parts), topics=found)
