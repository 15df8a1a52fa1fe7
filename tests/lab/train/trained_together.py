"""Started by torchrun, or alone: trains a small network on the same images in each case.

`python -m tests.lab.train.trained_together OUT.pt`, or `main` where its network is known: with
several processes each takes its share of every batch, alone it takes them all. Fails where a
thread of the others' meeting outlives it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from agribot.lab.train.architectures import ARCHITECTURES, Architecture
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.fit import Trainer, TrainingPlan
from agribot.lab.train.processes import join_group, leave_group
from tests.lab.train.drawn_images import batch_of_four

IMAGES, STEPS = 4, 12


def plain() -> nn.Module:
    """Without normalisation, whose statistics would be those of each process's own images."""
    return nn.Sequential(nn.Conv2d(3, 8, 3, padding=1), nn.ReLU(), nn.Conv2d(8, 3, 1))


PLAIN = Architecture(plain, centred_rgb, "of this test")


def main(out: Path) -> None:
    torch.set_num_threads(1)
    group = join_group("cpu")
    step = 0

    def share(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        nonlocal step
        images, labels = batch_of_four(np.random.default_rng(step))
        step += 1
        own = slice(group.rank, None, group.size)
        return images[own], labels[own]

    plan = TrainingPlan(
        steps=STEPS, bf16=False, model="plain", overlap_loss="none", processes=group.size
    )
    trainer = Trainer(plan, share, out.parent / f"{out.stem}-training", group)
    average = trainer.run(lambda text: None).state_dict()
    torch.save(average, out.with_name(f"{out.stem}-{group.rank}.pt"))
    leave_group()
    left = sorted(name for name in thread_names() if "gloo" in name)
    if left:
        sys.exit(f"the meeting is over, its threads go on: {', '.join(left)}")


def thread_names() -> list[str]:
    """Of this process, those of libraries too."""
    return [(task / "comm").read_text().strip() for task in Path("/proc/self/task").iterdir()]


if __name__ == "__main__":
    ARCHITECTURES["plain"] = PLAIN
    main(Path(sys.argv[1]))
