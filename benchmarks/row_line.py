"""How well the row line is seen: rendered pictures of a field, the network, the fit, the truth.

The robot is put over random rows of a world, a little off them and turned, tilted as on soil.

python benchmarks/row_line.py [--profile rows-10x12] [--pictures 200] [--seed 1] [--save FILE]
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import msgspec
import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.row_line import find_row_line
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core import config as settings
from agribot.core.geo import transform
from agribot.core.messages import RowLine
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.sim.camera import CameraRenderer
from agribot.sim.camera_sensor import keep_drawable

TILT_STD_RAD = math.radians(0.4)


class Look(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A class map and the true place of the robot: along and left of its row, and its heading."""

    class_map: ClassMap
    along_m: float
    left_m: float
    heading_rad: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--profile", default="rows-10x12")
    parser.add_argument("--pictures", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--past-ends", type=float, default=1.5, help="metres before and after a row"
    )
    parser.add_argument("--offset-std-m", type=float, default=0.06)
    parser.add_argument("--heading-std-deg", type=float, default=4.0)
    parser.add_argument("--save", type=Path, help="keep the class maps, for another look")
    options = parser.parse_args()
    config = settings.load(options.profile)
    robot = load_robot(config.robot)
    segmenter = Segmenter(config.perception.model)
    assert robot.camera is not None
    ground = GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, config.perception.max_range_m
    )
    if options.save is not None and options.save.exists():
        looks = load(options.save)
    else:
        looks = take_looks(config, segmenter, options)
        if options.save is not None:
            save(options.save, looks)
    assess_lines(
        looks, [find_row_line(look.class_map, ground, 0.0) for look in looks], config.field
    )


def take_looks(
    config: settings.RunConfig, segmenter: Segmenter, options: argparse.Namespace
) -> list[Look]:
    count, seed, past_m = options.pictures, options.seed, options.past_ends
    offset_std_m, heading_std_rad = options.offset_std_m, math.radians(options.heading_std_deg)
    robot, field = load_robot(config.robot), config.field
    assert robot.camera is not None
    world = load_world(config.world, seed=seed)
    renderer = CameraRenderer(world, keep_drawable(robot))
    rng = np.random.default_rng(seed)
    yaw = math.radians(field.row_yaw_deg)
    forward, right = (math.cos(yaw), math.sin(yaw)), (math.sin(yaw), -math.cos(yaw))
    looks = []
    for number in range(count):
        row = int(rng.integers(field.row_count))
        along_m = rng.uniform(-past_m, field.row_length_m + past_m)
        left_m, heading_rad = rng.normal(0.0, offset_std_m), rng.normal(0.0, heading_std_rad)
        sign = 1.0 if rng.uniform() < 0.5 else -1.0
        across_m = row * field.row_pitch_m - sign * left_m
        start = field.first_row_start_map_m
        body = transform(
            (
                start[0] + along_m * forward[0] + across_m * right[0],
                start[1] + along_m * forward[1] + across_m * right[1],
                0.0,
            ),
            (
                rng.normal(0.0, TILT_STD_RAD),
                rng.normal(0.0, TILT_STD_RAD),
                yaw + heading_rad + (0.0 if sign > 0.0 else math.pi),
            ),
        )
        picture = renderer.render(
            body @ robot.body_from_camera(),
            robot.camera,
            noise_seed=int(rng.integers(2**31)),
            map_from_body=body,
            wheel_angles_rad=(0.0, 0.0, 0.0, 0.0),
        )
        looks.append(
            Look(
                class_map=segmenter.segment(picture.image_rgb),
                along_m=along_m if sign > 0.0 else field.row_length_m - along_m,
                left_m=left_m,
                heading_rad=heading_rad,
            )
        )
        if number % 50 == 49:
            sys.stderr.write(f"{number + 1} of {count} pictures\n")
    return looks


def assess_lines(
    looks: list[Look], lines: list[RowLine | None], field: settings.FieldConfig
) -> None:
    length_m = field.row_length_m
    inside = [0.0 <= look.along_m <= length_m - 2.0 for look in looks]
    found = [line is not None for line in lines]
    share = sum(a and b for a, b in zip(inside, found, strict=True)) / max(sum(inside), 1)
    sys.stdout.write(
        f"{len(looks)} pictures, {sum(found)} lines; inside the rows {share:.1%} of pictures\n"
    )
    offsets, headings, starts, ends = [], [], [], []
    for look, line in zip(looks, lines, strict=True):
        if line is None or line.offset_m is None or line.heading_rad is None:
            continue
        left_m = look.left_m + line.at_ahead_m * math.sin(look.heading_rad)
        off_m = line.offset_m - left_m
        off_m -= round(off_m / field.row_pitch_m) * field.row_pitch_m  # another row's line
        offsets.append((off_m, line.offset_std_m))
        headings.append((line.heading_rad - look.heading_rad, line.heading_std_rad))
        if line.start_ahead_m is not None:
            starts.append((line.start_ahead_m + look.along_m, line.range_std_m))
        if line.end_ahead_m is not None:
            ends.append((line.end_ahead_m - (length_m - look.along_m), line.range_std_m))
    print_errors("offset", "cm", 100.0, offsets)
    print_errors("heading", "deg", math.degrees(1.0), headings)
    print_errors("row start", "cm", 100.0, starts)
    print_errors("row end", "cm", 100.0, ends)


def print_errors(name: str, unit: str, scale: float, errors: list[tuple[float, float]]) -> None:
    if not errors:
        sys.stdout.write(f"{name:10} none\n")
        return
    error, std = np.array(errors).T
    nees = np.mean((error / std) ** 2)
    outside = np.mean(np.abs(error) > 3.0 * std)
    sys.stdout.write(
        f"{name:10} {len(error):4}: bias {scale * error.mean():6.2f} {unit}, "
        f"std {scale * error.std():5.2f}, worst {scale * np.abs(error).max():5.1f}, "
        f"stated {scale * std.mean():5.2f}, NEES {nees:.2f}, beyond 3 sigma {outside:.1%}\n"
    )


def save(path: Path, looks: list[Look]) -> None:
    np.savez_compressed(
        path,
        class_id=np.stack([look.class_map.class_id for look in looks]),
        confidence=np.stack([look.class_map.confidence for look in looks]),
        scale_px=np.array(looks[0].class_map.scale_px),
        truth=np.array([(look.along_m, look.left_m, look.heading_rad) for look in looks]),
    )


def load(path: Path) -> list[Look]:
    data = np.load(path)
    scale_px = (float(data["scale_px"][0]), float(data["scale_px"][1]))
    return [
        Look(
            class_map=ClassMap(class_id=ids, confidence=sure, scale_px=scale_px),
            along_m=float(truth[0]), left_m=float(truth[1]), heading_rad=float(truth[2]),
        )
        for ids, sure, truth in zip(
            data["class_id"], data["confidence"], data["truth"], strict=True
        )
    ]  # fmt: skip


if __name__ == "__main__":
    main()
