"""World and nodes as separate programs: a robot reaches a place on Earth over topics alone."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from agribot.core.geo import Datum, MapFrame
from tests import machine, nightly
from tests.ros.live import free_port
from tests.ros.ros1_system import Ros1
from tests.waiting import PATIENCE_S, wait_for

NODES = ("gps-converter", "data-manipulation", "autonomous-drive")
DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)
GOAL_MAP_M = (4.0, -2.0)


@contextmanager
def program(out: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    name = "-".join(words[:2])
    with (out / f"{name}.out").open("wb") as stdout, (out / f"{name}.err").open("wb") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "agribot.cli", *words], stdout=stdout, stderr=stderr
        )
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()


def reach_the_goal(out: Path, network: Sequence[str]) -> dict[str, Any]:
    """The world's own report of a drive to the goal."""
    lat, lon, _ = MapFrame(DATUM).geodetic_from_map(*GOAL_MAP_M)
    world = ("--world", "empty", "--sensors", "legacy", "--set", 'sim.base_station="common"')
    with program(out, "sim", "farm", *world, *network, "--out", str(out / "run"), "--json"):
        running = [program(out, "node", name, *network, "--json") for name in NODES]
        with running[0], running[1], running[2] as drive:
            goal = f"--goal={lat!r},{lon!r}"
            words = ("node", "autonomous-drive-action", goal, *network, "--json")
            action_out = out / "action"
            action_out.mkdir()
            with program(action_out, *words) as action:
                wait_for(lambda: action.poll() is not None, "the action to end")
                errors = "".join(p.read_text() for p in sorted(out.rglob("*.err")))
                assert action.returncode == 0, errors
            assert drive.poll() is None
    (line,) = (out / "sim-farm.out").read_text().splitlines()[-1:]
    report: dict[str, Any] = json.loads(line)
    return report


def assert_arrived(report: dict[str, Any]) -> None:
    truth = report["truth"]
    off_m = math.dist((truth["x_map_m"], truth["y_map_m"]), GOAL_MAP_M)
    assert off_m < 1.2, report  # 0.7 m of arriving, the antenna's place, the compass
    assert report["distance_m"] > 3.0


def test_over_ros_2_the_nodes_bring_the_robot_to_its_goal(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    router = f"tcp/127.0.0.1:{free_port()}"
    assert_arrived(reach_the_goal(tmp_path, ("--ros2", "--ros-router", router)))


@nightly.by_day(
    "test_over_ros_2_the_nodes_bring_the_robot_to_its_goal",
    "tests/ros/test_ros1_live.py::test_rostopic_pub_drives_the_robot",
    "tests/ros/test_ros1_live.py::test_rosbag_records_every_topic_with_the_values_sent",
    "tests/ros/test_ros1_live.py::test_a_sensor_may_be_a_topic_of_ros1",
)
@machine.needs("roscore")
def test_over_ros_1_the_nodes_bring_the_robot_to_its_goal(tmp_path: Path) -> None:
    (tmp_path / "ros1").mkdir()
    with closing(Ros1(tmp_path / "ros1")) as ros:  # its master answers: the world waits for none
        assert_arrived(reach_the_goal(tmp_path, ("--ros1", "--ros-master", ros.uri)))
