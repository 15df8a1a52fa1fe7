"""`agribot plan`: make a certified plan for all of a field and a robot."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import msgspec

from agribot.cli.output_names import check_ending
from agribot.core import extras
from agribot.core.errors import MissionError
from agribot.core.facts import (
    AbLineUnfit,
    EndingUnknown,
    FieldNeeded,
    FilesNeeded,
    NumbersExpected,
    OptionLatitude,
    OptionOutside,
    PlanNeeded,
)
from agribot.core.geo import MapFrame
from agribot.core.robot import RobotSpec

if TYPE_CHECKING:
    from agribot.autonomy.plan.coverage.area import FieldArea, PlanRequest
    from agribot.autonomy.plan.coverage.plan_certificate import Certificate
    from agribot.core.messages import MapPoint
    from agribot.gis.plan_file import SavedPlan

SHORTEST_AB_M = 1.0
FARTHEST_AB_M = 20_000.0  # largest distance: a local map is flat only near its origin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from agribot.autonomy.plan.coverage.area import TurnStyle
    from agribot.gis.formats.table import WRITERS

    parser.add_argument("action", nargs="?", choices=("verify", "convert", "teach"),
                        help="check a plan; write a field in another format; make a field of a "
                             "drive")  # fmt: skip
    parser.add_argument("file", nargs="?", metavar="FILE",
                        help="the plan to verify (GeoJSON), the field to convert, or the run or "
                             "recording of the drive")  # fmt: skip
    parser.add_argument("--field", metavar="FILE",
                        help="boundary, obstacles, rows: GeoJSON, GeoPackage, KML, KMZ, GPX, "
                             "zipped Shapefile or ISOXML; of several fields and A-B lines in it "
                             "those of FILE#NAME")  # fmt: skip
    parser.add_argument("--implement-width", type=float, metavar="M",
                        help="width worked in a pass (default: the robot's own)")  # fmt: skip
    parser.add_argument("--overlap", type=float, default=0.05, metavar="M", help="default: 0.05")
    parser.add_argument("--headland-passes", type=int, metavar="N", help="default: as few as do")
    parser.add_argument("--tool-offset", type=float, metavar="M",
                        help="where the tool works, ahead of the robot's middle; negative behind "
                             "(default: its boom)")  # fmt: skip
    parser.add_argument("--swath-angle", default="auto", metavar="DEG|auto",
                        help="compass direction of the swaths (default: auto)")  # fmt: skip
    parser.add_argument("--ab-line", metavar="LON,LAT,LON,LAT", help="swaths run along A to B")
    parser.add_argument("--start", metavar="LON,LAT", help="where the robot stands")
    parser.add_argument("--turns", choices=get_args(TurnStyle), default="auto",
                        help="between swaths: arcs where they fit and are quicker (auto), in "
                             "place, arcs or three-point turns where they fit")  # fmt: skip
    parser.add_argument("--margin", type=float, metavar="M",
                        help="from the footprint to every edge (default: as the file "
                             "says, else 0.05)")  # fmt: skip
    parser.add_argument("--keep-out", metavar="MAP.yaml",
                        help="a map of map_server: its occupied cells are cut out of the "
                             "field")  # fmt: skip
    parser.add_argument("--keep-out-unknown", action="store_true",
                        help="with --keep-out: its unknown cells as well")  # fmt: skip
    parser.add_argument("--min-coverage", type=float, default=0.99, metavar="RATIO",
                        help="of the reachable ground (default: 0.99)")  # fmt: skip
    parser.add_argument("--robot", default="agribot", metavar="NAME|FILE")
    endings = ", ".join(WRITERS)
    parser.add_argument(
        "--out", metavar="FILE",
        help=f"write the plan, or the field, to {endings}; agribot run --plan reads GeoJSON",
    )  # fmt: skip
    parser.add_argument("--png", metavar="FILE", help="draw the plan")
    parser.add_argument("--json", action="store_true", help="print the certificate")


def run(options: argparse.Namespace) -> int:
    _check_outputs(options)
    if options.action == "convert":
        return _convert(options)
    if options.action == "teach":
        return _teach(options)
    if options.action == "verify":
        saved, certificate = _verify_plan(options)
    else:
        saved, certificate = _make_plan(options)
    if options.png:
        _draw(saved, certificate, Path(options.png))
    for warning in saved.plan.warnings:
        sys.stderr.write(f"warning: {warning}\n")
    sys.stderr.write(_format_summary(certificate, MapFrame(saved.datum)))
    if options.out and options.action is None:
        if certificate.ok:
            _write_plan(Path(options.out), saved, certificate)
        else:
            sys.stderr.write(f"{options.out} is not written: the plan was refused\n")
    if options.json:
        sys.stdout.write(msgspec.json.encode(certificate).decode() + "\n")
    return 0 if certificate.ok else 1


def _check_outputs(options: argparse.Namespace) -> None:
    """Refuse what cannot be written, before anything is planned.

    Raises: MissingExtraError: no package draws. ConfigError, MissionError: a name of another
    format.
    """
    from agribot.gis.formats.table import WRITERS, find_ending

    if options.png:
        extras.require("report", "--png")
        check_ending("--png", Path(options.png), "a PNG picture", ".png")
    if options.out and find_ending(Path(options.out).name) not in ("", *WRITERS):
        raise MissionError(EndingUnknown(f"--out {options.out}", ", ".join(WRITERS)))


def _write_plan(path: Path, saved: SavedPlan, certificate: Certificate) -> None:
    from agribot.gis.plan_file import format_plan

    if not _write_map(path, format_plan(saved, certificate)):
        sys.stderr.write(
            f"note: {path} shows the plan in other programs; agribot run --plan needs it as "
            "GeoJSON: --out plan.geojson\n"
        )


def _write_map(path: Path, geojson: str) -> bool:
    """Write in the format that the name says; True where that is GeoJSON, which keeps it all."""
    from agribot.gis.formats.table import find_ending, write_field_file
    from agribot.record.report import write_file

    ending = find_ending(path.name)
    is_geojson = ending in ("", ".geojson", ".json")
    whole = geojson.encode()
    write_file(path, whole if is_geojson else write_field_file(ending, json.loads(whole)))
    return is_geojson


def _draw(saved: SavedPlan, certificate: Certificate, path: Path) -> None:
    from agribot.record.drawing import encode_png
    from agribot.record.plan_figure import draw_plan
    from agribot.record.report import write_file

    figure = draw_plan(saved.plan, saved.area, saved.request, certificate)
    write_file(path, encode_png(figure))


def _convert(options: argparse.Namespace) -> int:
    from agribot.gis.formats.table import find_ending, read_fields, write_field_file
    from agribot.record.report import write_file

    if options.file is None or options.out is None:
        raise MissionError(FilesNeeded("agribot plan convert field.kml --out field.gpkg"))
    out = Path(options.out)
    field = read_fields(Path(options.file))
    write_file(out, write_field_file(find_ending(out.name), field))
    features = len(field["features"])
    sys.stderr.write(f"{out}: {features} features\n")
    if "left_out" in field:
        sys.stderr.write(f"warning: {field['left_out']}\n")
    if options.json:
        sys.stdout.write(msgspec.json.encode({"path": str(out), "features": features}).decode())
        sys.stdout.write("\n")
    return 0


def _teach(options: argparse.Namespace) -> int:
    from agribot.app.taught_rows import find_drive, teach_rows
    from agribot.record.bag.opening import check_target

    if options.file is None or options.out is None:
        raise MissionError(FilesNeeded("agribot plan teach runs/by-hand --out field.geojson"))
    recording, out = Path(options.file), Path(options.out)
    check_target(find_drive(recording), out, "field")
    taught = teach_rows(recording)
    if not _write_map(out, taught.text):
        sys.stderr.write(
            f"note: {out} has the lines alone; only GeoJSON keeps the margin that plans need here\n"
        )
    sys.stderr.write(f"{out}: {taught.rows} rows\n")
    if taught.left_out:
        sys.stderr.write(
            f"warning: {taught.left_out} fixes are left out: nothing drives so fast as from the "
            "others to them; check the field before it is driven\n"
        )
    if options.json:
        result = {"path": options.out, "rows": taught.rows, "left_out": taught.left_out}
        sys.stdout.write(msgspec.json.encode(result).decode() + "\n")
    return 0


def _make_plan(options: argparse.Namespace) -> tuple[SavedPlan, Certificate]:
    from agribot.app.keep_out import read_keep_out
    from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
    from agribot.autonomy.plan.coverage.planner import plan_field
    from agribot.autonomy.plan.coverage.tool_gaps import warn_of_gaps
    from agribot.autonomy.plan.ways.footprint import measure_footprint
    from agribot.description.loader import load_robot
    from agribot.gis.field_file import read_field
    from agribot.gis.keep_out_ground import cut_keep_out
    from agribot.gis.plan_file import SavedPlan

    if options.field is None:
        raise MissionError(FieldNeeded())
    area, datum = read_field(Path(options.field), uses_ab_line=not options.ab_line)
    if options.keep_out:
        rings = read_keep_out(Path(options.keep_out), datum, with_unknown=options.keep_out_unknown)
        whole, area = area, cut_keep_out(area, rings)
        if area is whole:
            sys.stderr.write(f"note: {options.keep_out}: no area to keep out of in the field\n")
    frame = MapFrame(datum)
    if options.ab_line:
        a_lon, a_lat, b_lon, b_lat = _parse_numbers("--ab-line", options.ab_line, 4)
        points = (_place_on_map(a_lon, a_lat, frame), _place_on_map(b_lon, b_lat, frame))
        if math.dist(*points) < SHORTEST_AB_M or not all(_is_near(point) for point in points):
            raise MissionError(AbLineUnfit(options.ab_line, SHORTEST_AB_M, FARTHEST_AB_M))
        area = msgspec.structs.replace(area, ab_line=points)
    robot = load_robot(options.robot)
    request = _make_request(options, area, frame, robot)
    shape = measure_footprint(robot, request.implement_width_m, request.tool_x_m)
    plan = warn_of_gaps(plan_field(area, shape, request), area, request, robot)
    return SavedPlan(plan, area, request, datum), certify_plan(plan, area, shape, request)


def _is_near(point: MapPoint) -> bool:
    return math.hypot(*point) <= FARTHEST_AB_M


def _verify_plan(options: argparse.Namespace) -> tuple[SavedPlan, Certificate]:
    from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
    from agribot.autonomy.plan.coverage.tool_gaps import warn_of_gaps
    from agribot.autonomy.plan.ways.footprint import measure_footprint
    from agribot.description.loader import load_robot
    from agribot.gis.plan_file import read_plan

    if options.file is None:
        raise MissionError(PlanNeeded())
    saved = read_plan(Path(options.file))
    request, robot = saved.request, load_robot(options.robot)
    shape = measure_footprint(robot, request.implement_width_m, request.tool_x_m)
    plan = warn_of_gaps(saved.plan, saved.area, request, robot)
    certificate = certify_plan(plan, saved.area, shape, request)
    return saved._replace(plan=plan), certificate


def _make_request(
    options: argparse.Namespace, area: FieldArea, frame: MapFrame, robot: RobotSpec
) -> PlanRequest:
    from agribot.app.field_work import choose_width_m
    from agribot.autonomy.plan.coverage.area import MOST_MARGIN_M, PlanRequest

    width_m = choose_width_m(options.implement_width, robot)
    passes = options.headland_passes
    tool_x_m = robot.tool_x_m if options.tool_offset is None else options.tool_offset
    margin_m = area.choose_margin_m(options.margin)
    for name, value, low, high in (
        ("--implement-width", width_m, 0.05, 50.0),
        ("--overlap", options.overlap, 0.0, 50.0),
        ("--margin", margin_m, 0.0, MOST_MARGIN_M),
        ("--headland-passes", passes or 0, 0, 0 if area.rows else 50),
        ("--tool-offset", tool_x_m, -5.0, 5.0),
        ("--min-coverage", options.min_coverage, 0.0, 1.0),
    ):
        if not low <= value <= high:
            raise MissionError(OptionOutside(name, value, low, high))
    start: MapPoint | None = None
    if options.start:
        lon_deg, lat_deg = _parse_numbers("--start", options.start, 2)
        start = _place_on_map(lon_deg, lat_deg, frame)
    return PlanRequest(
        implement_width_m=width_m,
        overlap_m=options.overlap,
        margin_m=margin_m,
        headland_passes=passes,
        swath_yaw_rad=_parse_swath_yaw_rad(options.swath_angle),
        start_map_m=start,
        turns=options.turns,
        min_coverage_ratio=options.min_coverage,
        tool_x_m=tool_x_m,
    )


def _parse_swath_yaw_rad(text: str) -> float | None:
    if text == "auto":
        return None
    return math.radians(90.0 - _parse_numbers("--swath-angle", text, 1)[0])


def _parse_numbers(name: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise MissionError(NumbersExpected(name, text, count))
    return values


def _place_on_map(lon_deg: float, lat_deg: float, frame: MapFrame) -> MapPoint:
    if abs(lat_deg) > 90.0:
        raise MissionError(OptionLatitude(lat_deg))
    east_m, north_m, _ = frame.map_from_geodetic(lat_deg, lon_deg, frame.datum.alt_m)
    return east_m, north_m


def _format_summary(certificate: Certificate, frame: MapFrame) -> str:
    c = certificate
    lines = [
        f"{'CERTIFIED' if c.ok else 'REFUSED'}: {c.field_area_m2 / 1e4:.3f} ha, "
        f"{100 * c.coverage_ratio:.2f} % of the reachable ground worked, "
        f"overlap {100 * c.overlap_ratio:.1f} %",
        f"{c.length_m:.0f} m of way, {c.working_length_m:.0f} m with the tool on, "
        f"{c.working_legs} working legs, {c.pivots} turns in place",
        f"footprint at least {c.clearance_m:.3f} m from every edge",
    ]
    if c.wheel_row_clearance_m is not None:
        lines.append(f"wheels at least {c.wheel_row_clearance_m:.3f} m from every crop row")
    for problem in c.problems:
        lat_deg, lon_deg, _ = frame.geodetic_from_map(problem.east_m, problem.north_m)
        where = (
            f" (latitude {lat_deg:.7f}, longitude {lon_deg:.7f})" if math.isfinite(lat_deg) else ""
        )
        lines.append(f"{problem.rule}: {problem.message}{where}")
    return "\n  ".join(lines) + "\n"
