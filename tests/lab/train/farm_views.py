"""How well the plants of the Farm world are found from the robot's own camera, against truth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.config import PerceptionConfig
from agribot.core.geo import inverse
from agribot.core.messages import CameraFrame, FloatArray, GroundPlant, PlantClass
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.lab.train.farm import choose_row_pose
from agribot.sim.camera.renderer import CameraRenderer

# A plant that shows fewer of the image's pixels is hidden by another one and may be missed,
LEAST_VISIBLE_PX = 60
# and one that shows fewer than these cannot be what a report speaks of.
LEAST_SEEN_PX = 8
# Farther off, a report is no report of that plant.
NEAR_M = {PlantClass.WEED: 0.10, PlantClass.CROP: 0.15}


class Found(NamedTuple):
    """Sums over all views of one class."""

    true: int
    hit: int
    reported: int
    right: int
    error_m: tuple[float, ...]
    error_sigma: tuple[float, ...]

    @property
    def recall(self) -> float:
        return self.hit / self.true

    @property
    def precision(self) -> float:
        return self.right / self.reported


def look_at_farm(model: str, worlds: int, views: int) -> dict[PlantClass, Found]:
    """Match the plants reported on single frames with those that stand there."""
    found = {kind: Found(0, 0, 0, 0, (), ()) for kind in (PlantClass.WEED, PlantClass.CROP)}
    robot, config = load_robot(), PerceptionConfig()
    assert robot.camera is not None
    segmenter = Segmenter(model)
    ground = GroundLookup(
        robot.camera, robot.body_from_camera(), segmenter.map_shape, config.max_range_m
    )
    for seed in range(worlds):
        world, rng = load_world("Farm", seed=seed), np.random.default_rng([31, seed])
        renderer = CameraRenderer(world, threads=1)
        for index in range(views):
            map_from_body = choose_row_pose(rng, world)
            drawn = renderer.render(
                map_from_body @ robot.body_from_camera(), robot.camera, noise_seed=index
            )
            frame = CameraFrame(t_s=0.0, index=index, image_rgb=drawn.image_rgb)
            scene = observe(frame, segmenter.segment(drawn.image_rgb), ground, config, 0.2)
            visible_px = np.bincount(
                drawn.instance[drawn.instance >= 0], minlength=len(world.plants)
            )
            for kind, sums in found.items():
                found[kind] = _added(
                    sums,
                    _standing(world, map_from_body, visible_px >= LEAST_VISIBLE_PX, kind),
                    _standing(world, map_from_body, visible_px >= LEAST_SEEN_PX, kind),
                    [plant for plant in scene.plants if plant.plant == kind],
                    np.array(scene.view_body_m),
                    NEAR_M[kind],
                )
    return found


def _standing(
    world: WorldSpec, map_from_body: FloatArray, is_shown: NDArray[np.bool_], kind: PlantClass
) -> FloatArray:
    """True plants of a class that the camera shows, (N, 2) in the body frame."""
    places = [
        (plant.x_map_m, plant.y_map_m, 0.0, 1.0)
        for plant, shown in zip(world.plants, is_shown, strict=True)
        if plant.plant == kind and shown
    ]
    in_body: FloatArray = (np.array(places).reshape(-1, 4) @ inverse(map_from_body).T)[:, :2]
    return in_body


def _added(
    sums: Found,
    visible_m: FloatArray,
    seen_m: FloatArray,
    reported: list[GroundPlant],
    view_m: FloatArray,
    near_m: float,
) -> Found:
    errors_m, errors_sigma, true = list(sums.error_m), list(sums.error_sigma), sums.true
    for x_m, y_m in visible_m:
        if not _inside(view_m, x_m, y_m):
            continue
        true += 1
        near = [(math.hypot(p.x_body_m - x_m, p.y_body_m - y_m), p.std_m) for p in reported]
        off_m, std_m = min(near, default=(math.inf, 1.0))
        if off_m < near_m:
            errors_m.append(off_m)
            errors_sigma.append(off_m / std_m)
    right = sum(
        float(np.hypot(*(seen_m - (p.x_body_m, p.y_body_m)).T).min(initial=math.inf)) < near_m
        for p in reported
    )
    return Found(
        true,
        len(errors_m),
        sums.reported + len(reported),
        sums.right + right,
        tuple(errors_m),
        tuple(errors_sigma),
    )


def _inside(polygon_m: FloatArray, x_m: float, y_m: float) -> bool:
    """Whether a point lies in a convex counter-clockwise polygon."""
    side = np.roll(polygon_m, -1, axis=0) - polygon_m
    to_point = np.array([x_m, y_m]) - polygon_m
    return bool((side[:, 0] * to_point[:, 1] - side[:, 1] * to_point[:, 0] >= 0.0).all())
