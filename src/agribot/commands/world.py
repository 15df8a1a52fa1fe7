"""`agribot world`: list, check and render worlds."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agribot.description.elements import Finding
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import check_world, load_world, world_names
from agribot.errors import RecordingError
from agribot.geo import LINK_FROM_OPTICAL, transform


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    actions.add_parser("list", help="names of the packaged worlds")
    check = actions.add_parser("check", help="say what a world file contains, or what is wrong")
    check.add_argument("world", metavar="NAME|FILE")
    check.add_argument(
        "--strict", action="store_true", help="list every fault as FILE:LINE and fail on any"
    )
    check.add_argument("--json", action="store_true")
    render = actions.add_parser("render", help="a picture of a world, from above the field")
    render.add_argument("world", metavar="NAME|FILE")
    render.add_argument("-o", "--out", required=True, metavar="PNG")
    render.add_argument("--seed", type=int, default=0)
    render.add_argument(
        "--view", choices=("field", "rover"), default="field", help="from high, or as the robot"
    )


def run(options: argparse.Namespace) -> int:
    if options.action == "list":
        sys.stdout.write("\n".join(world_names()) + "\n")
        return 0
    return _check(options) if options.action == "check" else _render(options)


def _check(options: argparse.Namespace) -> int:
    if options.strict:
        return print_findings(check_world(options.world), options.json)
    world = load_world(options.world)
    species = Counter(plant.species for plant in world.plants)
    summary = {
        "name": world.name,
        "datum": [world.datum.lat_deg, world.datum.lon_deg],
        "plants": dict(species),
        "obstacles": len(world.obstacles),
        "ground_tiles": len(world.ground),
        "terrain": None if world.terrain is None else list(world.terrain.height_m.shape),
        "warnings": list(world.warnings),
    }
    if options.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    else:
        summary["warnings"] = len(world.warnings)
        sys.stderr.writelines(f"warning: {warning}\n" for warning in world.warnings)
        sys.stdout.write("".join(f"{key}: {value}\n" for key, value in summary.items()))
    return 0


def print_findings(findings: Sequence[Finding], as_json: bool) -> int:
    """Tell what a strict check found; the exit status."""
    if as_json:
        faults = [{"file": f.file, "line": f.line, "text": f.text} for f in findings]
        sys.stdout.write(json.dumps({"ok": not faults, "faults": faults}) + "\n")
    else:
        sys.stdout.writelines(f"{finding}\n" for finding in findings)
        sys.stdout.write(f"{len(findings)} faults\n")
    return 1 if findings else 0


def _render(options: argparse.Namespace) -> int:
    from PIL import Image

    from agribot.sim.camera import CameraRenderer

    world = load_world(options.world, seed=options.seed)
    robot = load_robot()
    if robot.camera is None:
        raise AssertionError("the packaged robot has a camera")
    x_m, y_m = world.spawn_xy_map_m
    if options.view == "rover":
        body = transform((x_m, y_m, 0.0), (0.0, 0.0, world.spawn_yaw_map_rad))
        map_from_camera = body @ robot.body_from_camera()
    else:
        xy = np.array([(p.x_map_m, p.y_map_m) for p in world.plants] or [(x_m, y_m)])
        centre = xy.mean(axis=0)
        looking = transform(
            (float(centre[0]), float(centre[1]) - 14.0, 9.0), (0.0, 0.6, float(np.pi / 2))
        )
        map_from_camera = looking @ LINK_FROM_OPTICAL
    picture = CameraRenderer(world).render(
        map_from_camera, robot.camera, noise_seed=None, supersample=2
    )
    try:
        Image.fromarray(picture.image_rgb).save(Path(options.out))
    except OSError as error:
        raise RecordingError(
            f"cannot write {options.out}: {error.strerror}; choose another path"
        ) from error
    return 0
