"""Five-fold cross-validation of the networks on a folder of photographs, one table at the end.

Every network is trained once for each fold and judged on the pictures that it never saw; the
confusion matrices of all folds are pooled at the resolution of the labels. It goes on where it
was stopped, within a training too; --table prints the finished folds.

python benchmarks/cross_validation.py DIR [--out FOLDER] [--networks agribot-s,...] [--steps N]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.lab.train.card import ModelCard
from agribot.lab.train.evaluate import CLASS_NAMES, compute_scores


class Recipe(NamedTuple):
    """Input of the network, width over which pictures are seen in training, crops and steps."""

    size: str
    train_width: int
    crop_px: int
    steps: int
    loss: str


# The original's networks with the original's loss; its U-Net looked at 128 px. Its Bonnet sees 2.4
# times the pixels of 600 batches of four whole pictures, which the original's own training counts.
RECIPES = {
    "original-unet": Recipe("128x96", 128, 96, 3500, "none"),
    "original-bonnet": Recipe("512x384", 512, 256, 2200, "none"),
    "agribot-s": Recipe("512x384", 512, 320, 2200, "lovasz"),
    "agribot-m": Recipe("1024x768", 640, 320, 2500, "lovasz"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="in the layout of --data")
    parser.add_argument("--data", default="cwfid")
    parser.add_argument("--out", type=Path, default=Path("cross-validation"))
    parser.add_argument("--networks", default=",".join(RECIPES))
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--only", type=int, help="train this fold only")
    parser.add_argument("--steps", type=int, help="instead of those of each recipe")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--table", action="store_true", help="train nothing")
    options = parser.parse_args()
    names = options.networks.split(",")
    folds = range(options.folds) if options.only is None else [options.only]
    for fold in () if options.table else folds:
        for name in names:
            _train(name, fold, options)
    for line in _format_table(names, options):
        sys.stdout.write(line + "\n")


def _find_folder(name: str, fold: int, options: argparse.Namespace) -> Path:
    place: Path = options.out / name / f"fold{fold}"
    return place


def _train(name: str, fold: int, options: argparse.Namespace) -> None:
    recipe, out = RECIPES[name], _find_folder(name, fold, options)
    if (out / f"{name}.json").is_file():
        return
    words = [
        *("--data", options.data, "--data-dir", str(options.folder), "--model", name),
        *("--loss", recipe.loss, "--size", recipe.size, "--train-width", str(recipe.train_width)),
        *("--crop-px", str(recipe.crop_px), "--steps", str(options.steps or recipe.steps)),
        *("--folds", str(options.folds), "--fold", str(fold), "--threads", str(options.threads)),
        *("--out", str(out)),
    ]
    subprocess.run([sys.executable, "-m", "agribot.cli", "train", *words], check=True)


def _format_table(names: list[str], options: argparse.Namespace) -> list[str]:
    lines = [
        "| network | input | folds | steps | CPU-minutes | mIoU | weed | crop | soil | each mIoU |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        paths = [
            _find_folder(name, fold, options) / f"{name}.json" for fold in range(options.folds)
        ]
        cards = [
            msgspec.json.decode(path.read_bytes(), type=ModelCard)
            for path in paths
            if path.is_file()
        ]
        if cards:
            lines.append(_format_line(name, cards))
    return lines


def _format_line(name: str, cards: list[ModelCard]) -> str:
    judged = [score for card in cards for score in card.test.values()]
    pooled = np.sum([score.confusion for score in judged], axis=0)
    result = compute_scores(pooled.astype(np.int64), sum(score.images for score in judged))
    minutes = sum(card.training_cpu_min for card in cards)
    cells = [f"{result.miou:.3f}", *(f"{result.iou[kind] or 0.0:.3f}" for kind in CLASS_NAMES)]
    cells.append(", ".join(f"{score.miou:.3f}" for score in judged))
    card = cards[0]
    return (
        f"| `{name}` | {card.input_width_px} x {card.input_height_px} | {len(cards)} | "
        f"{card.plan.steps} | {minutes:.0f} | " + " | ".join(cells) + " |"
    )


if __name__ == "__main__":
    main()
