"""Names by the place of plants beside rows: drawn rows whose place is known."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_row_line import FarLine
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.leaf_owners import OwnedLeaves
from agribot.autonomy.perceive.plants import observe
from agribot.autonomy.perceive.row_names import find_spread, locate_cells, name_by_rows
from agribot.autonomy.perceive.stems import CELL_PX, Stems
from agribot.core.config import PerceptionConfig
from agribot.core.messages import CameraFrame, PlantClass
from tests.autonomy.perceive.drawn_rows import PLANT_RGB, SOIL_RGB
from tests.autonomy.perceive.test_far_row_line import (
    FRONT,
    PITCH_M,
    SHAPE,
    draw,
    draw_rows,
    open_ground,
)

CROP, WEED, SOIL = PlantClass.CROP, PlantClass.WEED, PlantClass.SOIL
ROWS_M = np.arange(-3, 4) * PITCH_M
ALONG_M, FEW_ALONG_M = np.arange(0.5, 4.0, 0.25), np.array([0.75, 1.5, 2.25])


def make_rows(across_std_m: float = 0.03, tilt_rad: float = 0.0) -> FarLine:
    """Make rows along the robot's way, one of them under its middle."""
    return FarLine(
        x_m=1.4, y_m=0.0, yaw_rad=0.0, across_std_m=across_std_m, yaw_std_rad=0.02,
        spacing_m=PITCH_M, tilt_rad=tilt_rad,
    )  # fmt: skip


def place(along_m: np.ndarray, off: float) -> tuple[np.ndarray, np.ndarray]:
    """Place plants `off` spacings left of every row; return them ahead and to the left."""
    ahead_m, left_m = np.meshgrid(along_m, ROWS_M + off * PITCH_M)
    return ahead_m.ravel(), left_m.ravel()


def draw_plants(
    off: float, look: PlantClass, sure: float, ground: GroundLookup = FRONT
) -> ClassMap:
    """Draw sure crop on all rows, and a few plants of one look beside them."""
    rows, others = draw(ground, *place(ALONG_M, 0.0)), draw(ground, *place(FEW_ALONG_M, off))
    is_other = others.class_id != SOIL
    class_id = np.where(is_other, np.uint8(look), rows.class_id)
    confidence = np.where(is_other, np.uint8(round(255 * sure)), np.uint8(230))
    return ClassMap(class_id=class_id, confidence=confidence, scale_px=(2.0, 2.0))


def find_shares(
    class_map: ClassMap, off: float, ground: GroundLookup = FRONT
) -> tuple[float, float]:
    """Find which shares of the plants' pixels beside the rows are crop and weed."""
    here = class_map.class_id[draw(ground, *place(FEW_ALONG_M, off)).class_id != SOIL]
    return float((here == CROP).mean()), float((here == WEED).mean())


@pytest.mark.parametrize(
    ("off", "look", "sure", "named"),
    [
        (0.5, CROP, 0.8, WEED),
        (0.5, CROP, 0.95, WEED),
        (0.5, WEED, 0.6, WEED),
        (0.0, WEED, 0.6, CROP),
        (0.0, WEED, 0.99, WEED),
        (0.15, CROP, 0.9, CROP),
    ],
    ids=[
        "crop-between", "sure-crop-between", "weed-between", "doubtful-weed-in-row",
        "sure-weed-in-row", "crop-beside-row",
    ],
)  # fmt: skip
def test_look_and_place_name_a_plant_together(
    off: float, look: PlantClass, sure: float, named: PlantClass
) -> None:
    named_map = name_by_rows(draw_plants(off, look, sure), FRONT, make_rows())
    crop, weed = find_shares(named_map, off)
    assert (crop if named == CROP else weed) > 0.8


def test_rows_whose_place_is_unknown_name_nothing() -> None:
    class_map = draw_plants(0.5, CROP, 0.8)
    named = name_by_rows(class_map, FRONT, make_rows(across_std_m=PITCH_M))
    assert (named.class_id == class_map.class_id).all()


def test_soil_stays_soil() -> None:
    class_map = draw_plants(0.5, CROP, 0.8)
    named = name_by_rows(class_map, FRONT, make_rows())
    is_soil = class_map.class_id == SOIL
    assert (named.class_id[is_soil] == SOIL).all()
    assert (named.confidence[is_soil] == class_map.confidence[is_soil]).all()


def test_a_leaf_that_the_network_missed_is_named_by_its_place() -> None:
    class_map = draw_plants(0.5, CROP, 0.8)
    rows_m = np.abs(FRONT.y_body_m / PITCH_M - np.round(FRONT.y_body_m / PITCH_M)) < 0.05
    is_missed = (class_map.class_id == CROP) & rows_m & (FRONT.x_body_m < 1.2)
    missing = msgspec.structs.replace(
        class_map,
        class_id=np.where(is_missed, SOIL, class_map.class_id).astype(np.uint8),
        confidence=np.where(is_missed, np.uint8(150), class_map.confidence),
    )
    image_rgb = np.where((class_map.class_id != SOIL)[..., None], PLANT_RGB, SOIL_RGB)
    named = name_by_rows(missing, FRONT, make_rows(), image_rgb.astype(np.uint8))
    assert is_missed.sum() > 100
    assert (named.class_id[is_missed] == CROP).mean() > 0.95


def test_leaves_that_close_the_space_between_rows_are_no_weeds() -> None:
    everywhere = ClassMap(
        class_id=np.full(SHAPE, CROP, np.uint8),
        confidence=np.full(SHAPE, 200, np.uint8),
        scale_px=(2.0, 2.0),
    )
    named = name_by_rows(everywhere, FRONT, make_rows())
    assert (named.class_id == CROP).mean() > 0.99


def test_wide_leaves_spread_farther_from_their_row_than_narrow_ones() -> None:
    places = locate_cells(FRONT, make_rows(across_std_m=0.01))
    look = np.full(places.off.shape, 3.0)
    narrow, wide = (find_spread(look, places, np.abs(places.off) < most) for most in (0.1, 0.3))
    assert narrow < 0.08
    assert 0.12 < wide < 0.25


def test_a_tilted_camera_names_by_where_it_looks() -> None:
    tilt_rad = math.radians(4.0)
    ground = open_ground(tilt_rad)
    class_map = draw_plants(0.5, CROP, 0.8, ground)
    named = name_by_rows(class_map, FRONT, make_rows(tilt_rad=tilt_rad))
    assert find_shares(named, 0.5, ground)[1] > 0.8


def test_a_stem_is_named_as_its_leaves_are() -> None:
    class_map = draw_plants(0.5, CROP, 0.8)
    v_px = SHAPE[0] - 20
    across_m = FRONT.y_body_m[v_px]
    columns = [float(np.abs(across_m - left_m).argmin()) for left_m in (0.0, PITCH_M / 2.0)]
    stems = Stems(
        uv_px=np.array([(u_px, float(v_px)) for u_px in columns]),
        kind_scores=np.array([(0.3, 0.7), (0.3, 0.7)]),
        squares=np.zeros((2, 2), dtype=np.int64),
    )
    owners = np.full((SHAPE[0] // CELL_PX, SHAPE[1] // CELL_PX), -1, dtype=np.int32)
    class_map = ClassMap(
        class_id=class_map.class_id, confidence=class_map.confidence, scale_px=(2.0, 2.0),
        owned=OwnedLeaves(stems, owners),
    )  # fmt: skip
    owned = name_by_rows(class_map, FRONT, make_rows()).owned
    assert owned is not None
    assert owned.stems.kind_scores.argmax(axis=1).tolist() == [CROP, WEED]
    assert owned.stems.kind_scores.max(axis=1).tolist() == pytest.approx([0.7, 0.7])


def test_a_scene_has_the_names_that_its_rows_give() -> None:
    drawn = draw_rows(np.random.default_rng(3), 0.0, 0.0, weeds=0)
    others = draw(FRONT, *place(FEW_ALONG_M, 0.5))
    class_map = ClassMap(
        class_id=np.minimum(drawn.class_id, others.class_id),
        confidence=np.where(others.class_id != SOIL, np.uint8(160), drawn.confidence),
        scale_px=drawn.scale_px,
    )
    taken: list[ClassMap] = []
    frame = CameraFrame(t_s=1.0, index=0, image_rgb=np.zeros((*SHAPE, 3), np.uint8))
    scene = observe(frame, class_map, FRONT, PerceptionConfig(), 1.0, taken.append)
    assert class_map.class_id.min() == CROP
    assert find_shares(taken[0], 0.5)[1] > 0.8
    assert scene.class_ratio[WEED] > 0.005
    assert scene.row_line is not None
