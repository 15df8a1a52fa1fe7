"""`agribot node`: one stage alone over topics, as the original's nodes ran."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.autonomy.control.go_to_goal import GoToGoal, GoToGoalSettings
from agribot.autonomy.estimate.sensors.compass_heading import CompassHeading
from agribot.autonomy.estimate.sensors.pole_origin import PoleOrigin
from agribot.autonomy.plan.ways.waypoints import parse_waypoints
from agribot.cli.ranges import check_above, check_within, port
from agribot.cli.run.bridging import (
    add_ros1_arguments,
    add_ros2_arguments,
    read_domain,
    read_master,
    read_namespace,
    read_router,
)
from agribot.cli.run.node_runner import NodeRunner
from agribot.cli.stopping import stop_on_signal
from agribot.core import extras
from agribot.core.errors import BridgeError, ConfigError
from agribot.core.geo import Datum
from agribot.core.table_text import read_text_file
from agribot.ros.connection import TopicConnection
from agribot.ros.nodes.plot import Plot
from agribot.ros.nodes.stage import NodeStage

if TYPE_CHECKING:
    from agribot.ros.nodes.gps_umd import UtmSettings

_PATIENCE_S = 60.0  # time for a master or router that is still starting


class NodeReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result as printed by --json; `messages` counts what was received and sent."""

    ok: bool
    reason: str
    node: str
    wall_s: float
    messages: dict[str, int]
    dropped: int
    files: tuple[str, ...] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("node", choices=sorted(_STAGES), help="which one")
    network = parser.add_mutually_exclusive_group(required=True)
    network.add_argument("--ros2", action="store_true", help="topics of ROS 2 (rmw_zenoh)")
    network.add_argument("--ros1", action="store_true", help="topics of a ROS 1 master")
    add_ros1_arguments(parser)
    add_ros2_arguments(parser)
    parser.add_argument("--name", help="of the node, where two of a kind run")
    parser.add_argument(
        "--for", dest="duration_s", type=float, metavar="SECONDS", help="stop after"
    )
    parser.add_argument("--json", action="store_true", help="print the result as the last line")
    gps = parser.add_argument_group("gps-converter")
    gps.add_argument(
        "--origin",
        default="pole",
        metavar="pole|fix|LAT,LON",
        help="the mean of the pole's first fixes, the robot's first fix, or where the pole "
        "really stands (default: pole)",
    )
    heading = parser.add_argument_group("data-manipulation")
    heading.add_argument(
        "--declination", type=float, default=0.0, metavar="DEG", help="magnetic, East positive"
    )
    heading.add_argument(
        "--compass-std", type=float, default=16.0, metavar="DEG", help="of a sample (default: 16)"
    )
    drive = parser.add_argument_group("autonomous-drive, autonomous-drive-action")
    drive.add_argument("--arrive", type=float, default=0.5, metavar="M", help="default: 0.5")
    drive.add_argument("--drive-speed", type=float, default=0.4, metavar="M/S", help="default: 0.4")
    drive.add_argument("--goal", action="append", metavar="LAT,LON", help="may be repeated")
    drive.add_argument("--goals", type=Path, metavar="FILE", help="GeoJSON or CSV, lat and lon")
    _add_utm_arguments(
        parser.add_argument_group("utm-odometry, utm-odometry-to-navsatfix, gpsd-client")
    )
    _add_gpsd_arguments(parser.add_argument_group("gpsd-client, also --fix-topic and --frame-id"))
    plot = parser.add_argument_group("plot")
    plot.add_argument("--out", type=Path, default=Path("plot"), metavar="DIR", help="default: plot")


def _add_gpsd_arguments(client: argparse._ArgumentGroup) -> None:
    client.add_argument("--host", default="localhost", help="of gpsd (default: localhost)")
    client.add_argument("--port", type=port, default=2947, help="of gpsd (default: 2947)")
    client.add_argument(
        "--use-gps-time", action=argparse.BooleanOptionalAction, default=True,
        help="stamps of the receiver's clock, else of this machine's",
    )  # fmt: skip
    client.add_argument(
        "--check-fix-by-variance", action=argparse.BooleanOptionalAction, default=True,
        help="no NavSatFix whose accuracy gpsd does not state",
    )  # fmt: skip


def _add_utm_arguments(grid: argparse._ArgumentGroup) -> None:
    grid.add_argument("--fix-topic", default="/fix", metavar="TOPIC", help="default: /fix")
    grid.add_argument("--odometry-topic", default="/odom", metavar="TOPIC", help="default: /odom")
    grid.add_argument(
        "--frame-id",
        default="",
        help="of what is published (default: as heard; of gpsd-client: gps)",
    )
    grid.add_argument("--child-frame-id", default="", help="of the odometry")
    grid.add_argument(
        "--rot-covariance", type=float, default=99999.0, metavar="RAD2", help="default: 99999"
    )
    grid.add_argument("--append-zone", action="store_true", help="to the frame: map/utm_43N")
    grid.add_argument("--zone", metavar="43N", help="UTM zone and hemisphere")


def run(options: argparse.Namespace) -> int:
    duration_s = math.inf if options.duration_s is None else options.duration_s
    check_above("--for", duration_s, 0.0)
    stage = _STAGES[options.node](options)
    started_s = time.monotonic()
    with stop_on_signal() as stop:

        def is_over() -> bool:
            return bool(stop) or time.monotonic() - started_s >= duration_s

        link = _open_link(options, is_over)
        try:
            runner = NodeRunner(stage, link, _print_line)
            runner.run(is_over)
        finally:
            link.close()
    files = _write_files(stage, options.out)
    report = NodeReport(
        ok=stage.ok,
        reason=stage.reason,
        node=options.node,
        wall_s=time.monotonic() - started_s,
        messages=runner.counts,
        dropped=runner.dropped,
        files=files,
    )
    if options.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    if stop and not isinstance(stage, Plot):
        return 130
    return 0 if report.ok else 1


def _open_link(options: argparse.Namespace, is_over: Callable[[], bool]) -> TopicConnection:
    """Wait for a network that is not there yet: nodes start in any order."""
    name = options.name or options.node.replace("-", "_")
    give_up_s = time.monotonic() + _PATIENCE_S
    has_said = False
    while True:
        try:
            return _open_ros1(options, name) if options.ros1 else _open_ros2(options, name)
        except BridgeError as error:
            if is_over() or time.monotonic() >= give_up_s or "pip install" in str(error):
                raise
            if not has_said:
                _print_line(f"waiting: {error}")
            has_said = True
            time.sleep(0.5)


def _open_ros1(options: argparse.Namespace, name: str) -> TopicConnection:
    from agribot.ros.ros1.connection import Ros1Connection

    return Ros1Connection(name, _print_line, read_master(options), read_namespace(options))


def _open_ros2(options: argparse.Namespace, name: str) -> TopicConnection:
    from agribot.ros.ros2.connection import Ros2Connection

    return Ros2Connection(name, domain=read_domain(options), router=read_router(options))


def _make_gps_converter(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.gps_converter import GpsConverter

    if options.origin in {"pole", "fix"}:
        return GpsConverter(PoleOrigin(), waits_for_pole=options.origin == "pole")
    lat_deg, lon_deg = _parse_place(options.origin, "--origin")
    known = Datum(lat_deg=lat_deg, lon_deg=lon_deg)
    return GpsConverter(PoleOrigin(known), waits_for_pole=False)


def _make_data_manipulation(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.data_manipulation import DataManipulation

    check_above("--compass-std", options.compass_std, 0.0, 90.0)
    check_within("--declination", options.declination, -180.0, 180.0)
    return DataManipulation(
        CompassHeading(math.radians(options.declination), math.radians(options.compass_std))
    )


def _make_autonomous_drive(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.autonomous_drive import AutonomousDrive

    check_above("--drive-speed", options.drive_speed, 0.0, 2.0)
    settings = GoToGoalSettings(
        speed_mps=options.drive_speed,
        slow_speed_mps=options.drive_speed / 2.0,
        arrive_m=_read_arrive_m(options),
    )
    return AutonomousDrive(GoToGoal(settings))


def _make_action(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.autonomous_drive_action import ActionSettings, AutonomousDriveAction

    goals = [_parse_place(text, "--goal") for text in options.goal or ()]
    if options.goals is not None:
        try:
            text = read_text_file(options.goals)
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"cannot read goals from {options.goals}: {error}; check the path"
            ) from error
        goals.extend(parse_waypoints(text, options.goals.name))
    if not goals:
        raise ConfigError("no goal to go to; give --goal LAT,LON or --goals FILE")
    arrive_m = _read_arrive_m(options) + GoToGoalSettings().depart_m
    return AutonomousDriveAction(goals, ActionSettings(arrive_m=arrive_m))


def _read_arrive_m(options: argparse.Namespace) -> float:
    check_within("--arrive", options.arrive, 0.05, 100.0, "m")
    return float(options.arrive)


def _make_fix_translator(_options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.gps_umd import FixTranslator

    return FixTranslator()


def _make_utm_odometry(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.gps_umd import UtmOdometry

    return UtmOdometry(_read_utm_settings(options), options.fix_topic, options.odometry_topic)


def _make_utm_to_fix(options: argparse.Namespace) -> NodeStage:
    from agribot.ros.nodes.gps_umd import UtmToNavSatFix

    return UtmToNavSatFix(_read_utm_settings(options), options.odometry_topic, options.fix_topic)


def _make_gpsd_client(options: argparse.Namespace) -> NodeStage:
    from agribot.drivers.gnss.gpsd_reader import GpsdReader
    from agribot.ros.nodes.gpsd_client import ClientSettings, GpsdClient

    settings = ClientSettings(
        options.frame_id or ClientSettings().frame_id, options.use_gps_time,
        options.check_fix_by_variance,
    )  # fmt: skip
    reports = GpsdReader(options.host, options.port, _print_line)
    return GpsdClient(reports, settings, options.fix_topic)


def _read_utm_settings(options: argparse.Namespace) -> UtmSettings:
    from agribot.ros.messages.utm import parse_zone
    from agribot.ros.nodes.gps_umd import UtmSettings

    if not 0.0 <= options.rot_covariance < math.inf:
        raise ConfigError(
            f"--rot-covariance {options.rot_covariance:g}: out of range; give 0 or more rad^2"
        )
    zone = parse_zone(options.zone) if options.zone else None
    return UtmSettings(
        options.frame_id, options.child_frame_id, options.rot_covariance, options.append_zone, zone
    )


def _make_plot(_options: argparse.Namespace) -> NodeStage:
    extras.require("report", "agribot node plot")
    return Plot()


_STAGES: dict[str, Callable[[argparse.Namespace], NodeStage]] = {
    "gps-converter": _make_gps_converter,
    "data-manipulation": _make_data_manipulation,
    "fix-translator": _make_fix_translator,
    "gpsd-client": _make_gpsd_client,
    "utm-odometry": _make_utm_odometry,
    "utm-odometry-to-navsatfix": _make_utm_to_fix,
    "autonomous-drive": _make_autonomous_drive,
    "autonomous-drive-action": _make_action,
    "plot": _make_plot,
}


def _parse_place(text: str, option: str) -> tuple[float, float]:
    try:
        lat_deg, lon_deg = (float(word) for word in text.split(","))
    except ValueError:
        lat_deg = lon_deg = math.nan
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise ConfigError(
            f"{option} {text}: not a place; give LAT,LON in degrees, as in 21.1613,72.7870"
        )
    return lat_deg, lon_deg


def _write_files(stage: NodeStage, out_dir: Path) -> tuple[str, ...]:
    if not isinstance(stage, Plot):
        return ()
    from agribot.record.drive_figure import write_drive_files

    return tuple(map(str, write_drive_files(out_dir, stage.series)))


def _print_line(text: str) -> None:
    sys.stderr.write(f"node: {text}\n")
