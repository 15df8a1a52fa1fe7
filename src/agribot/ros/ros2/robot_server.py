"""What a running robot takes over ROS 2: services, goals, parameters, and the inbound topics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.messages import LIVE_SETTINGS, AnyRequest, ControlMission, TickRecord
from agribot.core.messages.requests import find_live_setting
from agribot.core.topics import Topic
from agribot.ros.inbound import InboundTopics
from agribot.ros.pose_request import request_pose
from agribot.ros.requests import PAUSE_SERVICE, SERVICES, SET_POSE_SERVICE, Requests
from agribot.ros.ros2.goals import THROUGH_POSES, TO_POSE, GoalServer
from agribot.ros.ros2.parameters import ParameterServer, Value
from agribot.ros.ros2.route_types import PLAN_ROUTE, load_route_types, make_response
from agribot.ros.ros2.services import load_service_types
from agribot.ros.ros2.serving import Answer, Reply, ServingNode
from agribot.ros.route_plans import PLAN_SERVICE, RoutePlanner
from agribot.ros.send_queue import SendQueue

_MOST_REPLIES = 100  # replies that wait to be sent
# Parameters of Nav2's amcl.
POSE_PARAMETERS = ("initial_pose.x", "initial_pose.y", "initial_pose.yaw")


class Ros2RobotServer:
    """Serves peers of one node; the same requests and rules as in every other network."""

    def __init__(
        self, node: ServingNode, name: str, requests: Requests, settings: Mapping[str, Value]
    ) -> None:
        self._requests, self._planner = requests, RoutePlanner(requests)
        self._source = node.source
        self._pose = dict.fromkeys(POSE_PARAMETERS, math.nan)  # NaN is not set yet
        self._replies: SendQueue[Callable[[], None]] = SendQueue(lambda send: send(), _MOST_REPLIES)
        self._serve_actions(node)
        self._serve_parameters(node, name, settings)
        self._to_pose = GoalServer(node, requests, TO_POSE)
        self._through_poses = GoalServer(node, requests, THROUGH_POSES)
        self._inbound = InboundTopics(requests, self._to_pose.goals, self._through_poses.goals)
        for topic in INBOUND_TOPICS:
            node.subscribe(topic, self._make_listener(topic))

    def step(self, record: TickRecord) -> None:
        self._to_pose.step(record)
        self._through_poses.step(record)

    def close(self) -> None:
        self._replies.close()

    def _serve_actions(self, server: ServingNode) -> None:
        types = load_service_types()
        for name, request in SERVICES:
            server.serve(types, name, "std_srvs/srv/Trigger", self._make_trigger(request))
        none = (False, "these bytes are no SetBool request")
        server.serve(types, PAUSE_SERVICE, "std_srvs/srv/SetBool", self._on_pause, none)
        server.serve(types, SET_POSE_SERVICE, "std_srvs/srv/Trigger", self._on_set_pose)
        for has_cost in (True, False) if server.distinguishes_forms else (True,):
            types = load_route_types(has_cost=has_cost)
            server.serve(types, PLAN_SERVICE, PLAN_ROUTE, self._make_plan(has_cost=has_cost))

    def _serve_parameters(
        self, server: ServingNode, name: str, settings: Mapping[str, Value]
    ) -> None:
        values: dict[str, Value] = {"use_sim_time": True, **self._pose, **settings}
        changeable = frozenset({*LIVE_SETTINGS, *self._pose})
        ParameterServer(server, name, values, changeable, self._change)

    def _change(self, name: str, value: float) -> str:
        if setting := find_live_setting(name):
            return self._requests.request_change(setting, value, self._source)
        if not math.isfinite(value):
            return f"{name} must be finite"
        self._pose[name] = value
        return ""

    def _make_trigger(self, request: AnyRequest) -> Answer:
        return lambda _body, reply: self._ask(request, reply)

    def _on_pause(self, request: Any, reply: Reply) -> None:
        self._ask(ControlMission(action="pause" if request.data else "resume"), reply)

    def _ask(self, request: AnyRequest, reply: Reply) -> None:
        """Answer when the mission has, in a thread that holds up neither robot nor network."""
        self._requests.ask(
            request,
            self._source,
            lambda is_done, text: self._replies.put(lambda: reply(is_done, text)),
        )

    def _on_set_pose(self, _request: Any, reply: Reply) -> None:
        x_m, y_m, yaw_rad = (self._pose[name] for name in POSE_PARAMETERS)
        if math.isnan(x_m + y_m + yaw_rad):
            reply(False, f"set the parameters {', '.join(POSE_PARAMETERS)} first")
            return
        reply(*request_pose(self._requests, (x_m, y_m, yaw_rad), (0.0, 0.0), self._source))

    def _make_plan(self, *, has_cost: bool) -> Answer:
        def answer(request: Any, reply: Reply) -> None:
            plan = self._planner.plan(
                request.header.frame_id,
                request.waypoints,
                self._source,
                from_robot=request.plan_from_vehicle,
            )
            reply(*make_response(request.header, plan, has_cost=has_cost))

        return lambda request, reply: self._replies.put(lambda: answer(request, reply))

    def _make_listener(self, topic: Topic) -> Callable[[bytes], None]:
        def on_message(data: bytes) -> None:
            try:
                self._inbound.take(topic, data, self._source)
            except BridgeError as error:  # a reply that could not be sent
                self._requests.refuse(f"{self._source}: {topic.name}: {error}")

        return on_message
