"""A network that makes no mistakes: class, stem and owner of each plant as the renderer knows."""

from __future__ import annotations

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.stems import CELL_PX, SQUARE_PX, PlantMaps, find_centres
from agribot.core.config import PerceptionConfig
from agribot.core.messages import ByteArray, CameraFrame, FloatArray, PlantClass, Scene
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.lab.train.plant_truth import PlantTruth, find_plants
from agribot.sim.camera_sensor import TrueView

CERTAIN = 255


class TrueNames:
    """A tap of true views that answers for their frames as a network would."""

    def __init__(self, world: WorldSpec, robot: RobotSpec, config: PerceptionConfig) -> None:
        """Take the robot as it believes to be: its camera's mount is off by what its own is."""
        assert robot.camera is not None
        shape = robot.camera.height_px, robot.camera.width_px
        self._world, self._config = world, config
        self._ground = GroundLookup(
            robot.camera, robot.body_from_camera(), shape, config.max_range_m
        )
        self._answers: dict[int, tuple[ByteArray, ClassMap]] = {}

    def __call__(self, view: TrueView) -> None:
        plants = find_plants(
            view.picture, self._world, view.camera, view.map_from_camera, view.ground
        )
        class_id = view.picture.class_id
        answer = ClassMap(
            class_id=class_id,
            confidence=np.full_like(class_id, CERTAIN),
            scale_px=(1.0, 1.0),
            plants=make_plant_maps(plants),
        )
        self._answers[view.frame_index] = view.picture.image_rgb, answer

    def observe(self, scene: Scene) -> Scene:
        """Make the scene that this network gives where another one gave `scene`; once each."""
        image_rgb, answer = self._answers.pop(scene.frame_index)
        frame = CameraFrame(t_s=scene.t_s, index=scene.frame_index, image_rgb=image_rgb)
        return observe(frame, answer, self._ground, self._config, scene.ready_s)


def make_plant_maps(plants: PlantTruth) -> PlantMaps:
    """Make the maps of a network that is certain of each stem and of the way of each leaf to it."""
    height, width = plants.number.shape
    score = np.zeros((2, height // SQUARE_PX, width // SQUARE_PX), dtype=np.uint8)
    owner = _own_cells(plants)
    places = np.floor(plants.stem_px + 0.5).astype(np.int64)
    for number, ((u, v), kind) in enumerate(zip(places.tolist(), plants.kind, strict=True), 1):
        if 0 <= u < width and 0 <= v < height:
            score[0 if kind == PlantClass.WEED else 1, v // SQUARE_PX, u // SQUARE_PX] = CERTAIN
            owner[v // CELL_PX, u // CELL_PX] = number
    return PlantMaps(stem_score=score, way_px=_point_to_stems(owner, plants.stem_px))


def _own_cells(plants: PlantTruth) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    """Give each cell (h/4, w/4) the plant of its middle, or else one of those that it shows."""
    height, width = plants.number.shape
    cells = plants.number.reshape(height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX)
    middle, any_plant = cells[:, CELL_PX // 2, :, CELL_PX // 2], cells.max(axis=(1, 3))
    return np.where(middle > 0, middle, any_plant)


def _point_to_stems(
    owner: np.ndarray[tuple[int, ...], np.dtype[np.uint16]], stem_px: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Return the way (2, h/4, w/4) from each cell that has an owner to the stem of that plant."""
    way_px = np.zeros((2, *owner.shape), dtype=np.float32)
    held = np.argwhere(owner > 0)
    way_px[:, owner > 0] = (stem_px[owner[owner > 0] - 1] - find_centres(held)).T
    return way_px
