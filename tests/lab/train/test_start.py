from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from agribot.core.errors import ConfigError, PerceptionError
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.export import export_onnx
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.network import CropWeedNet
from agribot.lab.train.start import start_from
from tests.lab.train.changed_norms import change_norms
from tests.lab.train.drawn_images import batch_of_four


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[CropWeedNet, Path]:
    network, path = change_norms(CropWeedNet()), tmp_path_factory.mktemp("start") / "net.onnx"
    export_onnx(network, path, 64, 64)
    return network, path


def test_a_network_started_from_a_file_answers_as_the_file(
    exported: tuple[CropWeedNet, Path],
) -> None:
    network, path = exported
    torch.manual_seed(9)
    other = CropWeedNet()
    start_from(path, other, torch.randn(4, 3, 64, 64))
    x = torch.randn(2, 3, 96, 64)
    with torch.inference_mode():
        assert torch.allclose(other.eval()(x), network(x), atol=1e-3)


def test_it_also_answers_so_with_the_statistics_of_the_batch_it_was_started_on(
    exported: tuple[CropWeedNet, Path],
) -> None:
    network, path = exported
    other, x = CropWeedNet(), torch.randn(4, 3, 64, 64)
    start_from(path, other, x)
    with torch.inference_mode():
        assert torch.allclose(other.train()(x), network(x), atol=1e-2)


def test_a_training_goes_on_from_the_weights_of_a_file(
    tmp_path: Path, exported: tuple[CropWeedNet, Path]
) -> None:
    network, path = exported
    plan = TrainingPlan(steps=1, crop_px=64, bf16=False)
    trainer = Trainer(plan, batch_of_four, tmp_path, start=path)
    images, _ = batch_of_four(np.random.default_rng(0))
    with torch.inference_mode():
        x = centred_rgb(images)
        assert torch.allclose(trainer.average(x), network(x), atol=1e-3)


@pytest.mark.parametrize("model", ["agribot-s", "original-bonnet"])
def test_a_file_of_another_network_is_refused(
    model: str, exported: tuple[CropWeedNet, Path]
) -> None:
    with pytest.raises(ConfigError, match="convolutions"):
        start_from(exported[1], find_architecture(model).build(), torch.zeros(1, 3, 64, 64))


def test_a_file_that_is_no_network_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"\x00\x01 no network")
    with pytest.raises(PerceptionError, match=r"broken\.onnx"):
        start_from(broken, CropWeedNet(), torch.zeros(1, 3, 64, 64))
