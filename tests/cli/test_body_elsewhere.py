"""The mind in one process and the body in another: all sensors and the drive over ROS 2."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
from pathlib import Path

from agribot.cli.main import main
from agribot.record.replay import read_ticks
from tests import nightly
from tests.ros.live import ROOT, free_port, zenoh_peer
from tests.waiting import wait_for

SENSORS = {
    "imu": "/agribot/imu",
    "gnss": "/agribot/fix",
    "wheels": "/agribot/joint_states",
    "mag": "/agribot/magnetic",
}


@nightly.by_day(
    "tests/ros/test_sensor_sources.py::"
    "test_the_robot_believes_to_be_where_another_process_says_and_its_silence_is_a_fault",
    "tests/ros/test_ros2_live.py::test_a_twist_from_another_process_reaches_the_inbox_exactly",
)
def test_a_mission_drives_the_robot_of_another_process(tmp_path: Path) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    body = [
        sys.executable, "-m", "agribot.cli", "sim", "farm", "--ros2", "--ros-router", router,
        "--json", "--out", str(tmp_path / "body"),
    ]  # fmt: skip
    with subprocess.Popen(
        body, stdout=subprocess.PIPE, text=True, cwd=ROOT, env={"PYTHONPATH": str(ROOT / "src")}
    ) as process:
        with zenoh_peer(router) as talk:
            wait_for(lambda: bool(talk("dump")["heard"]), "the world in the other process")
        sources = [f"--source={sensor}=ros2:{topic}" for sensor, topic in SENSORS.items()]
        main(
            ["run", "farm", "--ros2", "--ros-router", router, *sources, "--for", "12",
             "--set", "perception.enabled=false", "--set", "safety.sensor_timeout_s=3",
             "--out", str(tmp_path / "mind")]
        )  # fmt: skip
        process.send_signal(signal.SIGINT)
        assert process.stdout is not None
        told = process.stdout.read()
    report = json.loads(told.splitlines()[-1])
    ticks = read_ticks(tmp_path / "mind" / "run.mcap")
    *_, last = (tick for tick in ticks if tick.estimate.ok)  # the end waits for no sensor
    assert last.batch.t_s > 11.0
    believed = (last.estimate.x_map_m, last.estimate.y_map_m)
    assert report["distance_m"] > 0.3  # less on a machine whose processes stand still at times
    assert (
        math.dist(believed, (report["truth"]["x_map_m"], report["truth"]["y_map_m"])) < 0.5
    )  # it still rolled to a stand
