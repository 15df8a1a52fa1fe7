"""Judges single plants, picture by picture: where their stems are, what they are, their pixels.

The robot's own camera looks along the middle row of generated fields that no network was trained
on. It is mounted as the robot's description says: what is judged is the finding of plants, on
ground that is as uneven as the conditions make it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plant_names import name_plants
from agribot.autonomy.perceive.plants import find_pieces, ground_plants
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.autonomy.perceive.stems import CELL_PX
from agribot.core.config import DEFAULT_MODEL, PerceptionConfig
from agribot.core.geo import inverse, transform
from agribot.core.messages import WHEEL_NAMES, ByteArray, FloatArray, GroundPlant, PlantClass, Row
from agribot.core.robot import CameraSpec, RobotSpec
from agribot.core.row_shape import start_yaw_rad
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.lab.bench.plant_scenes import PlantScene, draw_field, make_stream
from agribot.lab.plant_scores import PlacedPlants, PlantScores, PlantSegments, PlantTally
from agribot.lab.plant_table import format_head, format_line
from agribot.lab.train.plant_truth import place_stems, project_points
from agribot.lab.train.rough_ground import stand_on
from agribot.sim.camera.renderer import CameraRenderer, Rendering
from agribot.sim.ground_surface import GroundSurface, build_ground_surface

PRESET = "field"
FRAMES = 12
MAX_RANGE_M = PerceptionConfig().max_range_m
LEAST_PX = 30  # pixels of a visible plant; fewer show none: neither in truth nor in an answer
FRAMES_PER_FIELD = 4  # frames before the next field is drawn, in other light and on other ground
PLACES_M = (0.0, 4.0)  # places along the row, with row ahead
ASIDE_STD_M, TURN_STD_RAD = 0.03, 0.04  # errors of a robot that follows the row

Mask = npt.NDArray[np.bool_]


class PictureTruth(NamedTuple):
    """The plants of one picture (H, W), stems in the body frame.

    `plants` are to be found; `others` show some pixels, but too few, too far away, or without the
    stem. `unjudged` (H, W) are the pixels of those, and all that are out of range.
    """

    plants: PlacedPlants
    others: PlacedPlants
    segments: PlantSegments
    unjudged: Mask


class PictureOfPlants(NamedTuple):
    drawn: Rendering
    truth: PictureTruth


def judge_scenes(
    scenes: Sequence[PlantScene],
    model: str = DEFAULT_MODEL,
    preset: str = PRESET,
    frames: int = FRAMES,
    seed: int = 0,
    max_range_m: float = MAX_RANGE_M,
    show_line: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Judge a network on the same number of frames per scene: pooled, and `by` scene.

    To be found are the plants up to `max_range_m` from the point below the camera.
    Raises: AgribotError: no such network or preset.
    """
    config = PerceptionConfig(model=model, max_range_m=max_range_m)
    robot, segmenter = load_robot(), Segmenter(model, config.threads)
    pooled = PlantTally()
    rows = []
    show_line(format_head())
    for scene in scenes:
        tally = _judge_scene(scene, robot, segmenter, config, preset, frames, seed)
        scores = tally.compute_scores()
        rows.append({**msgspec.to_builtins(scene), "frames": frames, **msgspec.to_builtins(scores)})
        show_line(format_line(scene.name, scores))
        pooled.add(tally)
    scores = pooled.compute_scores()
    show_line(format_line("all", scores))
    return {
        "model": model,
        "preset": preset,
        "seed": seed,
        "frames": frames * len(scenes),
        "max_range_m": max_range_m,
        **msgspec.to_builtins(scores),
        "by": rows,
    }


def list_scores(result: dict[str, Any]) -> dict[str, PlantScores]:
    """List the scores of a result by scene, those of all scenes together last."""
    rows = [*result["by"], {**result, "name": "all"}]
    return {row["name"]: msgspec.convert(row, PlantScores) for row in rows}


def _judge_scene(
    scene: PlantScene,
    robot: RobotSpec,
    segmenter: Segmenter,
    config: PerceptionConfig,
    preset: str,
    frames: int,
    seed: int,
) -> PlantTally:
    camera, body_from_camera = robot.camera, robot.body_from_camera()
    assert camera is not None  # body_from_camera() has looked
    ground = GroundLookup(camera, body_from_camera, segmenter.map_shape, config.max_range_m)
    tally, rng = PlantTally(), make_stream(scene, seed)
    for picture in draw_pictures(scene, robot, config.max_range_m, preset, frames, rng):
        class_map, truth = segmenter.segment(picture.drawn.image_rgb), picture.truth
        answer = _place(ground_plants(class_map, ground, config))
        tally.add_plants(truth.plants, answer, truth.others)
        segments = _enlarge(find_segments(class_map, ground), truth.unjudged.shape)
        tally.add_segments(truth.segments, segments, truth.unjudged)
    return tally


def draw_pictures(
    scene: PlantScene,
    robot: RobotSpec,
    max_range_m: float,
    preset: str,
    frames: int,
    rng: np.random.Generator,
) -> Iterator[PictureOfPlants]:
    """Draw pictures of a scene, a new field after every few of them."""
    camera, body_from_camera = robot.camera, robot.body_from_camera()
    assert camera is not None  # body_from_camera() has looked
    shape = camera.height_px, camera.width_px
    lookup = GroundLookup(camera, body_from_camera, shape, max_range_m)
    for first in range(0, frames, FRAMES_PER_FIELD):
        world, row = draw_field(scene, preset, rng)
        ground = build_ground_surface(world)
        renderer = CameraRenderer(world, robot, threads=1, ground=ground)
        for _ in range(min(FRAMES_PER_FIELD, frames - first)):
            map_from_body = _choose_pose(row, rng)
            if ground.has_detail:
                map_from_body = stand_on(ground, map_from_body, robot.drive)
            drawn = renderer.render(
                map_from_body @ body_from_camera,
                camera,
                noise_seed=int(rng.integers(2**31)),
                map_from_body=map_from_body,
                wheel_angles_rad=rng.uniform(0.0, math.tau, len(WHEEL_NAMES)).tolist(),
            )
            truth = find_truth(drawn, world, lookup, map_from_body, body_from_camera, ground)
            yield PictureOfPlants(drawn, truth)


def _choose_pose(row: Row, rng: np.random.Generator) -> FloatArray:
    """Choose a level `map_from_body` (4, 4) on a straight row, a little beside and turned."""
    yaw_rad, along_m = start_yaw_rad(row), rng.uniform(*PLACES_M)
    aside_m, turn_rad = rng.normal(0.0, (ASIDE_STD_M, TURN_STD_RAD)).tolist()
    x_m, y_m = row.start_map_m
    x_m += along_m * math.cos(yaw_rad) - aside_m * math.sin(yaw_rad)
    y_m += along_m * math.sin(yaw_rad) + aside_m * math.cos(yaw_rad)
    return transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad + turn_rad))


def find_truth(
    drawn: Rendering,
    world: WorldSpec,
    lookup: GroundLookup,
    map_from_body: FloatArray,
    body_from_camera: FloatArray,
    ground: GroundSurface,
) -> PictureTruth:
    """Find the plants of a picture; `lookup` is of the picture's own pixels.

    To be found is a plant of at least LEAST_PX visible pixels whose stem is in the picture, be it
    behind leaves, and within range.
    """
    instance = drawn.instance
    seen_px = np.bincount(instance[instance >= 0], minlength=len(world.plants))
    shown = np.flatnonzero(seen_px)
    places_m, kind = place_stems(world, shown, ground)
    body_m = _move(places_m, inverse(map_from_body))
    camera_m = _move(body_m, inverse(body_from_camera))
    range_m = np.hypot(*(body_m[:, :2] - lookup.camera_xyz_body_m[:2]).T)
    is_wanted = (
        (seen_px[shown] >= LEAST_PX)
        & (range_m <= lookup.max_range_m)
        & _is_in_view(camera_m, lookup.camera)
    )
    every = PlacedPlants(body_m[:, :2], kind)
    # Number of instance -1, the last, means none.
    number = np.zeros(len(world.plants) + 1, dtype=np.int64)
    number[shown[is_wanted]] = np.arange(1, int(is_wanted.sum()) + 1)
    segments = PlantSegments(number[instance], every.kind[is_wanted])
    is_near = np.nan_to_num(lookup.range_m, nan=np.inf) <= lookup.max_range_m
    return PictureTruth(
        plants=every.choose(is_wanted),
        others=every.choose(~is_wanted),
        segments=segments,
        unjudged=((instance >= 0) & (segments.number == 0)) | ~is_near,
    )


def _move(points_m: FloatArray, other_from_own: FloatArray) -> FloatArray:
    """Bring points (N, 3) of one frame into another."""
    moved: FloatArray = points_m @ other_from_own[:3, :3].T + other_from_own[:3, 3]
    return moved


def _is_in_view(camera_m: FloatArray, camera: CameraSpec) -> Mask:
    """Return which points (N, 3) of the optical frame are in view, ignoring occlusion."""
    is_ahead = camera_m[:, 2] > camera.clip_near_m
    places_px = project_points(camera_m, camera)
    size_px = np.array([camera.width_px, camera.height_px])
    is_inside = (places_px >= -0.5) & (places_px < size_px - 0.5)
    inside: Mask = is_ahead & is_inside.all(axis=1)
    return inside


def _place(found: Sequence[GroundPlant]) -> PlacedPlants:
    places_m = np.array([(p.x_body_m, p.y_body_m) for p in found]).reshape(-1, 2)
    return PlacedPlants(places_m, np.array([p.plant for p in found], dtype=np.uint8))


def find_segments(class_map: ClassMap, ground: GroundLookup) -> PlantSegments:
    """Find which plant each pixel of a class map is of.

    A network that finds plants leads vegetation to its stem; for one that only gives classes, a
    plant is a connected piece.
    """
    if class_map.plants is None:
        pieces = find_pieces(class_map, ground)
        is_crop = np.arange(pieces.total) >= pieces.weeds
        return PlantSegments(pieces.labels, _name_kinds(is_crop))
    owned = class_map.owned or name_plants(class_map).owned
    assert owned is not None  # a map with stems was named
    number = (owned.owners + 1).repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)
    number[(class_map.class_id == PlantClass.SOIL) | (ground.area_m2 <= 0.0)] = 0
    is_crop = owned.stems.kind_scores.argmax(axis=1) == PlantClass.CROP
    return PlantSegments(number, _name_kinds(is_crop))


def _name_kinds(is_crop: Mask) -> ByteArray:
    return np.where(is_crop, np.uint8(PlantClass.CROP), np.uint8(PlantClass.WEED))


def _enlarge(found: PlantSegments, shape: tuple[int, ...]) -> PlantSegments:
    """Bring segments to the size of the picture (H, W), without those that are too small there."""
    height, width = found.number.shape
    rows = ((np.arange(shape[0]) + 0.5) * height / shape[0]).astype(int)
    columns = ((np.arange(shape[1]) + 0.5) * width / shape[1]).astype(int)
    number = found.number[rows[:, None], columns[None]]
    size_px = np.bincount(number.ravel(), minlength=len(found.kind) + 1)[1:]
    is_big = size_px >= LEAST_PX
    renumbered = np.zeros(len(found.kind) + 1, dtype=np.int64)
    renumbered[1:][is_big] = np.arange(1, int(is_big.sum()) + 1)
    return PlantSegments(renumbered[number], found.kind[is_big])
