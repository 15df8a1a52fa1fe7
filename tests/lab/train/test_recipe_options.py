from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.cli.data.train import run
from agribot.cli.data.train_options import apply_recipe_options, check_recipe_options
from agribot.core.errors import AgribotError, ConfigError
from agribot.lab.train.card import ModelCard
from agribot.lab.train.fit import Trainer, TrainingPlan
from tests.lab.train.command_line import parsed
from tests.lab.train.drawn_images import batch_of_four
from tests.lab.train.photo_folder import photo_folder


def words_for(photos: Path, out: Path) -> tuple[str, ...]:
    words = ("--data", "folder", "--data-dir", str(photos), "--model", "agribot-sim")
    return (*words, "--loss", "none", "--size", "64x64", "--steps", "1", "--out", str(out))


def test_the_loss_grows_with_the_weights_of_the_classes(tmp_path: Path) -> None:
    plan = TrainingPlan(steps=1, crop_px=64, bf16=False, overlap_loss="none")
    losses = []
    for name, weights in (("one", "1,2,0.6"), ("two", "2,4,1.2")):
        words = ("--model", "agribot-sim", "--class-weights", weights)
        args = parsed(*words, "--out", str(tmp_path / name))
        check_recipe_options(args)
        weighted = apply_recipe_options(plan, args)
        losses.append(float(Trainer(weighted, batch_of_four, args.out).advance()))
    assert losses[1] == pytest.approx(2.0 * losses[0], rel=1e-6)


def test_what_was_asked_for_stands_in_the_card_and_is_kept_to(tmp_path: Path) -> None:
    words = words_for(photo_folder(tmp_path / "photos", 3), tmp_path / "out")
    asked = ("--class-weights", "0.15,0.75,0.10", "--learning-rate", "0.001")
    assert run(parsed(*words, *asked)) == 0
    card = msgspec.json.decode((tmp_path / "out" / "agribot-sim.json").read_bytes(), type=ModelCard)
    assert (card.plan.class_weights, card.plan.overlap_loss) == ((0.15, 0.75, 0.1), "none")
    assert card.plan.learning_rate == 0.001
    assert " ".join(asked) in card.command
    with pytest.raises(AgribotError, match="other settings"):
        run(parsed(*words, *asked[:3], "0.002"))


@pytest.mark.parametrize("rate", ["0", "-0.001", "1.5", "nan", "inf"])
def test_a_learning_rate_out_of_range_is_named(rate: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--learning-rate"):
        run(parsed("--learning-rate", rate, "--out", str(tmp_path)))


@pytest.mark.parametrize("weights", ["1,2", "1,2,0.6,1", "1,two,3", "1,2,0", "1,2,-1", "nan,1,1"])
def test_weights_that_are_not_three_numbers_above_zero_are_named(
    weights: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=f"--class-weights {weights}: not weights"):
        run(parsed("--class-weights", weights, "--out", str(tmp_path)))
