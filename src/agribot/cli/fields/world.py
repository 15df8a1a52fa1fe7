"""`agribot world`: list, check, generate and render worlds."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from agribot.cli.ranges import positive, seed
from agribot.core.errors import DescriptionError, RecordingError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import ByteArray, FloatArray
from agribot.core.world import RowTable, WorldSpec

if TYPE_CHECKING:
    from agribot.description.elements import FileFinding
    from agribot.description.ros_map import RosMap

MAP_SUFFIXES = {".yaml", ".yml"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    actions.add_parser(
        "list", help="names of the packaged worlds", epilog="example: agribot world list"
    )
    check = actions.add_parser(
        "check",
        help="say what a world file or a map contains, or what is wrong",
        epilog="example: agribot world check Farm --strict",
    )
    check.add_argument("world", metavar="NAME|FILE", help="a world, or a map's .yaml file")
    check.add_argument(
        "--strict", action="store_true", help="list every fault as FILE:LINE and fail on any"
    )
    check.add_argument("--json", action="store_true")
    generate = actions.add_parser(
        "generate",
        help="a field of crop rows and weeds by chance",
        epilog="example: agribot world generate field.toml --seed 3 -o field.world",
    )
    generate.add_argument("field", metavar="FIELD.toml")
    generate.add_argument("--seed", type=seed, default=0)
    generate.add_argument("-o", "--out", required=True, metavar="X.world")
    generate.add_argument("--json", action="store_true")
    render = actions.add_parser(
        "render",
        help="a picture of a world, from above the field",
        epilog="example: agribot world render hills --view rover -o hills.png",
    )
    render.add_argument("world", metavar="NAME|FILE")
    render.add_argument("-o", "--out", required=True, metavar="PNG")
    render.add_argument("--seed", type=seed, default=0)
    render.add_argument(
        "--view", choices=("field", "rover"), default="field", help="from high, or as the robot"
    )
    _add_map(actions)
    pictures = actions.add_parser(
        "gallery",
        help="one picture of worlds, cameras, crops, light and labels",
        epilog="example: agribot world gallery -o gallery.png",
    )
    pictures.add_argument("-o", "--out", required=True, metavar="PNG")


def _add_map(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    occupancy = actions.add_parser(
        "map",
        help="an occupancy map of a world or of a field for ROS's map_server",
        epilog="example: agribot world map Farm -o farm.yaml",
    )
    occupancy.add_argument(
        "world", metavar="NAME|FILE",
        help="a world, or a field in a format of agribot plan --field: free inside, occupied "
        "outside and in its obstacles",
    )  # fmt: skip
    occupancy.add_argument(
        "-o", "--out", required=True, metavar="X.yaml", help="the picture is written beside it"
    )
    occupancy.add_argument(
        "--size",
        type=positive,
        default=20.0,
        metavar="M",
        help="side of the square of a world (20)",
    )
    occupancy.add_argument(
        "--resolution", type=positive, default=0.1, metavar="M", help="side of a cell (0.1)"
    )
    occupancy.add_argument("--json", action="store_true")


def run(options: argparse.Namespace) -> int:
    from agribot.description.worlds_sdf import list_worlds

    if options.action == "list":
        sys.stdout.write("\n".join(list_worlds()) + "\n")
        return 0
    actions = {
        "check": _check,
        "generate": _generate,
        "map": _write_map,
        "render": _render,
        "gallery": _gallery,
    }
    return actions[options.action](options)


def _generate(options: argparse.Namespace) -> int:
    from agribot.description.field_generator import generate_field
    from agribot.description.field_settings import read_field_settings
    from agribot.description.sdf_export import write_world

    field, out = Path(options.field), Path(options.out)
    if out.suffix not in {".world", ".sdf"}:
        raise DescriptionError(f"-o {out}: not a name of a world; end it with .world or .sdf")
    plan = read_field_settings(field)
    for unknown in _name_unknown_species([plan.crop.species, *plan.weeds.species]):
        raise DescriptionError(f"{field.name}: {unknown}")
    world = generate_field(plan, options.seed, field.parent)
    write_world(world, out)
    kinds = Counter(plant.plant.name.lower() for plant in world.plants)
    summary = {"world": str(out), "seed": options.seed, **kinds}
    if options.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    else:
        sys.stdout.write("".join(f"{key}: {value}\n" for key, value in summary.items()))
    return 0


def _format_rows(rows: RowTable) -> str:
    east_m, north_m = rows.first_row_start_map_m
    bent = f", bent by {rows.row_curvature_radpm:g} rad/m" if rows.row_curvature_radpm else ""
    return (
        f"{rows.row_count} of {rows.row_length_m:.4g} m, {rows.row_pitch_m:.4g} m apart, the first "
        f"from East {east_m:.4g} m, North {north_m:.4g} m towards {rows.row_yaw_deg:.4g} degrees"
        f"{bent}"
    )


def _check(options: argparse.Namespace) -> int:
    from agribot.description.row_table import find_row_table
    from agribot.description.worlds_sdf import check_world, load_world

    if Path(options.world).suffix in MAP_SUFFIXES:
        return _check_map(options)
    if options.strict:
        findings = [*check_world(options.world), *_list_plants_unknown(options.world)]
        return print_findings(findings, options.json, is_strict=True)
    world = load_world(options.world)
    species = Counter(plant.species for plant in world.plants)
    warnings = [*world.warnings, *_name_unknown_species(species)]
    rows = find_row_table(world)
    summary = {
        "name": world.name,
        "datum": [world.datum.lat_deg, world.datum.lon_deg],
        "plants": dict(species),
        "rows": None if rows is None else msgspec.structs.asdict(rows),
        "obstacles": len(world.obstacles),
        "walkers": len(world.walkers),
        "ground_tiles": len(world.ground),
        "terrain": None if world.terrain is None else list(world.terrain.height_m.shape),
        "warnings": warnings,
    }
    if options.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    else:
        summary["warnings"] = len(warnings)
        summary["rows"] = None if rows is None else _format_rows(rows)
        sys.stderr.writelines(f"warning: {warning}\n" for warning in warnings)
        sys.stdout.write("".join(f"{key}: {value}\n" for key, value in summary.items()))
    return 0


def _list_plants_unknown(name_or_path: str) -> list[FileFinding]:
    """List the plants of a world that cannot be drawn; none where it cannot be read at all."""
    from agribot.description.elements import FileFinding
    from agribot.description.worlds_sdf import load_world

    try:
        plants = load_world(name_or_path).plants
    except DescriptionError:
        return []
    unknown = _name_unknown_species(dict.fromkeys(plant.species for plant in plants))
    return [FileFinding(Path(name_or_path).name, 0, text, text, is_fault=True) for text in unknown]


def _name_unknown_species(names: Iterable[str]) -> list[str]:
    """Say of each species that does not grow in the simulator which ones do."""
    from agribot.sim.flora.species import find_species

    unknown = []
    for name in names:
        try:
            find_species(name)
        except DescriptionError as error:
            unknown.append(str(error))
    return unknown


def _check_map(options: argparse.Namespace) -> int:
    from agribot.description.ros_map import load_ros_map

    _print_map(options.world, load_ros_map(Path(options.world)), options.json)
    return 0


def _write_map(options: argparse.Namespace) -> int:
    from agribot.description.ros_map import save_ros_map

    out = Path(options.out)
    if out.suffix not in MAP_SUFFIXES:
        raise DescriptionError(f"-o {out}: not a name of a map; end it with .yaml or .yml")
    ros_map = _make_map(options)
    save_ros_map(ros_map, out)
    _print_map(str(out), ros_map, options.json)
    return 0


def _make_map(options: argparse.Namespace) -> RosMap:
    """Make the map of a field where the name ends as one, else that of a world."""
    from agribot.description.ros_map import make_world_map
    from agribot.description.worlds_sdf import load_world
    from agribot.gis.field_choice import split_choice
    from agribot.gis.field_file import read_field
    from agribot.gis.field_map import make_field_map
    from agribot.gis.formats.table import READERS, find_ending

    file, _names = split_choice(Path(options.world))
    if find_ending(file.name) in READERS:
        area, datum = read_field(Path(options.world))
        return make_field_map(area, datum, options.resolution)
    return make_world_map(load_world(options.world), options.size, options.resolution)


def _print_map(name: str, ros_map: RosMap, as_json: bool) -> None:
    rows, columns = ros_map.cells.shape
    datum = ros_map.datum
    summary = {
        "map": name,
        "datum": None if datum is None else [datum.lat_deg, datum.lon_deg],
        "origin_map_m": [ros_map.x_min_m, ros_map.y_min_m],
        "resolution_m": ros_map.resolution_m,
        "cells": [rows, columns],
        **ros_map.count_cells(),
    }
    if as_json:
        sys.stdout.write(json.dumps(summary) + "\n")
    else:
        sys.stdout.write("".join(f"{key}: {value}\n" for key, value in summary.items()))


def print_findings(
    findings: Sequence[FileFinding], as_json: bool, *, is_strict: bool = False
) -> int:
    """Print the findings of a check; return the exit status. To a strict one all are faults."""
    faults = [finding for finding in findings if finding.is_fault or is_strict]
    notes = [finding for finding in findings if finding not in faults]
    if as_json:
        result = {
            "ok": not faults,
            "faults": list(map(_to_tree, faults)),
            "notes": list(map(_to_tree, notes)),
        }
        sys.stdout.write(json.dumps(result) + "\n")
    else:
        sys.stdout.writelines(f"fault: {fault}\n" for fault in faults)
        sys.stdout.writelines(f"note: {note}\n" for note in notes)
        sys.stdout.write(f"{len(faults)} faults, {len(notes)} notes\n")
    return 1 if faults else 0


def _to_tree(finding: FileFinding) -> dict[str, object]:
    return {"file": finding.file, "line": finding.line, "text": finding.text}


def _render(options: argparse.Namespace) -> int:
    from agribot.description.loader import load_robot
    from agribot.description.worlds_sdf import load_world
    from agribot.sim.camera import CameraRenderer

    world = load_world(options.world, seed=options.seed)
    robot = load_robot()
    if robot.camera is None:
        raise AssertionError("the packaged robot has a camera")
    map_from_camera = (
        _place_rover(world) @ robot.body_from_camera()
        if options.view == "rover"
        else _overlook_field(world) @ LINK_FROM_OPTICAL
    )
    picture = CameraRenderer(world).render(
        map_from_camera, robot.camera, noise_seed=None, supersample=2
    )
    _save(picture.image_rgb, Path(options.out))
    return 0


def _gallery(options: argparse.Namespace) -> int:
    from agribot.cli.fields.gallery import draw_gallery

    _save(draw_gallery(), Path(options.out))
    return 0


def _save(image_rgb: ByteArray, path: Path) -> None:
    from PIL import Image

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(image_rgb).save(path)
    except (OSError, ValueError) as error:  # ValueError: a file type that is no picture's
        raise RecordingError(
            f"cannot write {path}: {error}; choose another path that ends in .png"
        ) from error


def _place_rover(world: WorldSpec) -> FloatArray:
    """Compute the body frame (4, 4) where the robot starts, tilted as the ground is."""
    x_m, y_m = world.spawn_xy_map_m
    yaw = world.spawn_yaw_map_rad
    ahead, left = (math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))
    reach_m = 0.3
    pitch, roll = (
        math.atan(_find_rise_m(world, x_m, y_m, (dx * reach_m, dy * reach_m)) / (2.0 * reach_m))
        for dx, dy in (ahead, left)
    )
    return transform((x_m, y_m, _find_ground_m(world, x_m, y_m)), (roll, -pitch, yaw))


def _overlook_field(world: WorldSpec) -> FloatArray:
    """Place a camera (4, 4) high in the South of the field, or of all the land."""
    land = world.terrain
    if world.plants or land is None:
        xy = np.array([(p.x_map_m, p.y_map_m) for p in world.plants] or [world.spawn_xy_map_m])
        x_m, y_m = xy.mean(axis=0).tolist()
        back_m, up_m = 14.0, 9.0 + _find_ground_m(world, x_m, y_m)
    else:
        rows, columns = land.height_m.shape
        x_m = land.x_min_m + (columns - 1) / 2.0 * land.resolution_m
        y_m = land.y_min_m + (rows - 1) / 2.0 * land.resolution_m
        back_m, up_m = 0.9 * rows * land.resolution_m, 1.6 * float(land.height_m.max())
    tilt_rad = math.atan2(up_m - _find_ground_m(world, x_m, y_m), back_m)
    return transform((x_m, y_m - back_m, up_m), (0.0, tilt_rad, math.pi / 2.0))


def _find_ground_m(world: WorldSpec, x_m: float, y_m: float) -> float:
    from agribot.description.terrain import sample_height

    return 0.0 if world.terrain is None else sample_height(world.terrain, x_m, y_m)


def _find_rise_m(world: WorldSpec, x_m: float, y_m: float, step_m: tuple[float, float]) -> float:
    """Compute the rise from one step behind a place to one step before it."""
    dx, dy = step_m
    return _find_ground_m(world, x_m + dx, y_m + dy) - _find_ground_m(world, x_m - dx, y_m - dy)
