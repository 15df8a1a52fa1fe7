"""The training loop: one plan, one seed, one result, also across a kill and a restart."""

from __future__ import annotations

import copy
import csv
import io
import math
import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from agribot.core.errors import AgribotError, RecordingError, explain_os_error
from agribot.core.whole_file import make_at_once
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.cpu_meter import CpuMeter
from agribot.lab.train.judged_figures import FIGURES
from agribot.lab.train.loader import BatchLoader, BatchSource
from agribot.lab.train.losses import CLASS_WEIGHTS, OVERLAP_LOSSES, mixed_loss, segmentation_loss
from agribot.lab.train.memory import FirstAnswers, keep_norms
from agribot.lab.train.plant_loss import joint_loss
from agribot.lab.train.plant_network import PlantNet
from agribot.lab.train.processes import TrainingGroup
from agribot.lab.train.standing import BestSoFar, Judge
from agribot.lab.train.start import IMAGENET, load_imagenet, start_from

Progress = Callable[[str], None]

CHECKPOINT = "checkpoint.pt"
LOG = "training.csv"
LOG_FIELDS = ("step", "learning_rate", "loss", "cpu_s", *FIGURES)
GRADIENT_LIMIT = 5.0
# Errors of reading a broken checkpoint, by where it is broken.
_BROKEN = (
    RuntimeError, EOFError, LookupError, TypeError, ValueError, pickle.UnpicklingError,
    msgspec.ValidationError,
)  # fmt: skip


class TrainingPlan(msgspec.Struct, frozen=True, kw_only=True):
    """All settings that decide the result of a training, besides the data."""

    steps: int
    seed: int = 0
    batch_size: int = 8
    crop_px: int = 320
    learning_rate: float = 3e-3
    weight_decay: float = 0.02
    warmup_steps: int = 100
    ema_decay: float = 0.995
    bf16: bool = True
    checkpoint_every: int = 100
    judge_every: int = 250
    model: str = "agribot-sim"
    class_weights: tuple[float, float, float] = CLASS_WEIGHTS
    row_weights: tuple[float, float, float] | None = None  # class weights of labels from rows
    # Method that made the weights from the labels; empty: they were given.
    class_weighting: str = ""
    overlap_loss: str = "dice"
    processes: int = 1  # processes that train together, each with a batch of its own
    start: str = ""  # weights to begin with: name and start of the SHA-256, or imagenet
    data: str = ""  # name of the photographs: another fold must not go on in the same folder
    keeps_classes: bool = False  # whether only the stems of a network that finds plants learn
    keeps_norms: bool = False  # whether normalisations keep the statistics that they begin with
    remembers: float = 0.0  # weight of the first answers on drawn images, 0: they do not count

    def rate_at(self, step: int) -> float:
        """Compute the rate: linear warm-up, then a cosine to 0.5 % of the top rate."""
        warm = min(1.0, (step + 1) / max(1, min(self.warmup_steps, self.steps // 5)))
        cosine = 0.5 * (1.0 + math.cos(math.pi * step / self.steps))
        return self.learning_rate * warm * (0.995 * cosine + 0.005)


class Trainer:
    """The network, its moving average and the optimiser between steps.

    Every step draws its batch from a generator of (seed, step, rank of the process): a training
    that was killed goes on from its checkpoint as if nothing had happened.
    """

    def __init__(
        self,
        plan: TrainingPlan,
        batches: BatchSource,
        folder: Path,
        group: TrainingGroup | None = None,
        start: Path | None = None,
        judge: Judge | None = None,
        workers: int = 0,
        meter: CpuMeter | None = None,
    ) -> None:
        """`meter` counts the CPU time of the whole process; left out, that from here on."""
        self.plan = plan
        self.meter = CpuMeter() if meter is None else meter
        self._judge = judge
        self._best = BestSoFar()
        self._crew = group or TrainingGroup()
        self.step = 0
        self._loader = BatchLoader(batches, plan.seed, self._crew.rank, plan.steps, workers)
        self._folder = folder
        self._rows: list[dict[str, float]] = []
        self._unread_losses: list[Tensor] = []
        self.device_name = self._crew.name_device()
        torch.manual_seed(plan.seed)
        self._features = find_architecture(plan.model).features
        self.network = find_architecture(plan.model).build()
        if plan.start == IMAGENET:
            load_imagenet(plan.model, self.network)
        self.network.to(self._crew.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        if start is not None:
            images, _ = batches(np.random.default_rng([plan.seed, 0]))
            start_from(start, self.network, self._features(images.to(self._crew.device)))
        if plan.keeps_classes and isinstance(self.network, PlantNet):
            self.network.keep_classes()
        self._first = FirstAnswers(self.network) if plan.remembers else None
        self.average = copy.deepcopy(self.network).eval()
        self._together = self._crew.average_gradients(self.network)
        self._optimiser = torch.optim.AdamW(
            _group_parameters(self.network, plan.weight_decay), plan.learning_rate
        )

    def run(self, progress: Progress) -> nn.Module:
        """Train up to the plan's last step; return the averaged network.

        Where a judge looked on, that is the averaged network of the step that it liked best.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        self._resume(progress)
        try:
            self._go_on(progress)
        finally:
            self._loader.close()
        self._together = self.network  # lets go of the other processes
        self._best.give_back(self.average)
        return self.average

    def _go_on(self, progress: Progress) -> None:
        self._together.train()
        if self.plan.keeps_norms:
            keep_norms(self.network)
        while self.step < self.plan.steps:
            loss = self.advance()
            self._note(loss)
            if self._judge and self._is_due(self.plan.judge_every):
                self._look(progress)
            if self._is_due(self.plan.checkpoint_every):
                self._read_losses()
                if self._crew.is_leader:
                    self._save()
                recent = [row["loss"] for row in self._rows[-50:]]
                progress(
                    f"step {self.step}/{self.plan.steps}  loss {sum(recent) / len(recent):.4f}  "
                    f"{self.meter.spent_s / 60.0:.1f} CPU-min"
                )

    def _is_due(self, every: int) -> bool:
        return self.step % every == 0 or self.step == self.plan.steps

    def _look(self, progress: Progress) -> None:
        """Judge the averaged network, and keep it if it is the best until now."""
        assert self._judge is not None
        judged = self._judge(self.average)
        self._rows[-1] |= judged
        self._best.consider(judged, self.step, self.average)
        figures = "  ".join(f"{name} {value:.4f}" for name, value in judged.items())
        progress(f"step {self.step}: {figures}; best at step {self._best.step}")

    def advance(self) -> Tensor:
        """Do one optimiser step; return its loss, on the device."""
        rate = self.plan.rate_at(self.step)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        # Whatever torch draws in a step, such as dropout, is the step's own after a restart too.
        rank, device = self._crew.rank, torch.device(self._crew.device)
        torch.manual_seed(self.plan.seed * 1_000_003 + self.step + rank * 1_000_000_007)
        images, truth = self._loader.take(self.step)
        x = self._features(images.to(device)).contiguous(memory_format=torch.channels_last)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.plan.bf16):
            answer = self._together(x)
        truth = truth.to(device)
        loss = self._compute_loss(answer, truth)
        if self._first is not None:
            forgotten = self._first.lose(x, answer, truth, bf16=self.plan.bf16)
            loss = loss + self.plan.remembers * forgotten
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), GRADIENT_LIMIT)
        self._optimiser.step()
        self.step += 1
        self._update_average()
        return loss.detach()

    def _compute_loss(self, answer: Tensor | tuple[Tensor, Tensor], truth: Tensor) -> Tensor:
        overlap = OVERLAP_LOSSES[self.plan.overlap_loss]

        def lose(logits: Tensor, label: Tensor) -> Tensor:
            weights, row_weights = self.plan.class_weights, self.plan.row_weights
            if row_weights is None:
                return segmentation_loss(logits, label, weights, overlap)
            return mixed_loss(logits, label, weights, row_weights, overlap)

        if isinstance(answer, tuple):
            logits, maps = answer
            return joint_loss(logits.float(), maps.float(), truth, lose)
        return lose(answer.float(), truth)

    def _update_average(self) -> None:
        # A short memory at first, so that the random start is forgotten.
        decay = min(self.plan.ema_decay, (1 + self.step) / (10 + self.step))
        averaged, current = self.average.state_dict(), self.network.state_dict()
        moving = [name for name, one in averaged.items() if one.dtype.is_floating_point]
        with torch.no_grad():
            update = get_ema_multi_avg_fn(decay)  # type: ignore[no-untyped-call]
            update([averaged[name] for name in moving], [current[name] for name in moving], 1)
            for name in averaged.keys() - moving:
                averaged[name].copy_(current[name])

    def _note(self, loss: Tensor) -> None:
        rate = self.plan.rate_at(self.step - 1)
        self._rows.append(
            {
                "step": self.step,
                "learning_rate": rate,
                "loss": math.nan,
                "cpu_s": round(self.meter.spent_s, 2),
            }
        )
        self._unread_losses.append(loss)

    def _read_losses(self) -> None:
        """Read what the last steps lost; a GPU is waited for."""
        if self._unread_losses:
            losses = torch.stack(self._unread_losses).tolist()
            for row, loss in zip(self._rows[-len(losses) :], losses, strict=True):
                row["loss"] = loss
            self._unread_losses.clear()

    def _save(self) -> None:
        state = {
            "plan": msgspec.to_builtins(self.plan),
            "step": self.step,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "rows": self._rows,
            "best": self._best.to_state(),
            "cpu_s": self.meter.spent_s,
            "device": self.device_name,
        }
        data = io.BytesIO()
        torch.save(state, data)
        with explain_os_error(
            f"cannot write into {self._folder}",
            "make room and give the same command again, which goes on from the last checkpoint",
        ):
            make_at_once(self._folder / CHECKPOINT, lambda path: path.write_bytes(data.getvalue()))
            make_at_once(self._folder / LOG, self._write_log)

    def _write_log(self, path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, LOG_FIELDS)
            writer.writeheader()
            writer.writerows(self._rows)

    def _resume(self, progress: Progress) -> None:
        state = load_checkpoint(self._folder)
        if state is None:
            return
        found = msgspec.convert(state["plan"], TrainingPlan)
        differing = [
            f"{name} {getattr(found, name)!r}, not {getattr(self.plan, name)!r}"
            for name in TrainingPlan.__struct_fields__
            if getattr(found, name) != getattr(self.plan, name)
        ]
        if differing:
            raise AgribotError(
                f"{self._folder} holds a training with other settings ({'; '.join(differing)}); "
                "give the same settings to go on with it, or another --out folder to start anew"
            )
        self.step = state["step"]
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._rows = state["rows"]
        self._best = BestSoFar.from_state(state.get("best", {}))
        self.meter.earlier_s = state["cpu_s"]
        self.device_name = state.get("device", self.device_name)
        # The log may be gone, or ahead of the checkpoint.
        make_at_once(self._folder / LOG, self._write_log)
        progress(f"going on from step {self.step} of {self._folder / CHECKPOINT}")


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """Load what an earlier call left in a folder; None where there is nothing.

    Raises: RecordingError: it is broken.
    """
    path = folder / CHECKPOINT
    if not path.is_file():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        msgspec.convert(state["plan"], TrainingPlan)
    except _BROKEN as error:
        raise RecordingError(
            f"{path} is no whole checkpoint, as after a full disk or a loss of power; move it away "
            "to train anew"
        ) from error
    return state


def count_steps_within(
    minutes: float,
    batches: BatchSource,
    plan: TrainingPlan,
    folder: Path,
    group: TrainingGroup | None = None,
) -> int:
    """Estimate the steps that fit into `minutes` of CPU time, from a few trial steps."""
    trial = Trainer(plan, batches, folder, group)
    trial.network.train()
    trial.advance().item()  # waits for a GPU
    started_s = time.process_time()
    for _ in range(3):
        trial.advance().item()
    step_s = (time.process_time() - started_s) / 3.0
    return max(50, int(minutes * 60.0 / step_s))


def _group_parameters(network: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """Separate the weights of convolutions, which decay, from biases and normalisation."""
    parameters = list(network.parameters())
    return [
        {"params": [p for p in parameters if p.ndim > 1], "weight_decay": weight_decay},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]
