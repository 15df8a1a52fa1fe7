from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.cli.main import main
from agribot.lab.train.export import export_onnx
from agribot.lab.train.export_choice import Candidate, Trial, choose_candidate, list_sizes
from agribot.lab.train.network import CropWeedNet
from tests.lab.train.changed_norms import change_norms
from tests.lab.train.drawn_images import drawn_image
from tests.lab.train.photo_folder import photo_folder


def make(miou: float, cpu_ms: float) -> Candidate:
    return Candidate(Path("a.onnx"), 96, 128, "fp32", cpu_ms, miou)


@pytest.mark.parametrize(
    ("most_loss", "cpu_ms"), [(0.0, 120.0), (0.003, 70.0), (0.03, 30.0), (0.5, 10.0)]
)
def test_the_cheapest_that_is_good_enough_is_chosen(most_loss: float, cpu_ms: float) -> None:
    tried = [make(0.880, 120.0), make(0.878, 70.0), make(0.86, 30.0), make(0.5, 10.0)]
    assert choose_candidate(tried, most_loss).cpu_ms == cpu_ms


def test_a_costly_file_that_is_worse_is_never_chosen() -> None:
    assert choose_candidate([make(0.85, 300.0), make(0.88, 120.0)], 0.05).cpu_ms == 120.0


def test_sizes_are_those_that_a_network_can_have() -> None:
    sizes = list_sizes((608, 800))
    assert (608, 800) in sizes and len(sizes) == 5
    assert all(height % 32 == 0 and width % 32 == 0 for height, width in sizes)
    assert all(abs(width / height / (800 / 608) - 1.0) < 0.1 for height, width in sizes)
    assert list_sizes((32, 32))[0] == (32, 32)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("net") / "net.onnx"
    export_onnx(change_norms(CropWeedNet()), path, 64, 96)
    return path


def test_every_file_that_was_tried_is_of_its_size_and_judged_on_all_pictures(
    weights: Path, tmp_path: Path
) -> None:
    pairs = [drawn_image(np.random.default_rng(index)) for index in range(2)]
    told: list[str] = []
    trial = Trial(weights, tmp_path, pairs, lambda one: float(one.map_shape[1]), told.append)
    trial.try_sizes()
    trial.try_eight_bits(trial.tried[-1], [image_rgb for image_rgb, _ in pairs])
    assert len(told) == len(trial.tried) >= 3
    for one in trial.tried:
        assert Segmenter(one.path).map_shape == (one.height_px, one.width_px)
        assert one.cpu_ms == one.width_px and 0.0 < one.miou < 1.0
    assert (trial.tried[-1].precision, trial.tried[-2].precision) == ("int8", "fp32")


def test_the_command_writes_the_file_it_chose(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = photo_folder(tmp_path / "photos", 2), tmp_path / "best.onnx"
    words = ["export", str(weights), "-o", str(out), "--auto", "--most-loss", "1", "--json"]
    assert main([*words, "--judge", str(folder), "--data", "cwfid"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    cheapest = min(result["tried"], key=lambda one: one["cpu_ms"])
    assert result["chosen"] == cheapest["path"]
    assert Segmenter(out).map_shape == (cheapest["height_px"], cheapest["width_px"])


@pytest.mark.parametrize(
    "more", [(), ("--judge", ".", "--size", "64x64"), ("--judge", ".", "--precision", "fp16")]
)
def test_what_cannot_be_chosen_is_said(
    more: tuple[str, ...], weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(weights), "-o", str(tmp_path / "a.onnx"), "--auto"]
    assert main([*words, *more]) == 2
    assert "--judge FOLDER" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("more", [(), ("--auto", "--data", "cwfid", "--judge", "PHOTOS")])
def test_a_full_disk_is_told_with_the_file_that_found_no_room(
    more: tuple[str, ...], weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "full.onnx"
    out.symlink_to("/dev/full")
    folder = photo_folder(tmp_path / "photos", 1)
    words = [str(folder) if word == "PHOTOS" else word for word in more]
    assert main(["export", str(weights), "-o", str(out), *words]) == 2
    assert f"cannot write {out}: No space left on device" in capsys.readouterr().err


def test_a_network_of_eight_bits_is_made_into_no_other_and_replaces_nothing(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images, out = photo_folder(tmp_path / "photos", 1) / "images", tmp_path / "small.onnx"
    words = ["-o", str(out), "--calibrate", str(images), "--precision"]
    assert main(["export", str(weights), *words, "int8"]) == 0
    whole = out.read_bytes()
    for precision in ("int8", "fp16"):
        assert main(["export", str(out), *words, precision]) == 2
        assert "has 8-bit numbers already" in capsys.readouterr().err
        assert out.read_bytes() == whole
