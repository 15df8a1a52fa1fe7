"""Another process sends the robot to places: nav2_msgs/NavigateThroughPoses, and parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.app.simulated_run import SimulatedRun
from agribot.core.fact_text import render
from agribot.core.facts import NotResumed, StopHolds
from agribot.core.inbound_topics import CLICKED_POINT, COMMAND, GOAL_POSE, INITIAL_POSE, VISIT
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.ros2 import wire
from agribot.ros.ros2.goals import THROUGH_POSES
from agribot.ros.ros2.services import (
    NAVIGATE,
    NAVIGATE_RESULTS,
    NAVIGATE_TO_POSE,
    load_service_types,
)
from tests.ros.driven_robot import driven_robot, list_texts
from tests.ros.live import Talk, free_port, zenoh_peer
from tests.waiting import wait_for

MARK = wire.pack_attachment(1, 0, bytes(range(16))).hex()
TYPES = load_service_types()
ACTION = "/navigate_through_poses/_action"
FEEDBACK, STATUS = THROUGH_POSES.feedback, THROUGH_POSES.status
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


class Client:
    """What `ros2 action send_goal` and `ros2 param` put on the wire."""

    def __init__(self, talk: Talk, session: SimulatedRun) -> None:
        self._talk, self.session = talk, session
        self.map_from = session.world.spawn_xy_map_m

    def call(self, name: str, ros_type: str, *fields: Any, types: Any = TYPES) -> Any:
        request = types.types[f"{ros_type}_Request"](*fields)
        data = bytes(types.serialize_cdr(request, f"{ros_type}_Request"))
        key = wire.make_topic_key(0, name, ros_type, types.hash_rihs01(ros_type))
        ((payload, _),) = self._talk("call", key, data.hex(), MARK)
        return types.deserialize_cdr(bytes.fromhex(payload), f"{ros_type}_Response")

    def send(self, number: int, *places: tuple[float, float], frame: str = "map") -> bool:
        poses = [
            rosmsg.make_message(
                "geometry_msgs/msg/PoseStamped",
                rosmsg.make_header(0.0, frame),
                rosmsg.make_pose(x, y, 0.0),
            )
            for x, y in places
        ]
        goal = TYPES.types[f"{NAVIGATE}_Goal"](poses, "")
        answer = self.call(f"{ACTION}/send_goal", f"{NAVIGATE}_SendGoal", uuid(number), goal)
        return bool(answer.accepted)

    def result(self, number: int, text: str = NAVIGATE_RESULTS[0]) -> Any:
        return self.call(
            f"{ACTION}/get_result",
            f"{NAVIGATE}_GetResult",
            uuid(number),
            types=load_service_types(text),
        )

    def cancel(self, number: int) -> Any:
        stamp = rosmsg.make_message("builtin_interfaces/msg/Time", 0, 0)
        info = TYPES.types["action_msgs/msg/GoalInfo"](uuid(number), stamp)
        return self.call(f"{ACTION}/cancel_goal", "action_msgs/srv/CancelGoal", info)

    def heard(self, topic: Any) -> list[Any]:
        key = wire.make_topic_key(0, topic.name, topic.ros_type, TYPES.hash_rihs01(topic.ros_type))
        said = self._talk("dump")["heard"].get(key, [])
        return [TYPES.deserialize_cdr(bytes.fromhex(data), topic.ros_type) for data, _ in said]

    def states(self) -> list[int]:
        """Of the newest goal, in the order published."""
        return [message.status_list[-1].status for message in self.heard(STATUS)]

    def parameter(self, name: str) -> Any:
        answer = self.call("/agribot/get_parameters", "rcl_interfaces/srv/GetParameters", [name])
        return answer.values[0]

    def trigger(self, name: str) -> Any:
        return self.call(name, "std_srvs/srv/Trigger", 0)

    def publish(self, topic: Topic, *fields: Any) -> None:
        """One message; the robot hears what is published after it has subscribed."""
        data = rosmsg.to_cdr(rosmsg.make_message(topic.ros_type, *fields))
        key = wire.make_topic_key(0, topic.name, topic.ros_type, TYPES.hash_rihs01(topic.ros_type))
        time.sleep(0.06)  # slower than the limit of a topic
        self._talk("put", key, data.hex(), MARK)

    def to_pose(self, number: int, pose: Any, frame: str = "map") -> bool:
        stamped = rosmsg.make_message(GOAL_POSE.ros_type, rosmsg.make_header(0.0, frame), pose)
        goal = TYPES.types[f"{NAVIGATE_TO_POSE}_Goal"](stamped, "")
        name, kind = "/navigate_to_pose/_action/send_goal", f"{NAVIGATE_TO_POSE}_SendGoal"
        return bool(self.call(name, kind, uuid(number), goal).accepted)

    def to_pose_result(self, number: int) -> Any:
        name = "/navigate_to_pose/_action/get_result"
        return self.call(name, f"{NAVIGATE_TO_POSE}_GetResult", uuid(number))

    def events(self, text: str) -> list[str]:
        return [e.reason for e in self.session.event_log.list_since(0) if text in e.reason]

    def set(self, name: str, value: float) -> Any:
        make = TYPES.types
        nothing = np.zeros(0)
        packed = make["rcl_interfaces/msg/ParameterValue"](
            3, False, 0, value, "", nothing.astype(np.uint8), nothing.astype(bool),
            nothing.astype(np.int64), nothing, [],
        )  # fmt: skip
        parameter = make["rcl_interfaces/msg/Parameter"](name, packed)
        kind = "rcl_interfaces/srv/SetParameters"
        return self.call("/agribot/set_parameters", kind, [parameter]).results[0]


def uuid(number: int) -> Any:
    return TYPES.types["unique_identifier_msgs/msg/UUID"](np.full(16, number, dtype=np.uint8))


@contextmanager
def robot(out_dir: Path, *arguments: str) -> Iterator[Client]:
    """A simulated robot that waits for goals, and a program of ROS 2 beside it."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    options = ("--ros2", "--ros-router", locator, *arguments)
    with driven_robot(out_dir, *options) as session, zenoh_peer(locator) as talk:
        yield Client(talk, session)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    with robot(tmp_path_factory.mktemp("goals"), "--allow-drive") as client:
        yield client


def test_a_goal_is_driven_reported_and_succeeds(client: Client) -> None:
    x_m, y_m = client.map_from
    places = [(x_m - 1.0, y_m + 1.0), (x_m - 1.0, y_m + 3.0)]
    assert client.send(1, *places)
    wait_for(lambda: client.states()[-1:] == [SUCCEEDED], "the goal's end")
    assert client.states()[-3:] == [1, 2, SUCCEEDED]
    result = client.result(1)
    assert (result.status, result.result.error_code) == (SUCCEEDED, 0)
    assert client.result(1, NAVIGATE_RESULTS[1]).result.error_code == 0  # the older result
    truth = client.session.simulator.truth()
    assert np.hypot(truth.x_map_m - places[1][0], truth.y_map_m - places[1][1]) < 0.2
    feedback = [m for m in client.heard(FEEDBACK) if m.goal_id.uuid[0] == 1]
    left = [message.feedback.number_of_poses_remaining for message in feedback]
    assert left[0] == 2
    assert left == sorted(left, reverse=True)
    ahead_m = [message.feedback.distance_remaining for message in feedback]
    assert ahead_m == sorted(ahead_m, reverse=True)
    assert feedback[0].feedback.current_pose.header.frame_id == "map"


def test_a_result_that_is_asked_for_early_comes_with_the_end_and_cancel_stops(
    client: Client,
) -> None:
    x_m, y_m = client.map_from
    assert client.send(2, (x_m - 4.0, y_m - 6.0))
    wait_for(lambda: client.states()[-1:] == [2], "the goal to be driven")
    answer = client.cancel(2)
    assert answer.return_code == 0
    assert [goal.goal_id.uuid[0] for goal in answer.goals_canceling] == [2]
    assert client.result(2).status == CANCELED
    assert client.cancel(2).return_code == 3  # it is over
    assert client.cancel(77).return_code == 2  # an unknown goal
    wait_for(lambda: abs(client.session.simulator.truth().v_mps) < 0.01, "the robot to stand")


def test_a_new_goal_takes_the_place_of_the_one_before(client: Client) -> None:
    x_m, y_m = client.map_from
    assert client.send(3, (x_m - 4.0, y_m - 6.0))
    wait_for(lambda: client.states()[-1:] == [2], "the first goal to be driven")
    assert client.send(4, (x_m - 1.0, y_m - 1.0))
    replaced = client.result(3)
    assert replaced.status == ABORTED
    assert "took its place" in replaced.result.error_msg
    assert client.result(99).status == 0  # an unknown goal


def test_a_goal_across_the_crop_is_refused_by_the_planner_with_its_words(client: Client) -> None:
    assert client.send(5, (2.5, 6.0), (4.5, 6.0))
    result = client.result(5)
    assert result.status == ABORTED
    assert result.result.error_msg in list_texts(client.session, "over_crop")


def test_what_is_no_goal_is_not_accepted(client: Client) -> None:
    assert not client.send(6)
    assert not client.send(6, (1.0, 1.0), frame="base_link")
    assert not client.send(6, (float("nan"), 1.0))


def test_one_pose_is_driven_to_though_a_visit_knows_no_errands(client: Client) -> None:
    x_m, y_m = client.map_from
    assert client.to_pose(8, rosmsg.make_pose(x_m - 2.0, y_m + 1.0, math.pi / 2.0))
    assert client.to_pose_result(8).status == SUCCEEDED
    truth = client.session.simulator.truth()
    assert math.hypot(truth.x_map_m - x_m + 2.0, truth.y_map_m - y_m - 1.0) < 0.2
    assert not client.to_pose(9, rosmsg.make_pose(math.nan, 1.0, 0.0))
    assert client.to_pose(10, rosmsg.make_pose(500.0, 1.0, 0.0))
    refused = client.to_pose_result(10)
    assert refused.status == ABORTED
    # The pose is beyond the fence, and the way there leads over crop or past an obstacle.
    codes = ("beyond_fence", "over_crop", "near_obstacle")
    assert refused.result.error_msg in list_texts(client.session, *codes)


def test_services_say_what_the_mission_makes_of_a_request(client: Client) -> None:
    assert client.trigger("/agribot/stop").success
    refused = client.trigger("/agribot/resume")
    assert (refused.success, refused.message) == (False, render(NotResumed(StopHolds())))
    assert client.trigger("/agribot/clear_stop").success
    assert "initial_pose.yaw" in client.trigger("/agribot/set_pose").message
    truth = client.session.simulator.truth()
    for name, value in zip(["x", "y", "yaw"], (truth.x_map_m, truth.y_map_m, 0.1), strict=True):
        assert client.set(f"initial_pose.{name}", value).successful
    wait_for(lambda: client.trigger("/agribot/set_pose").success, "the robot to stand")
    wait_for(lambda: client.events(f"pose_estimate {truth.x_map_m:.3f}"), "the pose")


def test_what_the_tools_of_rviz_publish_is_heard(client: Client) -> None:
    head, make = rosmsg.make_header(0.0, "map"), rosmsg.make_message
    client.publish(CLICKED_POINT, head, rosmsg.make_point(1.25, -2.5))
    wait_for(lambda: client.events("point: East 1.250 m, North -2.500 m (ROS 2)"), "the point")
    truth = client.session.simulator.truth()
    pose = rosmsg.make_pose(truth.x_map_m, truth.y_map_m, 0.3)
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = 0.25, 0.25, 0.0625
    client.publish(
        INITIAL_POSE, head, make("geometry_msgs/msg/PoseWithCovariance", pose, covariance)
    )
    wait_for(lambda: client.events("0.300, 0.500, 0.250 (ROS 2)"), "the pose")
    client.publish(GOAL_POSE, head, rosmsg.make_pose(truth.x_map_m, 500.0, 0.0))
    wait_for(lambda: client.events("goto"), "the goal")
    client.publish(VISIT, head, [rosmsg.make_pose(500.0, 1.0, 0.0)])
    wait_for(lambda: client.events("visit"), "the places")
    client.publish(COMMAND, "mark")
    wait_for(lambda: client.events("marked (ROS 2)"), "the command")


def test_parameters_tell_the_settings_and_change_what_may_be_changed(client: Client) -> None:
    kind = "rcl_interfaces/srv/ListParameters"
    names = client.call("/agribot/list_parameters", kind, ["mission"], 0).result.names
    assert "mission.speed_mps" in names
    assert client.parameter("use_sim_time").bool_value
    assert client.parameter("mission.speed_mps").double_value == 0.4
    assert list(client.parameter("field.first_row_start_map_m").double_array_value) == [1.0, 2.0]
    assert client.parameter("no.such").type == 0
    assert client.set("mission.speed_mps", 0.3).successful
    assert client.parameter("mission.speed_mps").double_value == 0.3
    assert "while the robot runs" in client.set("safety.max_speed_mps", 2.0).reason
    assert "no parameter" in client.set("no.such", 2.0).reason
    described = client.call(
        "/agribot/describe_parameters", "rcl_interfaces/srv/DescribeParameters",
        ["mission.speed_mps", "seed"],
    ).descriptors  # fmt: skip
    assert [(d.type, d.read_only) for d in described] == [(3, False), (2, True)]
    kinds = client.call(
        "/agribot/get_parameter_types", "rcl_interfaces/srv/GetParameterTypes", ["world", "nope"]
    )
    assert list(kinds.types) == [4, 0]


def test_without_leave_no_goal_and_no_parameter_moves_the_robot(tmp_path: Path) -> None:
    with robot(tmp_path) as client:
        x_m, y_m = client.map_from
        assert not client.send(1, (x_m - 1.0, y_m + 1.0))
        assert "--allow-drive" in client.set("mission.speed_mps", 0.3).reason
