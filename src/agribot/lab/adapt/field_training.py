"""The training of an adaptation: pictures with rows as teacher, drawn plants to keep the stems."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from torch import nn

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.lab.adapt.balance import BalanceJudge
from agribot.lab.adapt.place_names import TaughtPicture
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.card import hash_file
from agribot.lab.train.export import export_onnx
from agribot.lab.train.fit import (
    Progress,
    Trainer,
    TrainingPlan,
    count_steps_within,
    load_checkpoint,
)
from agribot.lab.train.loader import BatchSource
from agribot.lab.train.networks import STRIDE_PX
from agribot.lab.train.photo_batches import ALONG_ROWS, PhotoBatches
from agribot.lab.train.photo_mixing import draw_plants, mix_with_plants
from agribot.lab.train.photographs import Pair, PairFiles
from agribot.lab.train.start import recognise_architecture

# Weights of weed, crop and soil: with equal ones everything becomes crop, since weeds between rows
# are few.
FIELD_WEIGHTS = (12.0, 1.0, 0.6)
BATCH_SIZE, CROP_PX, LEARNING_RATE, WARMUP_STEPS, EMA_DECAY = 6, 384, 1e-3, 30, 0.98
CHECKPOINT_EVERY = 25  # steps, after which the network is judged, too
LEARN_SHARE = 0.8  # share of a training's CPU time that learns; the rest judges
STEM_VIEWS, VIEWS_IN_BATCH = 32, 1  # drawn, from which a network that finds stems remembers them


class Budget(NamedTuple):
    """Budget of a training: CPU minutes, or steps where they are given."""

    minutes: float
    steps: int | None = None


class FieldTraining:
    """Begins with the weights of a network, and goes on where an earlier call was stopped."""

    def __init__(self, base: Path, folder: Path, seed: int) -> None:
        """Raise: ConfigError: a network that cannot be trained."""
        self._base, self._folder, self._seed = base, folder, seed
        self.model = recognise_architecture(base)

    @property
    def is_begun(self) -> bool:
        """Whether an earlier call has begun to learn, and so fixed the steps."""
        return load_checkpoint(self._folder) is not None

    def run(
        self,
        pairs: Sequence[Pair],
        choosing: Sequence[TaughtPicture],
        budget: Budget,
        size_px: tuple[int, int],
        out: Path,
        progress: Progress,
    ) -> Trainer:
        """Train on pairs and write the network for an input of (height, width) to `out`.

        It is that of the step, and with the balance of weed and crop, that names the pictures of
        `choosing` best.
        """
        plan = self._make_plan(pairs)
        batches = self._make_batches(pairs, plan, size_px, progress)
        plan = msgspec.structs.replace(plan, steps=self._count_steps(budget, batches, plan))
        features = find_architecture(self.model).features
        judge = BalanceJudge(choosing, size_px, features)
        trainer = Trainer(plan, batches, self._folder, start=self._base, judge=judge)
        network = trainer.run(progress)
        progress(f"logit of weed moved by {judge.balance(network):+.1f}")
        self._export(network, size_px, out)
        return trainer

    def _make_plan(self, pairs: Sequence[Pair]) -> TrainingPlan:
        return TrainingPlan(
            steps=1,
            seed=self._seed,
            batch_size=BATCH_SIZE,
            crop_px=CROP_PX,
            learning_rate=LEARNING_RATE,
            warmup_steps=WARMUP_STEPS,
            ema_decay=EMA_DECAY,
            checkpoint_every=CHECKPOINT_EVERY,
            judge_every=CHECKPOINT_EVERY,
            model=self.model,
            class_weights=FIELD_WEIGHTS,
            overlap_loss="lovasz",
            start=f"{self._base.stem} {hash_file(self._base)[:16]}",
            data=f"rows of {len(pairs)} pictures",
        )

    def _make_batches(
        self,
        pairs: Sequence[Pair],
        plan: TrainingPlan,
        size_px: tuple[int, int],
        progress: Progress,
    ) -> BatchSource:
        files = PairFiles(list(pairs))
        has_stems = find_architecture(self.model).finds_plants
        count = plan.batch_size - VIEWS_IN_BATCH * has_stems
        scale = size_px[1] / files[0][1].shape[1]
        photos = PhotoBatches(files, scale, count, plan.crop_px, view=ALONG_ROWS)
        if not has_stems:
            return photos
        drawn = argparse.Namespace(
            with_sim=STEM_VIEWS, seedling_images=0, front_images=0, usual_images=0,
            cache=None, out=self._folder, seed=self._seed, workers=0,
        )  # fmt: skip
        return mix_with_plants(photos, draw_plants(drawn, progress), VIEWS_IN_BATCH, plan)

    def _count_steps(self, budget: Budget, batches: BatchSource, plan: TrainingPlan) -> int:
        """Count the steps; those of a training under way stay as they are."""
        state = load_checkpoint(self._folder)
        if state is not None:
            return int(state["plan"]["steps"])
        if budget.steps is not None:
            return budget.steps
        return count_steps_within(LEARN_SHARE * budget.minutes, batches, plan, self._folder)

    def _export(self, network: nn.Module, size_px: tuple[int, int], out: Path) -> None:
        features = find_architecture(self.model).features
        export_onnx(network, out, *size_px, antialias=True, features=features)


def choose_size_px(base: Segmenter, pictures: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Choose (height, width) of a network's input: of the pictures' shape, and the base's area."""
    height, width = np.median(np.array(pictures), axis=0)
    ratio = min(1.0, math.sqrt(math.prod(base.map_shape) / (height * width)))
    rows, columns = (max(1, round(side * ratio / STRIDE_PX)) for side in (height, width))
    return rows * STRIDE_PX, columns * STRIDE_PX
