"""Bridges of a run: opened as the command line says, before the robot moves."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.ranges import check_within, finite, port
from agribot.cli.run.noise_bridging import open_noise_servers
from agribot.core import extras, topics
from agribot.core.config import RunConfig
from agribot.core.errors import ConfigError
from agribot.core.topics import Topic
from agribot.drivers.line.schemes import SourceUri, read_sources, require_extras
from agribot.ros.requests import PlanWay, Requests
from agribot.ros.robot_link import RobotLink
from agribot.ros.ros1.master import MASTER, check_master

if TYPE_CHECKING:
    from agribot.app.run import Run
    from agribot.autonomy.plan.ways.curves import Place
    from agribot.core.messages import Estimate, Path
    from agribot.ros.sensor_noise import TunedSimulator
    from agribot.ros.tick_publisher import Gateway, TickPublisher

Setting = bool | int | float | str | tuple[float, ...]

DEFAULT_IMAGE_RATE_HZ = 5.0
BRIDGES = ("ros2", "dds", "ros1", "foxglove")
_CAMERA_TOPICS = (topics.IMAGE, topics.IMAGE_RAW, topics.CAMERA_INFO, topics.OVERLAY)


def add_arguments(parser: argparse.ArgumentParser, *, has_stack: bool = True) -> None:
    """Add the options; without a stack (`has_stack`) peers need no permission to drive."""
    group = parser.add_argument_group("bridges (off unless asked for, on this machine only)")
    group.add_argument("--ros2", action="store_true", help="be a ROS 2 node (rmw_zenoh)")
    group.add_argument(
        "--dds", action="store_true", help="be a ROS 2 node on DDS (Fast DDS, Cyclone DDS)"
    )
    group.add_argument("--ros1", action="store_true", help="be a ROS 1 node (needs a roscore)")
    add_ros1_arguments(group)
    group.add_argument("--foxglove", action="store_true", help="serve Foxglove; it only watches")
    group.add_argument("--foxglove-port", type=port, default=8765, metavar="P")
    if has_stack:
        group.add_argument(
            "--allow-drive",
            action="store_true",
            help="take cmd_vel, goals, poses, resume and clear_stop from peers",
        )
    group.add_argument(
        "--image-rate",
        type=finite,
        default=DEFAULT_IMAGE_RATE_HZ,
        metavar="HZ",
        help=f"of camera images to peers (default: {DEFAULT_IMAGE_RATE_HZ:g}; 0 sends none)",
    )
    group.add_argument("--raw-images", action="store_true", help="uncompressed images as well")
    add_ros2_arguments(group)


def add_ros1_arguments(group: argparse._ActionsContainer) -> None:
    group.add_argument(
        "--ros-master", metavar="URI", help="default: ROS_MASTER_URI or http://127.0.0.1:11311"
    )
    group.add_argument(
        "--ros-namespace",
        default="",
        metavar="NAME",
        help="put all ROS 1 names under /NAME, for several robots at one master",
    )


def add_ros2_arguments(group: argparse._ActionsContainer) -> None:
    group.add_argument("--ros-domain", type=int, metavar="N", help="default: ROS_DOMAIN_ID or 0")
    group.add_argument(
        "--ros-router", metavar="LOCATOR", help="zenoh router (default: tcp/127.0.0.1:7447)"
    )


def is_wanted(options: argparse.Namespace) -> bool:
    return any(getattr(options, name) for name in BRIDGES)


def check_bridges(
    options: argparse.Namespace, sources: Mapping[str, SourceUri] | None = None
) -> None:
    """Refuse before a long start what could not be opened after it.

    `sources` are the topics that sensors come from, by sensor.
    Raises: ConfigError: a package is not installed, or an option is out of range.
    """
    _check_extras(options, sources or {})
    away = {(place.scheme, place.at) for place in (sources or {}).values()}
    networks = {network for network, _ in away}
    if options.ros2 or options.dds or "ros2" in networks:
        read_domain(options)
    if options.ros1 or ("ros1", "") in away:
        read_master(options)
    read_namespace(options)
    for network, at in away:
        if network == "ros1" and at:
            check_master(f"http://{at}")
    if is_wanted(options):
        _check_image_rate(options)


def _check_extras(options: argparse.Namespace, sources: Mapping[str, SourceUri]) -> None:
    for option, extra in (("ros2", "ros"), ("foxglove", "foxglove")):
        if getattr(options, option):
            extras.require(extra, f"--{option}")
    if options.dds:
        extras.require("dds", "--dds (no wheels for Linux on ARM and Python 3.14: take --ros2)")
    require_extras(sources)


@contextmanager
def open_bridges(options: argparse.Namespace, session: Run) -> Iterator[None]:
    """Open what the options name and connect it to the session.

    Raises: AgribotError: an option is out of range, or a peer that must be there is not.
    """
    from agribot.description.loader import export_urdf
    from agribot.ros.frames import PeerFrames

    if not is_wanted(options):
        yield
        return
    link = RobotLink(session.inbox)
    requests = Requests(
        session.inbox,
        allow_drive=options.allow_drive,
        report=print_line,
        link=link,
        frames=PeerFrames(session.config.field.datum),
        plan_way=_make_way_planner(session),
    )
    session.add_tap(link)
    sources = read_sources(session.config.sources)
    taken = {place.path for place in sources.values()}
    if "wheels" in sources and sources["wheels"].scheme in {"ros1", "ros2"}:
        taken.add(topics.ODOM.name)  # the odometry of the body is elsewhere
    has_camera = session.robot.camera is not None
    out = [
        topic  # topics that others publish for this robot are not published again
        for topic in list_out_topics(
            options, has_camera=has_camera, allow_drive=options.allow_drive
        )
        if not taken & {*topic.names, topic.seed_alias}
    ]
    gateways = open_gateways(
        options, out, export_urdf(session.config.robot), requests, flatten_settings(session.config)
    )
    try:
        gateways += _open_noise_servers(options, session)
        outlet = _make_outlet(options, session, gateways)
    except BaseException:
        for gateway in gateways:
            gateway.close()
        raise
    session.add_tap(outlet)
    try:
        yield
    finally:
        outlet.close()
        report_losses(outlet.dropped, outlet.fault)


def _make_way_planner(session: Run) -> PlanWay:
    """Plan with the task that the mission has when it is asked."""

    def plan_way(here: Estimate, goal: Place) -> Path:
        return session.stack.mission.task.plan_to(here, goal)

    return plan_way


def _open_noise_servers(options: argparse.Namespace, session: Run) -> list[Gateway]:
    from agribot.app.simulated_run import SimulatedRun

    if not isinstance(session, SimulatedRun):
        return []
    return open_noise(options, session.simulator, is_open=options.allow_drive)


def open_noise(
    options: argparse.Namespace, simulator: TunedSimulator, *, is_open: bool
) -> list[Gateway]:
    """Open the noise of simulated sensors to the networks of the options that have parameters.

    Raises: BridgeError: a peer that must be there is not.
    """
    return open_noise_servers(
        simulator,
        print_line,
        is_open=is_open,
        ros1=(read_master(options), read_namespace(options)) if options.ros1 else None,
        ros2=(read_domain(options), read_router(options)) if options.ros2 else None,
        dds=read_domain(options) if options.dds else None,
    )


def open_gateways(
    options: argparse.Namespace,
    out: Sequence[Topic],
    urdf: str,
    requests: Requests,
    settings: Mapping[str, Setting] | None,
) -> list[Gateway]:
    """Open all that the options name, or none; without `settings` there are no services."""
    gateways: list[Gateway] = []
    try:
        for name in BRIDGES:
            if getattr(options, name):
                gateways.append(_OPENERS[name](options, out, urdf, requests, settings))
    except BaseException:
        for gateway in gateways:
            gateway.close()
        raise
    return gateways


def flatten_settings(config: RunConfig) -> dict[str, Setting]:
    """List every setting by its full name, but for lists of what are not numbers."""
    found: dict[str, Setting] = {}

    def walk(value: object, name: str) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                walk(inner, f"{name}.{key}" if name else key)
        elif isinstance(value, bool | int | float | str):
            found[name] = value
        elif isinstance(value, list | tuple) and all(isinstance(n, float) for n in value):
            found[name] = tuple(value)

    walk(msgspec.to_builtins(config), "")
    return found


def report_losses(dropped: int, fault: str) -> None:
    if dropped:
        print_line(f"{dropped} ticks did not go out: the bridges could not keep up")
    if fault:
        print_line(fault)


def _make_outlet(
    options: argparse.Namespace, session: Run, gateways: list[Gateway]
) -> TickPublisher:
    from agribot.description.loader import export_urdf
    from agribot.ros.messages.camera_log import CameraLog
    from agribot.ros.tick_publisher import RunSources, TickPublisher

    config = session.config
    camera = CameraLog(
        session.robot,
        options.image_rate,
        config.record.jpeg_quality,
        keeps_raw=options.raw_images,
    )
    sources = RunSources(
        plan=lambda: session.stack.mission.path,
        goals_map_m=lambda: session.shown_goals_map_m,
        weed_map=session.weed_map.plants,
        truth=session.truth,
        imu_bias=session.imu_bias,
    )
    return TickPublisher(
        gateways, session.robot, config.field.datum, export_urdf(config.robot), camera, sources,
        config.estimate,
    )  # fmt: skip


def list_out_topics(
    options: argparse.Namespace, *, has_camera: bool, allow_drive: bool
) -> list[Topic]:
    """List the topics that this run publishes; where peers may drive, cmd_vel is theirs.

    Raises: ConfigError: an option is out of range.
    """
    _check_image_rate(options)
    left_out = set()
    if not (has_camera and options.image_rate):
        left_out |= {topic.name for topic in _CAMERA_TOPICS}
    if not options.raw_images:
        left_out.add(topics.IMAGE_RAW.name)
    if allow_drive:
        left_out.add(topics.CMD_VEL.name)
    return [t for t in topics.TOPICS if t.ros_type and t.name not in left_out]


def _check_image_rate(options: argparse.Namespace) -> None:
    check_within("--image-rate", options.image_rate, 0.0, 100.0, "Hz")


def _open_ros2(
    options: argparse.Namespace,
    out: Sequence[Topic],
    _urdf: str,
    requests: Requests,
    settings: Mapping[str, Setting] | None,
) -> Gateway:
    from agribot.ros.ros2.gateway import Ros2Gateway

    router = read_router(options)
    domain = read_domain(options)
    gateway = Ros2Gateway(
        requests,
        out,
        domain=domain,
        router=router,
        serves=settings is not None,
        settings=settings,
    )
    print_line(
        f"ROS 2: node /agribot as zenoh {gateway.role} at {router}; "
        "peers set RMW_IMPLEMENTATION=rmw_zenoh_cpp"
    )
    return gateway


def _open_dds(
    options: argparse.Namespace,
    out: Sequence[Topic],
    _urdf: str,
    requests: Requests,
    settings: Mapping[str, Setting] | None,
) -> Gateway:
    from agribot.ros.dds.gateway import DdsGateway

    domain = read_domain(options)
    gateway = DdsGateway(
        requests, out, domain=domain, serves=settings is not None, settings=settings
    )
    print_line(
        f"DDS: node /agribot in domain {domain}, on this machine, where peers set "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST; services answer rmw_cyclonedds_cpp"
    )
    return gateway


def read_domain(options: argparse.Namespace) -> int:
    asked: int | None = options.ros_domain
    if asked is None:
        text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        try:
            asked = int(text)
        except ValueError:
            raise ConfigError(f"ROS_DOMAIN_ID is '{text}'; it must be a number") from None
    check_within("ROS domain", asked, 0, 232)
    return asked


def read_router(options: argparse.Namespace) -> str:
    from agribot.ros.ros2.node import ROUTER

    return options.ros_router or ROUTER


def read_master(options: argparse.Namespace) -> str:
    return check_master(str(options.ros_master or os.environ.get("ROS_MASTER_URI") or MASTER))


def read_namespace(options: argparse.Namespace) -> str:
    """Read the namespace of ROS 1, without slashes at its ends; none is empty.

    Raises: ConfigError: no name of ROS, or there is no ROS 1 to have it.
    """
    text = str(options.ros_namespace)
    space = text.strip("/")
    if not text:
        return ""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*", space):
        raise ConfigError(
            f"--ros-namespace {text}: not a name of ROS; use letters, digits and _, as in robot1"
        )
    if not options.ros1:
        raise ConfigError("--ros-namespace is for --ros1; give robots of ROS 2 a --ros-domain each")
    return space


def _open_ros1(
    options: argparse.Namespace,
    out: Sequence[Topic],
    urdf: str,
    requests: Requests,
    settings: Mapping[str, Setting] | None,
) -> Gateway:
    from agribot.ros.ros1.gateway import Ros1Gateway

    master = read_master(options)
    space = read_namespace(options)
    gateway = Ros1Gateway(requests, out, urdf, master, space, serves=settings is not None)
    print_line(f"ROS 1: node {f'/{space}' if space else ''}/agribot at the master {master}")
    return gateway


def _open_foxglove(
    options: argparse.Namespace, out: Sequence[Topic], _urdf: str, _requests: Requests, _: object
) -> Gateway:
    from agribot.ros.foxglove_server import FoxgloveGateway

    gateway = FoxgloveGateway(list(out), options.foxglove_port)
    print_line(
        f"Foxglove: open ws://127.0.0.1:{gateway.port}; it watches and cannot move the robot"
    )
    return gateway


_OPENERS = {"ros2": _open_ros2, "dds": _open_dds, "ros1": _open_ros1, "foxglove": _open_foxglove}


def print_line(text: str) -> None:
    sys.stderr.write(f"bridge: {text}\n")
