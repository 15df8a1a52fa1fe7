from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.cli.data.train import keep_temperatures, run
from agribot.cli.data.train_options import check_recipe_options
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.lab.bench import plant_scenes
from agribot.lab.bench.plant_scenes import SCENES
from agribot.lab.train.calibration import AS_TRAINED, Temperatures
from agribot.lab.train.card import ModelCard
from agribot.lab.train.export import export_onnx, read_temperatures
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.photo_source import make_photo_source
from agribot.lab.train.plant_network import PlantNet
from agribot.lab.train.plant_targets import (
    HEAT_WEIGHT,
    LABEL,
    MAPS,
    WAY,
    WAY_UNIT_PX,
    WAY_WEIGHT,
    join_heat,
    join_labels,
)
from agribot.lab.train.resizing import resize_network
from agribot.lab.train.start import start_from
from tests import nightly
from tests.lab.train.changed_norms import change_norms
from tests.lab.train.command_line import parsed
from tests.lab.train.drawn_images import drawn_image
from tests.lab.train.photo_folder import photo_folder

PLANTS = ("--model", "agribot-plants")
MILD = Temperatures(weed=1.7, crop=1.5, soil=1.2)


def draw_batch(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    images = [torch.from_numpy(drawn_image(rng)[0]).permute(2, 0, 1) for _ in range(2)]
    target = torch.from_numpy(rng.random((2, MAPS, 24, 32), dtype=np.float32))
    target[:, LABEL] = torch.from_numpy(rng.integers(3, size=target[:, LABEL].shape)).float()
    return torch.stack(images).float(), target


def draw_image() -> ByteArray:
    return drawn_image(np.random.default_rng(7))[0]


@pytest.fixture(scope="module")
def start_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("start") / "start.onnx"
    export_onnx(change_norms(PlantNet()), path, 96, 128, temperatures=MILD)
    return path


def learn(folder: Path, start: Path, *, keeps_classes: bool = False) -> tuple[nn.Module, set[str]]:
    """Train three steps; which of the two parts of the network changed."""
    plan = TrainingPlan(
        steps=3, crop_px=96, model="agribot-plants", bf16=False, keeps_classes=keeps_classes
    )
    trainer = Trainer(plan, draw_batch, folder, start=start)
    before = {name: value.clone() for name, value in trainer.network.state_dict().items()}
    network = trainer.run(lambda line: None)
    changed = {
        name.split(".")[0]
        for name, value in network.state_dict().items()
        if not torch.equal(value, before[name])
    }
    return network, changed


def test_classes_and_stems_learn_together(tmp_path: Path, start_file: Path) -> None:
    assert learn(tmp_path, start_file)[1] == {"classes", "plants"}


def test_stems_alone_learn_where_the_classes_are_to_be_kept(
    tmp_path: Path, start_file: Path
) -> None:
    network, changed = learn(tmp_path, start_file, keeps_classes=True)
    assert changed == {"plants"}
    temperatures = read_temperatures(start_file)
    assert temperatures == MILD
    export_onnx(network, tmp_path / "plants.onnx", 96, 128, temperatures=temperatures)
    one = Segmenter(start_file).segment_pixels(draw_image())
    other = Segmenter(tmp_path / "plants.onnx").segment_pixels(draw_image())
    # Its weights are stored in 16 bits: probabilities move a little, and ties may fall otherwise.
    steps = one.confidence.astype(int) - other.confidence.astype(int)  # of 1/255
    assert np.abs(steps).max() <= 2
    assert (one.class_id == other.class_id).mean() > 0.99
    assert np.abs(one.confidence.astype(int) - other.confidence).max() <= 2


def test_the_file_answers_with_the_stems_and_ways_of_the_network(tmp_path: Path) -> None:
    torch.manual_seed(5)
    network, image_rgb = PlantNet().eval(), draw_image()
    with torch.no_grad():
        network.plants.decoder.head.weight.mul_(20.0)
    export_onnx(network, tmp_path / "net.onnx", 96, 128)
    segmenter = Segmenter(tmp_path / "net.onnx")
    assert segmenter.finds_plants
    found = segmenter.segment(image_rgb).plants
    with torch.inference_mode():
        _, maps = network(centred_rgb(torch.from_numpy(image_rgb).permute(2, 0, 1)[None]))
    assert found is not None and found.stem_score.shape == (2, 48, 64)
    np.testing.assert_allclose(
        found.stem_score / 255.0, join_heat(maps)[0].sigmoid().numpy(), atol=2.1 / 255.0
    )
    np.testing.assert_allclose(found.way_px, WAY_UNIT_PX * maps[0, WAY].numpy(), atol=0.3)


def test_a_file_with_plants_can_be_resized_and_begun_with(tmp_path: Path) -> None:
    first = change_norms(PlantNet()).eval()
    path = tmp_path / "net.onnx"
    export_onnx(first, path, 96, 128)
    again = PlantNet()
    start_from(path, again, torch.randn(4, 3, 96, 128))
    x = torch.randn(1, 3, 96, 128)
    with torch.inference_mode():
        for one, other in zip(first(x), again.eval()(x), strict=True):
            assert torch.allclose(one, other, rtol=0.01, atol=0.02)
    (tmp_path / "big.onnx").write_bytes(resize_network(path, 128, 160))
    plants = Segmenter(tmp_path / "big.onnx").segment(draw_image()).plants
    assert plants is not None and plants.way_px.shape == (2, 32, 40)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--keep-classes",), "--start agribot-plants"),
        (("--keep-classes", "--start", "random"), "--start agribot-plants"),
        (("--start", "agribot-plants", "--precision", "int8"), "--precision int8"),
    ],
)
def test_what_no_plants_can_be_learned_from_is_refused(
    words: tuple[str, ...], reason: str, tmp_path: Path
) -> None:
    few = ("--images", "1", "--row-images", "0", "--turn-images", "0", "--test-images", "1")
    with pytest.raises(ConfigError, match=reason):
        run(parsed(*PLANTS, *words, *few, "--steps", "1", "--out", str(tmp_path)))


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--start", "agribot-sim"), "--start agribot-plants"),
        (("--start", "random"), "--start agribot-plants"),
        (("--start", "agribot-plants", "--keep-classes"), "nothing but classes"),
    ],
)
def test_photographs_teach_no_stems_to_weights_that_find_none(
    words: tuple[str, ...], reason: str, tmp_path: Path
) -> None:
    photos = ("--data", "cwfid", "--data-dir", str(tmp_path))
    with pytest.raises(ConfigError, match=reason):
        run(parsed(*PLANTS, *photos, *words, "--out", str(tmp_path / "out")))


@nightly.by_day(
    "test_classes_and_stems_learn_together",
    "test_stems_alone_learn_where_the_classes_are_to_be_kept",
)
def test_photographs_teach_classes_and_drawn_fields_keep_the_stems(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    words = ("--data", "cwfid", "--data-dir", str(folder), "--start", "agribot-plants")
    few = ("--with-sim", "2", "--crop-px", "96", "--train-width", "128", "--out", str(tmp_path))
    args = parsed(*PLANTS, *words, *few)
    check_recipe_options(args)
    source = make_photo_source(args, lambda line: None)
    images, target = source.batches(np.random.default_rng(2))
    assert images.shape == (8, 3, 96, 96) and target.shape == (8, MAPS, 24, 24)
    photos, drawn = target[:6], target[6:]
    assert not photos[:, WAY_WEIGHT].any() and not photos[:, HEAT_WEIGHT].any()
    assert drawn[:, WAY_WEIGHT].any() and drawn[:, HEAT_WEIGHT].any()
    assert set(np.unique(join_labels(photos).numpy())) <= {0, 1, 2}
    plan = msgspec.structs.replace(source.recipe, steps=1, model="agribot-plants", bf16=False)
    trainer = Trainer(plan, source.batches, tmp_path, start=args.start)
    assert math.isfinite(float(trainer.advance()))


def test_classes_that_are_kept_keep_their_temperature(tmp_path: Path) -> None:
    args = parsed(*PLANTS, "--keep-classes", "--start", "agribot-plants", "--out", str(tmp_path))
    check_recipe_options(args)
    kept = keep_temperatures(args)
    assert kept == read_temperatures(model_path("agribot-plants")) != AS_TRAINED
    assert "--keep-classes" in args.recipe_words and args.asked["keeps_classes"]


@nightly.by_day(
    "tests/lab/train/test_train_command.py::"
    "test_one_command_goes_from_nothing_to_weights_with_a_card",
    "test_classes_and_stems_learn_together",
    "test_the_file_answers_with_the_stems_and_ways_of_the_network",
    "tests/lab/bench/test_plant_benchmark.py::test_the_command_prints_and_writes_the_figures",
)
@pytest.mark.slow
def test_one_command_draws_fields_and_makes_weights_that_find_plants(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The card of the network that comes with the program has all scenes: test_plants_model.py.
    judged = {name: SCENES[name] for name in ("beet-25-25", "beet-7-9", "weeds-20")}
    monkeypatch.setattr(plant_scenes, "SCENES", judged)
    words = ("--variety", "dense", "--images", "2", "--row-images", "1", "--turn-images", "0")
    more = ("--usual-images", "2", "--seedling-images", "1", "--front-images", "2")
    batch = ("--batch-size", "3", "--crop-px", "96")
    few = [*more, *batch, "--test-images", "1", "--steps", "2", "--out", str(tmp_path)]
    assert run(parsed(*PLANTS, *words, *few, "--validate", "2")) == 0
    weights = tmp_path / "agribot-plants.onnx"
    card = msgspec.json.decode(weights.with_suffix(".json").read_bytes(), type=ModelCard)
    assert card.test.keys() == {
        "random-fields", "farm", "row-crops", "turns", "dense-fields", "dense-rows",
    }  # fmt: skip
    assert card.plants.keys() == {*judged, "all"}
    assert card.plants["all"].crops_truth > 50 and card.plants["beet-25-25"].crops_truth > 0
    assert card.kept_temperatures is None and card.calibration is not None
    assert read_temperatures(weights) == card.calibration.temperatures
    told = weights.with_suffix(".md").read_text(encoding="utf-8")
    assert "| beet-25-25 |" in told and "over the pixels taken for plants" in told
    assert "--validate 2" in card.command and card.train_images == 7
    assert "--usual-images 2 --seedling-images 1 --front-images 2" in card.command
    assert "--batch-size 3" in card.command and "young carrots" in card.data
    assert "valid_stem_f1" in capsys.readouterr().err
