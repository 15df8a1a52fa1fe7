from __future__ import annotations

import csv
import itertools
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
import torch
from torch import Tensor

from agribot.core.errors import AgribotError, RecordingError
from agribot.lab.train.fit import CHECKPOINT, LOG, Trainer, TrainingPlan, count_steps_within
from tests.lab.train.drawn_images import batch_of_four

PLAN = TrainingPlan(steps=20, batch_size=4, crop_px=64, bf16=False, checkpoint_every=10)


class Killed(RuntimeError):
    pass


def quiet(text: str) -> None:
    pass


def losses(folder: Path) -> list[float]:
    with (folder / LOG).open(encoding="utf-8") as file:
        return [float(row["loss"]) for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Tensor]]:
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("whole")
    return folder, Trainer(PLAN, batch_of_four, folder).run(quiet).state_dict()


def test_twenty_steps_lower_the_loss(uninterrupted: tuple[Path, dict[str, Tensor]]) -> None:
    curve = losses(uninterrupted[0])
    assert len(curve) == PLAN.steps
    assert np.mean(curve[-5:]) < 0.6 * np.mean(curve[:3])


def test_a_killed_training_ends_with_the_same_weights(
    tmp_path: Path, uninterrupted: tuple[Path, dict[str, Tensor]]
) -> None:
    drawn = 0

    def killed_at_step_17(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        nonlocal drawn
        drawn += 1
        if drawn == 17:
            raise Killed
        return batch_of_four(rng)

    with pytest.raises(Killed):
        Trainer(PLAN, killed_at_step_17, tmp_path).run(quiet)
    said: list[str] = []
    resumed = Trainer(PLAN, batch_of_four, tmp_path).run(said.append).state_dict()
    assert "step 10" in said[0]
    folder, whole = uninterrupted
    assert losses(tmp_path) == losses(folder)
    assert all(torch.equal(resumed[name], whole[name]) for name in whole)


def test_a_finished_training_is_not_repeated(
    uninterrupted: tuple[Path, dict[str, Tensor]],
) -> None:
    def no_batches(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        raise Killed

    folder, whole = uninterrupted
    again = Trainer(PLAN, no_batches, folder).run(quiet).state_dict()
    assert all(torch.equal(again[name], whole[name]) for name in whole)


def test_a_log_that_was_lost_is_written_anew_from_the_checkpoint(
    uninterrupted: tuple[Path, dict[str, Tensor]], tmp_path: Path
) -> None:
    folder, _ = uninterrupted
    shutil.copy(folder / CHECKPOINT, tmp_path)
    Trainer(PLAN, batch_of_four, tmp_path).run(quiet)
    assert losses(tmp_path) == losses(folder)


def test_a_folder_of_another_plan_is_refused(
    uninterrupted: tuple[Path, dict[str, Tensor]],
) -> None:
    other = msgspec.structs.replace(PLAN, seed=5)
    with pytest.raises(AgribotError, match="other settings"):
        Trainer(other, batch_of_four, uninterrupted[0]).run(quiet)


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.999, None])
def test_a_broken_checkpoint_is_named_with_what_to_do(
    kept: float | None, uninterrupted: tuple[Path, dict[str, Tensor]], tmp_path: Path
) -> None:
    whole = (uninterrupted[0] / CHECKPOINT).read_bytes()
    broken = b"junk\n" if kept is None else whole[: int(kept * len(whole))]
    (tmp_path / CHECKPOINT).write_bytes(broken)
    with pytest.raises(RecordingError, match=r"checkpoint\.pt is no whole checkpoint.* move it"):
        Trainer(PLAN, batch_of_four, tmp_path).run(quiet)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told_and_the_last_checkpoint_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = msgspec.structs.replace(PLAN, steps=4, checkpoint_every=2)
    said: list[str] = []

    def fill_the_disk(text: str) -> None:
        said.append(text)
        monkeypatch.setattr(Path, "write_bytes", lambda _, data: _write_to_full_disk(data))

    with pytest.raises(RecordingError, match="No space left on device; make room"):
        Trainer(short, batch_of_four, tmp_path).run(fill_the_disk)
    monkeypatch.undo()
    Trainer(short, batch_of_four, tmp_path).run(said.append)
    assert "going on from step 2" in said[1]


def _write_to_full_disk(data: bytes) -> None:
    with Path("/dev/full").open("wb", buffering=0) as file:
        file.write(data)


def test_minutes_give_the_steps_that_fit_in_and_fifty_at_least(tmp_path: Path) -> None:
    assert count_steps_within(1e-6, batch_of_four, PLAN, tmp_path) == 50
    assert count_steps_within(60.0, batch_of_four, PLAN, tmp_path) > 1000


def test_the_rate_warms_up_and_falls_to_almost_nothing() -> None:
    plan = TrainingPlan(steps=1000)
    rates = [plan.rate_at(step) for step in range(1000)]
    assert rates[0] < 0.02 * plan.learning_rate
    assert max(rates) == pytest.approx(plan.learning_rate, rel=0.05)
    assert rates[-1] < 0.01 * plan.learning_rate
    assert all(a >= b for a, b in itertools.pairwise(rates[100:]))
