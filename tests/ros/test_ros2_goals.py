"""Another process sends the robot to places: nav2_msgs/NavigateThroughPoses, and parameters."""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli import bridging
from agribot.core import config
from agribot.ros.messages import rosmsg
from agribot.ros.ros2 import wire
from agribot.ros.ros2.goals import THROUGH_POSES
from agribot.ros.ros2.services import NAVIGATE, NAVIGATE_RESULTS, load_service_types
from tests.ros.live import Talk, free_port, zenoh_peer
from tests.waiting import PATIENCE_S, wait_for

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
        """Of the newest goal, in the order told."""
        return [message.status_list[-1].status for message in self.heard(STATUS)]

    def parameter(self, name: str) -> Any:
        answer = self.call("/agribot/get_parameters", "rcl_interfaces/srv/GetParameters", [name])
        return answer.values[0]

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
    """A simulated robot that waits for goals, driven faster than the clock in a thread."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    parser = argparse.ArgumentParser()
    bridging.add_arguments(parser)
    options = parser.parse_args(["--ros2", "--ros-router", locator, *arguments])
    settings = config.load(
        "farm", ["perception.enabled=false", "record.enabled=false", "mission.waits_for_goals=true"]
    )
    over = threading.Event()

    def drive() -> None:
        for _ in session.ticks():
            if over.is_set():
                return
            time.sleep(0.002)

    with simulate(settings, out_dir) as session:
        driver = threading.Thread(target=drive, daemon=True)
        with bridging.open_bridges(options, session), zenoh_peer(locator) as talk:
            driver.start()
            try:
                yield Client(talk, session)
            finally:
                over.set()
                driver.join(PATIENCE_S)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    with robot(tmp_path_factory.mktemp("goals"), "--allow-drive") as client:
        yield client


def test_a_goal_is_driven_told_of_and_succeeds(client: Client) -> None:
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
    assert client.cancel(77).return_code == 2  # nobody knows it
    wait_for(lambda: abs(client.session.simulator.truth().v_mps) < 0.01, "the robot to stand")


def test_a_new_goal_takes_the_place_of_the_one_before(client: Client) -> None:
    x_m, y_m = client.map_from
    assert client.send(3, (x_m - 4.0, y_m - 6.0))
    wait_for(lambda: client.states()[-1:] == [2], "the first goal to be driven")
    assert client.send(4, (x_m - 1.0, y_m - 1.0))
    replaced = client.result(3)
    assert replaced.status == ABORTED
    assert "took its place" in replaced.result.error_msg
    assert client.result(99).status == 0  # nobody knows it


def test_a_goal_across_the_crop_is_refused_by_the_planner_with_its_words(client: Client) -> None:
    assert client.send(5, (2.5, 6.0), (4.5, 6.0))
    result = client.result(5)
    assert result.status == ABORTED
    assert "row" in result.result.error_msg


def test_what_is_no_goal_is_not_accepted(client: Client) -> None:
    assert not client.send(6)
    assert not client.send(6, (1.0, 1.0), frame="base_link")
    assert not client.send(6, (float("nan"), 1.0))


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
