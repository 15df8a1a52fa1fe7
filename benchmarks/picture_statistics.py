"""How pictures of two kinds differ: a table of light, colour, sharpness and plants for each folder.

    python benchmarks/picture_statistics.py FOLDER... [--drawn N]

A folder holds pictures, or `images/` with them. With --drawn the table also has lines of pictures
that the simulator draws to train on, N of each kind.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from agribot.core.messages import ByteArray
from agribot.lab.train.farm import draw_row_crop
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.simulated import draw_front, draw_random_field, draw_seedlings
from agribot.sim.random_scenes import DENSE

WIDTH_PX = 640
SUFFIXES = {".jpg", ".jpeg", ".png"}
LEAST_GREENNESS = 0.1  # excess green of a plant's pixels
DARK, BRIGHT = 8, 247  # grey levels beyond which a pixel counts as clipped
DRAWN: dict[str, Callable[[np.random.Generator, int], Iterator[DrawnView]]] = {
    "masts": partial(draw_random_field, variety=DENSE),
    "rows": partial(draw_row_crop, variety=DENSE),
    "seedlings": draw_seedlings,
    "front": draw_front,
}


def read_pictures(folder: Path) -> Iterator[ByteArray]:
    inside = folder / "images" if (folder / "images").is_dir() else folder
    for path in sorted(one for one in inside.iterdir() if one.suffix.lower() in SUFFIXES):
        picture = cv2.imread(str(path))
        if picture is not None:
            yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def draw_pictures(kind: str, count: int) -> Iterator[ByteArray]:
    for index in range(count):
        for view in DRAWN[kind](np.random.default_rng([17, index]), 1):
            yield view.image_rgb


def measure(image_rgb: ByteArray) -> dict[str, float]:
    """Measure one picture (height, width, 3), made WIDTH_PX wide."""
    height_px = round(image_rgb.shape[0] * WIDTH_PX / image_rgb.shape[1])
    image = cv2.resize(image_rgb, (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
    rgb = image.astype(np.float64)
    grey, total = rgb.mean(axis=2), rgb.sum(axis=2) + 1e-6
    is_plant = (2.0 * rgb[..., 1] - rgb[..., 0] - rgb[..., 2]) / total > LEAST_GREENNESS
    soil, leaf = rgb[~is_plant], rgb[is_plant]
    fine = grey - cv2.GaussianBlur(grey, (0, 0), 1.5)
    return {
        "soil r/g": _divide(soil, 0, 1),
        "soil b/g": _divide(soil, 2, 1),
        "leaf r/g": _divide(leaf, 0, 1),
        "leaf b/g": _divide(leaf, 2, 1),
        "soil grey": float(soil.mean()) if len(soil) else np.nan,
        "leaf grey": float(leaf.mean()) if len(leaf) else np.nan,
        "soil std": float(grey[~is_plant].std()) if len(soil) else np.nan,
        "fine std": float(fine[~is_plant].std()) if len(soil) else np.nan,
        "dark %": 100.0 * float((grey < DARK).mean()),
        "clipped %": 100.0 * float((rgb.max(axis=2) > BRIGHT).mean()),
        "plants %": 100.0 * float(is_plant.mean()),
    }


def _divide(pixels: ByteArray, one: int, other: int) -> float:
    """Divide the mean of a channel by that of another; NaN without pixels."""
    return float(pixels[:, one].mean() / pixels[:, other].mean()) if len(pixels) else np.nan


def summarise(pictures: Iterable[ByteArray]) -> dict[str, str]:
    """Make the middle and the range from the 5th to the 95th percentile of each figure."""
    measured = [measure(picture) for picture in pictures]
    cells = {"pictures": str(len(measured))}
    for name in measured[0] if measured else ():
        low, middle, high = np.nanpercentile([one[name] for one in measured], (5, 50, 95))
        cells[name] = f"{middle:.2f} ({low:.2f}-{high:.2f})"
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--drawn", type=int, default=0, help="pictures to draw of each kind")
    args = parser.parse_args()
    lines = {folder.name: summarise(read_pictures(folder)) for folder in args.folders}
    for kind in DRAWN if args.drawn else ():
        lines[f"drawn {kind}"] = summarise(draw_pictures(kind, args.drawn))
    names = list(dict.fromkeys(name for cells in lines.values() for name in cells))
    table = [["set", *names], ["---"] * (len(names) + 1)]
    table += [[title, *(cells.get(name, "") for name in names)] for title, cells in lines.items()]
    sys.stdout.write("".join(f"| {' | '.join(cells)} |\n" for cells in table))


if __name__ == "__main__":
    main()
