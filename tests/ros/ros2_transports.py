"""A user's program on each of the two networks of ROS 2: rmw_zenoh's wire, and DDS."""

from __future__ import annotations

import itertools
import math
import statistics
import struct
from abc import ABC, abstractmethod
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from rosbags.typesys.store import Typestore

from agribot.core import topics
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode, write
from agribot.ros.messages import rosmsg
from agribot.ros.messages.dds_names import from_dds_name
from agribot.ros.ros2 import wire
from agribot.ros.ros2.node import ROUTER, Ros2Node, TopicPublisher
from agribot.ros.ros2.robot_server import POSE_PARAMETERS
from agribot.ros.ros2.route_types import PLAN_ROUTE, load_route_types
from agribot.ros.ros2.services import NAVIGATE_TO_POSE, load_service_types
from agribot.ros.route_plans import PLAN_SERVICE
from tests.waiting import PATIENCE_S, wait_for

KEPT = 2000
LOUD_RADPS = 0.05
CLIENT_HEADER = struct.Struct("<Qq")  # a client's number, and that of its request
EMPTY = 0  # what stands in a request without fields
DOUBLE = 3  # of rcl_interfaces/ParameterType
Step = tuple[str, Callable[[Any], str]]


class Transport(Protocol):
    """How a user's program speaks with the robot; `steps` are those of this network alone."""

    name: str
    heard: dict[str, deque[Any]]
    steps: tuple[Step, ...]

    def hear(self, topic: Topic) -> None: ...

    def list_topics(self) -> dict[str, str]: ...

    def publish(self, topic: Topic, *fields: Any) -> None:
        """Publish one message once the robot listens."""
        ...

    def request(self, name: str) -> None: ...

    def go_to(self, x_m: float, y_m: float) -> None: ...

    def close(self) -> None: ...


def make_inbox() -> dict[str, deque[Any]]:
    return defaultdict(lambda: deque(maxlen=KEPT))


def decode(topic: Topic, data: bytes) -> Any:
    return rosmsg.load_types().deserialize_cdr(data, topic.ros_type)


def encode(topic: Topic, *fields: Any) -> bytes:
    return rosmsg.to_cdr(rosmsg.make_message(topic.ros_type, *fields))


class RequestingUser(ABC):
    """What is asked by services, actions and parameters, whatever carries them."""

    distinguishes_forms: bool

    def __init__(self) -> None:
        self._types = load_service_types()
        self.heard = make_inbox()
        self.steps: tuple[Step, ...] = (
            ("set_pose of the parameters", self._set_pose),
            ("noise of the gyro as a parameter", self._change_noise),
            ("mapviz, plan_route", self._plan_a_route),
        )

    @abstractmethod
    def _call(self, name: str, ros_type: str, *fields: Any, types: Typestore | None = None) -> Any:
        """Call a service, and give what it answers."""

    def request(self, name: str) -> None:
        kind, fields = ("SetBool", (True,)) if name == "pause" else ("Trigger", (EMPTY,))
        self._call(f"/agribot/{name}", f"std_srvs/srv/{kind}", *fields)

    def go_to(self, x_m: float, y_m: float) -> None:
        pose = rosmsg.make_message(
            "geometry_msgs/msg/PoseStamped",
            rosmsg.make_header(0.0, "map"),
            rosmsg.make_pose(x_m, y_m, math.pi / 2.0),
        )
        goal = self._types.types[f"{NAVIGATE_TO_POSE}_Goal"](pose, "")
        uuid = self._types.types["unique_identifier_msgs/msg/UUID"](
            np.frombuffer(np.array([x_m, y_m]).tobytes(), np.uint8)
        )
        answer = self._call(
            "/navigate_to_pose/_action/send_goal", f"{NAVIGATE_TO_POSE}_SendGoal", uuid, goal
        )
        assert answer.accepted

    def _set_pose(self, user: Any) -> str:
        """The robot believes it until its receiver knows better."""
        x_m, y_m, yaw_rad = user.truth
        for name, value in zip(POSE_PARAMETERS, (x_m, y_m + 0.4, yaw_rad), strict=True):
            self._set_parameter("agribot", name, value)
        self.heard[topics.ODOMETRY.name].clear()
        self.request("set_pose")
        said: str = user.wait_until_believed(x_m, y_m + 0.4)
        return said

    def _change_noise(self, _user: Any) -> str:
        deviations = [self._measure_gyro_radps()]
        for value in (LOUD_RADPS, 0.0):
            self._set_parameter("agribot_sensors", "gyro.gaussian_noise", value)
            deviations.append(self._measure_gyro_radps())
        quiet, loud, again = deviations
        seen = f"gyro {quiet:.4f}, {loud:.4f}, {again:.4f} rad/s"
        assert abs(loud - math.hypot(LOUD_RADPS, quiet)) < 0.01, seen
        assert quiet < 0.01 and again < 0.01, seen
        return seen

    def _plan_a_route(self, user: Any) -> str:
        """With the route's cost, and where the network distinguishes forms as it was before."""
        forms = (True, False) if self.distinguishes_forms else (True,)
        lengths_m = [self._measure_route_m(user, has_cost=has_cost) for has_cost in forms]
        assert abs(lengths_m[0] - lengths_m[-1]) < 0.1 and user.stands, lengths_m
        return f"{lengths_m[0]:.2f} m, not driven"

    def _measure_route_m(self, user: Any, *, has_cost: bool) -> float:
        header, x_m, y_m = rosmsg.make_header(0.0, "map"), user.truth[0], user.truth[1]
        waypoints = [rosmsg.make_pose(x_m, y_m + ahead_m, math.pi / 2.0) for ahead_m in (1.0, 2.0)]
        types = load_route_types(has_cost=has_cost)
        answer = self._call(PLAN_SERVICE, PLAN_ROUTE, header, waypoints, True, types=types)
        assert answer.success, answer.message
        points = [(p.pose.position.x, p.pose.position.y) for p in answer.route.route_points]
        assert math.dist(points[0], (x_m, y_m)) < 0.1, points[0]
        assert math.dist(points[-1], (x_m, y_m + 2.0)) < 0.05, points[-1]
        length_m = sum(itertools.starmap(math.dist, itertools.pairwise(points)))
        assert not has_cost or abs(answer.cost - length_m) < 0.05, answer.cost
        return length_m

    def _measure_gyro_radps(self) -> float:
        """The deviation of what is sampled a moment from now on."""
        inbox = self.heard[topics.IMU.name]
        inbox.clear()
        wait_for(lambda: len(inbox) > 250, "the IMU")
        rates_radps: list[float] = [m.angular_velocity.x for m in list(inbox.copy())[50:250]]
        return statistics.pstdev(rates_radps)

    def _set_parameter(self, node: str, name: str, value: float) -> None:
        make, nothing = self._types.types, np.zeros(0)
        packed = make["rcl_interfaces/msg/ParameterValue"](
            DOUBLE, False, 0, value, "", nothing.astype(np.uint8), nothing.astype(bool),
            nothing.astype(np.int64), nothing, [],
        )  # fmt: skip
        parameter = make["rcl_interfaces/msg/Parameter"](name, packed)
        answer = self._call(
            f"/{node}/set_parameters", "rcl_interfaces/srv/SetParameters", [parameter]
        )
        assert answer.results[0].successful, answer.results[0].reason


class ZenohUser(RequestingUser):
    """On rmw_zenoh's wire."""

    name = "zenoh"
    distinguishes_forms = True

    def __init__(self, router: str = ROUTER, domain: int = 0) -> None:
        self._node = Ros2Node("user", domain, router, listen=False)
        super().__init__()
        self._writers: dict[str, TopicPublisher] = {}

    def hear(self, topic: Topic) -> None:
        inbox = self.heard[topic.name]
        self._node.subscribe(topic, lambda data: inbox.append(decode(topic, data)), topic.qos)

    def list_topics(self) -> dict[str, str]:
        return self._node.list_topics()

    def publish(self, topic: Topic, *fields: Any) -> None:
        if topic.name not in self._writers:
            self._writers[topic.name] = self._node.create_publisher(topic)
        writer = self._writers[topic.name]
        wait_for(lambda: writer._publisher.matching_status.matching, topic.name)
        writer(encode(topic, *fields))

    def close(self) -> None:
        self._node.close()

    def _call(self, name: str, ros_type: str, *fields: Any, types: Typestore | None = None) -> Any:
        types = types or self._types
        request_type = f"{ros_type}_Request"
        request = types.types[request_type](*fields)
        key = wire.make_topic_key(self._node.domain, name, ros_type, types.hash_rihs01(ros_type))
        replies = self._node.session.get(
            key, payload=bytes(types.serialize_cdr(request, request_type)),
            attachment=wire.pack_attachment(1, 0, bytes(16)), timeout=PATIENCE_S,
        )  # fmt: skip
        (payload,) = (reply.ok.payload for reply in replies if reply.ok is not None)
        return types.deserialize_cdr(payload.to_bytes(), f"{ros_type}_Response")


class DdsUser(RequestingUser):
    """On DDS, with services as rmw_cyclonedds carries them."""

    name = "dds"
    distinguishes_forms = False

    def __init__(self, domain: int = 0) -> None:
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication

        super().__init__()
        self._node = DdsNode("user", domain)
        self._writers: dict[str, Any] = {}
        self._clients: dict[str, DdsClient] = {}
        self._listed: dict[str, str] = {}
        self._publications: Any = BuiltinDataReader(
            self._node.participant, BuiltinTopicDcpsPublication
        )

    def hear(self, topic: Topic) -> None:
        inbox = self.heard[topic.name]
        self._node.subscribe(topic, lambda data: inbox.append(decode(topic, data)))

    def list_topics(self) -> dict[str, str]:
        for seen in self._publications.take(500):
            ros_type = from_dds_name(seen.type_name)
            self._listed[seen.topic_name.removeprefix("rt")] = ros_type
        return self._listed

    def publish(self, topic: Topic, *fields: Any) -> None:
        if topic.name not in self._writers:
            self._writers[topic.name] = self._node._create_writer(topic, f"rt{topic.name}")
        writer = self._writers[topic.name]
        wait_for(writer.get_matched_subscriptions, topic.name)
        write(writer, encode(topic, *fields))

    def close(self) -> None:
        self._writers.clear()
        self._clients.clear()
        self._publications = None
        self._node.close()

    def _call(self, name: str, ros_type: str, *fields: Any, types: Typestore | None = None) -> Any:
        types = types or self._types
        if name not in self._clients:
            self._clients[name] = DdsClient(self._node, name, ros_type, types)
        request = types.types[f"{ros_type}_Request"](*fields)
        data = bytes(types.serialize_cdr(request, f"{ros_type}_Request"))
        answer = self._clients[name].call(data)
        return types.deserialize_cdr(answer, f"{ros_type}_Response")


class DdsClient:
    """A client of one service, which knows its answers by what its requests begin with."""

    def __init__(self, node: DdsNode, name: str, ros_type: str, types: Typestore) -> None:
        self.name, self._numbers = name, itertools.count(1)
        self._answers: deque[bytes] = deque()
        request, response = (
            Topic(name=name, ros_type=f"{ros_type}_{part}") for part in ("Request", "Response")
        )
        self._writer = node.open_writer(request, f"rq{name}Request", types, "clientid=1;")
        node.open_reader(
            response, f"rr{name}Reply", lambda data, _from: self._answers.append(data), types,
            "clientid=1;",
        )  # fmt: skip

    def call(self, data: bytes) -> bytes:
        """Once the service is there; the answer without the sixteen bytes."""
        wait_for(self._writer.get_matched_subscriptions, self.name)
        mark = CLIENT_HEADER.pack(4711, next(self._numbers))
        write(self._writer, data[:4] + mark + data[4:])
        answers = wait_for(lambda: self._pick(mark), f"the answer of {self.name}")
        return answers[0][:4] + answers[0][20:]

    def _pick(self, mark: bytes) -> list[bytes]:
        return [answer for answer in self._answers.copy() if answer[4:20] == mark]


TRANSPORTS: dict[str, Callable[[], Transport]] = {"zenoh": ZenohUser, "dds": DdsUser}
