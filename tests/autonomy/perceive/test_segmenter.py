from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter, model_names, model_path
from agribot.core.errors import PerceptionError

MODEL = "agribot-sim"


def test_the_default_network_comes_with_the_package() -> None:
    assert MODEL in model_names()


def test_a_missing_model_names_the_file_the_known_models_and_the_remedy(tmp_path: Path) -> None:
    missing = tmp_path / "nothing.onnx"
    with pytest.raises(PerceptionError) as error:
        Segmenter(missing)
    for part in (str(missing), MODEL, "agribot train"):
        assert part in str(error.value)


def test_an_unknown_model_name_is_an_error() -> None:
    with pytest.raises(PerceptionError, match=r"agribot-moon\.onnx"):
        Segmenter("agribot-moon")


def test_a_broken_file_is_an_error(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"not a network")
    with pytest.raises(PerceptionError, match="not an ONNX file"):
        Segmenter(broken)


def test_an_absent_accelerator_is_named() -> None:
    with pytest.raises(PerceptionError, match="NoSuchProvider"):
        Segmenter(MODEL, providers=("NoSuchProvider",))


def test_the_map_covers_the_image_at_the_network_s_resolution() -> None:
    segmenter = Segmenter(MODEL)
    image_rgb = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    class_map = segmenter.segment(image_rgb)
    assert class_map.class_id.shape == class_map.confidence.shape == segmenter.map_shape
    assert class_map.class_id.dtype == class_map.confidence.dtype == np.uint8
    assert class_map.class_id.max() <= 2
    # The winner of three classes has at least a third of the probability.
    assert class_map.confidence.min() >= 84
    assert class_map.scale_px[0] * segmenter.map_shape[0] == pytest.approx(480)


def test_any_image_size_is_taken() -> None:
    segmenter = Segmenter(MODEL)
    image_rgb = np.zeros((240, 320, 3), dtype=np.uint8)
    assert segmenter.segment(image_rgb).class_id.shape == segmenter.map_shape


def test_the_same_image_gives_the_same_map() -> None:
    image_rgb = np.random.default_rng(1).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    one, other = (Segmenter(MODEL).segment(image_rgb) for _ in range(2))
    assert np.array_equal(one.class_id, other.class_id)
    assert np.array_equal(one.confidence, other.confidence)


def test_an_image_of_the_wrong_kind_is_refused() -> None:
    with pytest.raises(PerceptionError, match="uint8"):
        Segmenter(MODEL).segment(np.zeros((480, 640), dtype=np.uint8))


def test_weights_that_are_no_numbers_are_found_out(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    model = onnx.load(str(model_path(MODEL)))
    first = next(t for t in model.graph.initializer if len(t.dims) == 4)
    values = onnx.numpy_helper.to_array(first).copy()
    values[0] = np.nan
    first.CopyFrom(onnx.numpy_helper.from_array(values, first.name))
    spoilt = tmp_path / "spoilt.onnx"
    onnx.save(model, str(spoilt))
    with pytest.raises(PerceptionError, match=r"spoilt\.onnx.*NaN"):
        Segmenter(spoilt).segment(np.full((48, 64, 3), 90, np.uint8))


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    value = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Relu", ["x"], ["y"])],
        "other",
        [value("x", onnx.TensorProto.FLOAT, [1, 3, 8, 8])],
        [value("y", onnx.TensorProto.FLOAT, [1, 3, 8, 8])],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)])
    model.ir_version = 9
    other = tmp_path / "other.onnx"
    onnx.save(model, str(other))
    with pytest.raises(PerceptionError, match="no crop/weed network"):
        Segmenter(other)


def test_a_file_cut_short_is_an_error(tmp_path: Path) -> None:
    cut = tmp_path / "cut.onnx"
    cut.write_bytes(model_path(MODEL).read_bytes()[:100_000])
    with pytest.raises(PerceptionError, match=r"cut\.onnx"):
        Segmenter(cut)
