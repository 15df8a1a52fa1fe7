"""A network that learns photographs keeps its first answers to drawn images."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from torch import nn

from agribot.cli.data.train import run
from agribot.core.errors import ConfigError
from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.memory import FirstAnswers
from agribot.lab.train.plant_network import PlantNet
from agribot.lab.train.plant_targets import HEAT_WEIGHT, MAPS
from tests.lab.train.command_line import parsed

PLAN = TrainingPlan(steps=2, model="agribot-plants", bf16=False, warmup_steps=1)


def draw_pair(rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw a photograph, which no stem counts in, and a drawn image."""
    x = torch.from_numpy(rng.uniform(0.0, 255.0, (2, 3, 64, 64)).astype(np.float32))
    target = torch.zeros((2, MAPS, 16, 16))
    target[1, HEAT_WEIGHT] = 1.0
    return x, target


@torch.no_grad()
def move(network: nn.Module) -> None:
    for weight in network.parameters():
        weight.add_(0.02)


@torch.no_grad()
def test_only_answers_to_drawn_images_that_have_changed_are_lost() -> None:
    network = PlantNet().eval()
    first = FirstAnswers(network)
    x, target = draw_pair(np.random.default_rng(0))
    assert float(first.lose(x, network(x), target, bf16=False)) == pytest.approx(0.0, abs=1e-6)
    move(network)
    moved = network(x)
    drawn = float(first.lose(x, moved, target, bf16=False))
    assert drawn > 1e-3
    alone = (moved[0][1:], moved[1][1:])
    assert float(first.lose(x[1:], alone, target[1:], bf16=False)) == pytest.approx(drawn, rel=1e-4)
    photographs = torch.zeros_like(target)
    assert float(first.lose(x, moved, photographs, bf16=False)) == 0.0


def test_a_training_adds_what_is_lost_by_its_weight(tmp_path: Path) -> None:
    losses = []
    for weight in (0.0, 1.0, 3.0):
        plan = msgspec.structs.replace(PLAN, remembers=weight, keeps_norms=True)
        trainer = Trainer(plan, draw_pair, tmp_path)
        trainer.network.eval()
        move(trainer.network)
        losses.append(float(trainer.advance()))
    assert losses[2] - losses[0] == pytest.approx(3.0 * (losses[1] - losses[0]), rel=1e-3)
    assert losses[1] > losses[0] + 1e-3


def test_normalisations_keep_their_statistics_where_they_are_to(tmp_path: Path) -> None:
    kept = {}
    for keeps in (False, True):
        plan = msgspec.structs.replace(PLAN, keeps_norms=keeps)
        trained = Trainer(plan, draw_pair, tmp_path / str(keeps)).run(lambda _text: None)
        means = [value for name, value in trained.state_dict().items() if "running_mean" in name]
        kept[keeps] = all(bool((mean == 0.0).all()) for mean in means)
    assert kept == {False: False, True: True}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--keep-norms",), "--keep-norms: keeps those of --start"),
        (("--remember", "1"), "--remember 1: is for photographs"),
        (("--remember", "-1"), "--remember -1: out of range; give at least 0"),
    ],
)
def test_nothing_is_kept_where_there_is_nothing_to_keep(
    words: tuple[str, ...], reason: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=reason):
        run(parsed(*words, "--steps", "1", "--out", str(tmp_path)))
