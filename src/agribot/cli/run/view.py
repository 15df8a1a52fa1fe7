"""`agribot view`: open a recording in other viewers, one command each."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from agribot.cli.output_names import check_ending
from agribot.cli.run import bridging
from agribot.cli.run.pacing import parse_pace, wait_until
from agribot.cli.stopping import stop_on_signal
from agribot.core import topics
from agribot.core.errors import ConfigError
from agribot.core.messages import Inbox
from agribot.ros.requests import Requests

if TYPE_CHECKING:
    from agribot.ros.tick_publisher import Gateway

_CLOCK_PERIOD_NS = 20_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("viewer", choices=sorted(_VIEWERS), help="which one")
    parser.add_argument(
        "recording", type=Path, nargs="?", metavar="RUN", help="folder of a run, or its run.mcap"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="FILE|DIR",
        help="rerun: write this .rrd instead of opening the viewer; qgis: folder of the project "
        "(default: beside the recording); foxglove: write the layout here",
    )  # fmt: skip
    parser.add_argument(
        "--no-open", action="store_true", help="qgis, rviz: do not start the program"
    )
    parser.add_argument(
        "--speed", default="1", metavar="max|K", help="rviz: K x real time (default: 1)"
    )
    bridging.add_arguments(parser, has_stack=False)


def run(options: argparse.Namespace) -> int:
    _VIEWERS[options.viewer](options)
    return 0


def find_view(name: str) -> Path:
    """Find a packaged view, in installations in folders, which all of pip's are."""
    return Path(str(resources.files("agribot.cli") / "views" / name))


def _view_rerun(options: argparse.Namespace) -> None:
    from agribot.record.rerun_log import write_rerun

    if options.out is not None:
        check_ending("-o", options.out, "a recording of Rerun", ".rrd")
    count = write_rerun(_find_recording(options), options.out)
    sys.stderr.write(f"{count} messages to {options.out or 'the viewer'}\n")


def _view_qgis(options: argparse.Namespace) -> None:
    from agribot.record.qgis_project import write_qgis

    recording = _find_recording(options)
    project = write_qgis(recording, options.out or recording.parent / "qgis")
    sys.stderr.write(f"{project}\n")
    program = shutil.which("qgis")
    if options.no_open:
        return
    if program is None:
        sys.stderr.write("there is no qgis in the PATH: open this project where there is one\n")
        return
    subprocess.Popen([program, str(project)], start_new_session=True)


def _view_foxglove(options: argparse.Namespace) -> None:
    """Write the layout and print the rest: Foxglove opens recordings itself."""
    layout = find_view("foxglove.json")
    if options.out is not None:
        check_ending("-o", options.out, "a layout of Foxglove", ".json")
        shutil.copyfile(layout, options.out)
        layout = options.out
    recording = _find_recording(options) if options.recording else "RUN/run.mcap"
    sys.stderr.write(
        f"in Foxglove: open {recording}, then "
        f"Layout, Import from file, {layout}; a robot that runs: agribot foxglove\n"
    )


def _view_rviz(options: argparse.Namespace) -> None:
    """Play a recording, as if the robot were there; without one, show a robot that is."""
    if not (options.ros1 or options.ros2 or options.dds):
        has_ros1_alone = shutil.which("rviz2") is None and shutil.which("rviz") is not None
        options.ros1 = options.recording is not None and has_ros1_alone
        options.ros2 = not options.ros1
    with _run_rviz(options):
        if options.recording is None:
            with stop_on_signal() as stop:
                while not stop:
                    time.sleep(0.1)
        else:
            _play(_find_recording(options), options)


@contextmanager
def _run_rviz(options: argparse.Namespace) -> Iterator[None]:
    """Run RViz of the ROS that the options name, until it is closed."""
    name, view = ("rviz", "ros1.rviz") if options.ros1 else ("rviz2", "ros2.rviz")
    environment = {**os.environ, "ROS_MASTER_URI": bridging.read_master(options)}
    program = shutil.which(name)
    if options.no_open or program is None:
        if program is None:
            sys.stderr.write(f"there is no {name} in the PATH: {name} -d {find_view(view)}\n")
        yield
        return
    words = [program, "-d", str(find_view(view))]
    if not options.ros1:
        words += ["--ros-args", "-p", "use_sim_time:=true"]
    with subprocess.Popen(words, env=environment) as process:
        try:
            yield
        finally:
            process.terminate()


def _play(recording: Path, options: argparse.Namespace) -> None:
    """Play every topic of the table that is in the recording, at its time, with the clock."""
    from agribot.record.bag.opening import open_bag
    from agribot.ros.tick_publisher import GatewayGroup

    pace = parse_pace(options.speed)
    with open_bag(recording) as bag:
        held = {t.name for t in bag.topics if bag.knows(t) and t.encoding == "cdr"}
        out = [t for t in topics.TOPICS if (t.ros_type and t.name in held) or t is topics.CLOCK]
        by_name = {topic.name: topic for topic in out}
        if len(out) == 1:
            raise ConfigError(
                f"{recording} has no topic of AGRIBOT, only {bag.contents}; play it with rosbag"
            )
        urdf = next((f.data.decode() for f in bag.files() if f.name == "robot.urdf"), "")
        requests = Requests(Inbox(), report=bridging.print_line)
        opened: list[Gateway] = bridging.open_gateways(options, out, urdf, requests, None)
        gateways = GatewayGroup(opened)
        start_ns = bag.times_ns[0] if bag.times_ns else 0
        started_s, next_clock_ns = time.monotonic(), 0
        try:
            with stop_on_signal() as stop:
                for message in bag.messages(frozenset(by_name)):
                    if stop:
                        break
                    wait_until(started_s + (message.log_ns - start_ns) * 1e-9 / pace)
                    topic = by_name[message.topic.name]
                    gateways.send(topic, message.log_ns, message.data, message.publish_ns)
                    if message.log_ns >= next_clock_ns:
                        next_clock_ns = message.log_ns + _CLOCK_PERIOD_NS
                        gateways.publish_time(message.log_ns * 1e-9)
        finally:
            gateways.close()


def _find_recording(options: argparse.Namespace) -> Path:
    if options.recording is None:
        raise ConfigError(f"agribot view {options.viewer}: no recording; give the folder of a run")
    path: Path = options.recording
    inside = path / "run.mcap"
    return inside if inside.exists() else path


_VIEWERS: dict[str, Callable[[argparse.Namespace], None]] = {
    "rerun": _view_rerun,
    "qgis": _view_qgis,
    "rviz": _view_rviz,
    "foxglove": _view_foxglove,
}
