"""The services of a running robot in ROS 1; names and rules are those of every network."""

from __future__ import annotations

import queue
import struct

from agribot.core.errors import BridgeError
from agribot.core.messages import AnyRequest, ControlMission
from agribot.ros.pose_request import request_pose
from agribot.ros.requests import PAUSE_SERVICE, SERVICES, SET_POSE_SERVICE, Requests
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.route_types import PLAN_ROUTE, pack_response, read_request
from agribot.ros.ros1.service_server import SET_BOOL, TRIGGER, Answer, Ros1ServiceServer
from agribot.ros.route_plans import PLAN_SERVICE, RoutePlanner

POSE_PARAMETER = "/agribot/initial_pose"
_EXAMPLE = "rosparam set /agribot/initial_pose '{x: 1.0, y: 2.0, yaw: 1.57}'"


def serve_robot(node: Node, requests: Requests) -> Ros1ServiceServer:
    """Serve what stops, pauses and resumes the robot, and the rest of SERVICES.

    Raises: BridgeError: the master refuses a service.
    """
    server = Ros1ServiceServer(node, requests.refuse)
    try:
        for name, request in SERVICES:
            server.serve(name, TRIGGER, _make_trigger(requests, request))
        server.serve(PAUSE_SERVICE, SET_BOOL, _make_pause(requests))
        server.serve(SET_POSE_SERVICE, TRIGGER, _make_set_pose(node, requests))
        server.serve(PLAN_SERVICE, PLAN_ROUTE, _make_plan(RoutePlanner(requests)))
    except BridgeError:
        server.close()
        raise
    return server


def _make_trigger(requests: Requests, request: AnyRequest) -> Answer:
    def answer(body: bytes, source: str) -> bytes:
        if body:
            raise BridgeError(f"{len(body)} bytes; a request of std_srvs/Trigger is empty")
        return _ask(requests, request, source)

    return answer


def _make_pause(requests: Requests) -> Answer:
    def answer(request: bytes, source: str) -> bytes:
        if len(request) != 1:
            raise BridgeError(f"{len(request)} bytes; a request of std_srvs/SetBool has one")
        control = ControlMission(action="pause" if request[0] else "resume")
        return _ask(requests, control, source)

    return answer


def _ask(requests: Requests, request: AnyRequest, source: str) -> bytes:
    """Ask the mission and wait: each client has a thread of its own."""
    outcomes: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
    requests.ask(request, source, lambda is_done, text: outcomes.put((is_done, text)))
    return _pack_outcome(*outcomes.get())


def _make_set_pose(node: Node, requests: Requests) -> Answer:
    def answer(_request: bytes, source: str) -> bytes:
        try:
            pose = read_pose_parameter(node)
        except BridgeError as error:
            return _pack_outcome(False, str(error))
        return _pack_outcome(*request_pose(requests, pose, (0.0, 0.0), source))

    return answer


def _make_plan(planner: RoutePlanner) -> Answer:
    def answer(request: bytes, source: str) -> bytes:
        wanted = read_request(request)
        plan = planner.plan(
            wanted.header.frame_id,
            wanted.waypoints,
            source,
            from_robot=wanted.plan_from_vehicle,
        )
        return pack_response(wanted.header, plan)

    return answer


def read_pose_parameter(node: Node) -> tuple[float, float, float]:
    """Read x, y (m, map) and yaw (rad) from the master.

    Raises: BridgeError: the parameter is not set, or invalid.
    """
    try:
        value = node.ask_master("getParam", POSE_PARAMETER)
    except BridgeError as error:
        raise BridgeError(f"{POSE_PARAMETER} is not set; first {_EXAMPLE}") from error
    try:
        return float(value["x"]), float(value["y"]), float(value["yaw"])
    except (TypeError, KeyError, ValueError) as error:
        raise BridgeError(f"{POSE_PARAMETER} is {str(value)[:100]}; write {_EXAMPLE}") from error


def _pack_outcome(is_done: bool, text: str) -> bytes:
    """Pack `bool success` and `string message`."""
    body = text.encode()
    return struct.pack("<?I", is_done, len(body)) + body
