from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.autonomy.perceive.stems import PlantMaps, find_owners, find_stems
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray, PlantClass
from tests.autonomy.perceive.drawn_field import Disc
from tests.autonomy.perceive.drawn_plants import draw_plants, find_stems_px, number_pixels

WEED, CROP, SOIL = PlantClass.WEED, PlantClass.CROP, PlantClass.SOIL
FIELD: tuple[Disc, ...] = (
    (0.8, 0.25, 0.05, CROP),
    (0.8, 0.14, 0.06, CROP),
    (0.87, 0.2, 0.02, WEED),
    (1.2, -0.2, 0.03, WEED),
    (1.2, -0.13, 0.05, WEED),
)
ROWS, COLUMNS = 24, 32


def make_maps(*scores: tuple[int, int, int, int], way_px: float = 0.0) -> PlantMaps:
    """Make maps with scores (kind, row, column, score) of squares, and one way everywhere."""
    stem_score = np.zeros((2, 2 * ROWS, 2 * COLUMNS), dtype=np.uint8)
    for kind, row, column, score in scores:
        stem_score[kind, row, column] = score
    way = np.full((2, ROWS, COLUMNS), way_px, dtype=np.float32)
    return PlantMaps(stem_score=stem_score, way_px=way)


def test_maps_without_a_score_hold_no_stem_and_no_owner() -> None:
    stems = find_stems(make_maps(), 0.0)
    assert stems.uv_px.shape == stems.kind_scores.shape == stems.squares.shape == (0, 2)
    owners = find_owners(make_maps(), stems, np.ones((4 * ROWS, 4 * COLUMNS), dtype=bool))
    assert (owners == -1).all()


def test_every_drawn_stem_is_found_within_its_square_with_the_score_of_its_class() -> None:
    plants = draw_plants(*FIELD, score=0.8).plants
    assert plants is not None
    stems = find_stems(plants, 0.2)
    assert len(stems.uv_px) == len(FIELD)
    for stem_px, (*_, plant) in zip(find_stems_px(*FIELD), FIELD, strict=True):
        gaps_px = np.hypot(*(stems.uv_px - stem_px).T)
        assert gaps_px.min() < 0.01
        weed, crop = stems.kind_scores[gaps_px.argmin()]
        assert max(weed, crop) == pytest.approx(0.8, abs=0.003)
        assert (crop > weed) == (plant == CROP)


def test_stems_come_with_their_squares_and_the_surest_first() -> None:
    stems = find_stems(make_maps((0, 3, 5, 90), (1, 10, 20, 200), way_px=1.0), 0.2)
    assert stems.squares.tolist() == [[10, 20], [3, 5]]
    assert stems.uv_px.tolist() == [[42.5, 22.5], [10.5, 6.5]]
    assert stems.kind_scores == pytest.approx(np.array([[0, 200], [90, 0]]) / 255)


def test_a_stem_below_the_least_score_is_none() -> None:
    maps = make_maps((0, 3, 5, 50), (1, 10, 20, 52))
    assert find_stems(maps, 0.2).squares.tolist() == [[10, 20]]


def test_a_way_to_elsewhere_does_not_move_a_stem_out_of_its_square() -> None:
    far = find_stems(make_maps((0, 3, 5, 255), way_px=20.0), 0.2)
    assert far.uv_px.tolist() == [[10.5, 6.5]]


def test_a_peak_of_equal_squares_is_one_stem() -> None:
    block = [(1, row, column, 255) for row in (4, 5) for column in (6, 7, 8)]
    assert len(find_stems(make_maps(*block), 0.2).uv_px) == 1


def test_a_peak_nearer_than_the_least_gap_to_a_surer_one_is_no_stem() -> None:
    maps = make_maps((0, 5, 5, 200), (1, 5, 10, 100), (1, 5, 16, 90))
    assert len(find_stems(maps, 0.2).uv_px) == 3
    maps.way_px[0, 2, 2], maps.way_px[0, 2, 5] = 2.0, -3.0  # 7 px apart now
    assert find_stems(maps, 0.2).squares.tolist() == [[5, 5], [5, 16]]


def test_a_peak_that_lost_to_a_surer_one_removes_no_third() -> None:
    maps = make_maps((0, 5, 5, 200), (0, 5, 9, 150), (0, 5, 13, 100))
    maps.way_px[0, 2, [2, 4, 6]] = 1.0, 0.0, -1.0  # at 10.5, 17.5 and 24.5 px
    assert find_stems(maps, 0.2).squares.tolist() == [[5, 5], [5, 13]]


def test_each_pixel_of_vegetation_belongs_to_the_plant_that_it_shows() -> None:
    class_map = draw_plants(*FIELD)
    assert class_map.plants is not None
    stems = find_stems(class_map.plants, 0.2)
    is_plant = class_map.class_id != SOIL
    owners = find_owners(class_map.plants, stems, is_plant)
    assert owners.shape == is_plant.shape
    assert (owners[~is_plant] == -1).all()
    truth_px = find_stems_px(*FIELD)[number_pixels(*FIELD)[is_plant]]
    assert (owners[is_plant] >= 0).all()
    off_px = np.hypot(*(stems.uv_px[owners[is_plant]] - truth_px).T)
    assert np.mean(off_px < 0.1) > 0.97  # a cell on the border of two plants is one's


def test_small_errors_of_the_ways_move_no_pixel_to_another_plant() -> None:
    class_map = draw_plants(*FIELD)
    assert class_map.plants is not None
    stems = find_stems(class_map.plants, 0.2)
    is_plant = class_map.class_id != SOIL
    before = find_owners(class_map.plants, stems, is_plant)
    class_map.plants.way_px[:] += np.random.default_rng(0).normal(
        0.0, 2.0, class_map.plants.way_px.shape
    )
    after = find_owners(class_map.plants, stems, is_plant)
    assert np.mean(before[is_plant] == after[is_plant]) > 0.99


@pytest.mark.parametrize(("way_px", "is_owned"), [(0.0, False), (-24.0, True), (-60.0, False)])
def test_vegetation_that_points_past_every_stem_has_no_owner(way_px: float, is_owned: bool) -> None:
    maps = make_maps((0, 10, 10, 255))
    maps.way_px[0, 5, 11] = way_px  # 24 px to the right of the stem
    is_plant = np.zeros((4 * ROWS, 4 * COLUMNS), dtype=bool)
    is_plant[21, 46] = True
    owners = find_owners(maps, find_stems(maps, 0.2), is_plant)
    assert owners[21, 46] == (0 if is_owned else -1)


H, W = 16, 24
CLASS_ID = np.full((H, W), SOIL, dtype=np.uint8)
CONFIDENCE = np.full((H, W), 255, dtype=np.uint8)
STEM_SCORE = np.arange(2 * 8 * 12, dtype=np.uint8).reshape(2, 8, 12)
WAY_PX = np.linspace(-9.0, 9.0, 2 * 4 * 6, dtype=np.float32).reshape(2, 4, 6)


def write_network(path: Path, **outputs: Any) -> Path:
    """Write a network that answers any picture with these arrays."""
    onnx = pytest.importorskip("onnx")
    image = onnx.helper.make_tensor_value_info(
        "image_rgb", onnx.TensorProto.UINT8, [1, "height_px", "width_px", 3]
    )
    tensors = {name: onnx.numpy_helper.from_array(value) for name, value in outputs.items()}
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Constant", [], [n], value=t) for n, t in tensors.items()],
        "answers",
        [image],
        [onnx.helper.make_tensor_value_info(n, t.data_type, t.dims) for n, t in tensors.items()],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)])
    model.ir_version = 9
    onnx.save(model, str(path))
    return path


def segment_with(path: Path, way_px: Any, stem_score: ByteArray = STEM_SCORE) -> PlantMaps | None:
    network = write_network(
        path, class_id=CLASS_ID, confidence=CONFIDENCE, stem_score=stem_score, way_px=way_px
    )
    segmenter = Segmenter(network)
    assert segmenter.finds_plants
    return segmenter.segment(np.zeros((32, 48, 3), dtype=np.uint8)).plants


def test_a_network_that_finds_plants_tells_them_in_its_class_map(tmp_path: Path) -> None:
    plants = segment_with(tmp_path / "plants.onnx", WAY_PX)
    assert plants is not None
    assert np.array_equal(plants.stem_score, STEM_SCORE)
    assert np.array_equal(plants.way_px, WAY_PX)


def test_a_network_of_classes_alone_tells_no_plants(tmp_path: Path) -> None:
    network = write_network(tmp_path / "classes.onnx", class_id=CLASS_ID, confidence=CONFIDENCE)
    segmenter = Segmenter(network)
    assert not segmenter.finds_plants
    assert segmenter.segment(np.zeros((32, 48, 3), dtype=np.uint8)).plants is None


@pytest.mark.parametrize(
    "outputs",
    [
        pytest.param({"stem_score": STEM_SCORE}, id="no ways"),
        pytest.param({"way_px": WAY_PX}, id="no scores"),
        pytest.param({"stem_score": STEM_SCORE[:, :, 1:], "way_px": WAY_PX}, id="narrow scores"),
        pytest.param({"stem_score": STEM_SCORE[:, ::2, ::2], "way_px": WAY_PX}, id="few scores"),
        pytest.param({"stem_score": STEM_SCORE, "way_px": WAY_PX[:1]}, id="one way"),
        pytest.param({"stem_score": STEM_SCORE, "way_px": WAY_PX.astype(np.float64)}, id="double"),
        pytest.param({"stem_score": STEM_SCORE / 255, "way_px": WAY_PX}, id="scores of 0 to 1"),
        pytest.param(
            {
                "stem_score": STEM_SCORE, "way_px": WAY_PX,
                "class_id": CLASS_ID[:, 1:], "confidence": CONFIDENCE[:, 1:],
            },
            id="no whole cells",
        ),
    ],
)  # fmt: skip
def test_plant_maps_of_another_shape_or_kind_are_refused(
    tmp_path: Path, outputs: dict[str, Any]
) -> None:
    answers = {"class_id": CLASS_ID, "confidence": CONFIDENCE} | outputs
    with pytest.raises(PerceptionError, match=r"odd\.onnx is no crop/weed network.*way_px"):
        Segmenter(write_network(tmp_path / "odd.onnx", **answers))


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_ways_that_are_no_numbers_are_found_out(tmp_path: Path, wrong: float) -> None:
    way_px = WAY_PX.copy()
    way_px[1, 2, 3] = wrong
    with pytest.raises(PerceptionError, match=r"spoilt\.onnx.*NaN"):
        segment_with(tmp_path / "spoilt.onnx", way_px)
