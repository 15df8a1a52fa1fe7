"""Figures of a training and of its scores, as PNG files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.evaluate import CLASS_NAMES
from agribot.lab.train.judged_figures import FIGURES
from agribot.lab.train.network_scores import NetworkScores, Thumbnail

# Red weed, green crop, blue soil, as in masks; darker, so that they read on white.
INK = ("#c62828", "#2e7d32", "#1e5fa8")
OVERLAY_RGB = np.array([[230, 40, 40], [40, 200, 60], [0, 0, 0]], dtype=np.float32)


def write_figures(network_scores: NetworkScores, folder: Path) -> list[Path]:
    """Draw confusion matrix, reliability, curves by class, IoU by image, and the worst images."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        _draw_confusion(network_scores, folder / "confusion.png"),
        _draw_reliability(network_scores, folder / "reliability.png"),
        _draw_precision_recall(network_scores, folder / "curves.png"),
        _draw_by_image(network_scores, folder / "images.png"),
        _draw_worst(network_scores.worst, folder / "worst.png"),
    ]


def _make_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=120, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path)
    return path


def _draw_confusion(network_scores: NetworkScores, path: Path) -> Path:
    figure, axes = _make_figure(4.6, 4.0)
    axis = axes[0, 0]
    counts = network_scores.confusion
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axis.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), count in np.ndenumerate(counts):
        colour = "white" if share[row, column] > 0.5 else "black"
        text = f"{share[row, column]:.1%}\n{count:,} px"
        axis.text(column, row, text, ha="center", va="center", color=colour, fontsize=8)
    axis.set_xticks(range(3), CLASS_NAMES)
    axis.set_yticks(range(3), CLASS_NAMES)
    axis.set_xlabel("said by the network")
    axis.set_ylabel("truth")
    axis.set_title(
        f"Pixels of {len(network_scores.images)} images, mIoU {network_scores.scores.miou:.3f}"
    )
    return _save(figure, path)


def _draw_reliability(network_scores: NetworkScores, path: Path) -> Path:
    figure, axes = _make_figure(4.6, 4.6, 2, 1)
    found = network_scores.reliability
    points = [
        (sure, right)
        for sure, right in zip(found.confidence, found.accuracy, strict=True)
        if sure is not None and right is not None
    ]
    above, below = axes[0, 0], axes[1, 0]
    above.plot([1 / 3, 1], [1 / 3, 1], color="#999999", lw=1, label="as sure as right")
    above.plot(*zip(*points, strict=True), "o-", ms=4, color=INK[2], label="this network")
    above.set_ylabel("share that is right")
    above.set_title(f"Reliability, calibration error {found.calibration_error:.3f}")
    above.legend(frameon=False)
    width = 1.0 / len(found.pixels)
    below.bar((np.arange(len(found.pixels)) + 0.5) * width, found.pixels, 0.9 * width, color=INK[2])
    below.set_yscale("symlog", linthresh=1.0)
    below.set_ylabel("pixels")
    below.set_xlabel("confidence")
    for axis in (above, below):
        axis.set_xlim(0.3, 1.01)
    return _save(figure, path)


def _draw_precision_recall(network_scores: NetworkScores, path: Path) -> Path:
    figure, axes = _make_figure(4.6, 4.0)
    axis = axes[0, 0]
    for kind, name, colour in zip(PlantClass, CLASS_NAMES, INK, strict=True):
        precision, recall = network_scores.precision_recall(kind)
        axis.plot(recall, precision, color=colour, lw=1.6, label=name)
        scores = network_scores.scores
        if scores.precision[name] is not None and scores.recall[name] is not None:
            axis.plot(scores.recall[name], scores.precision[name], "o", color=colour, ms=5)
    axis.set_xlim(0.0, 1.01)
    axis.set_ylim(0.0, 1.01)
    axis.set_xlabel("recall")
    axis.set_ylabel("precision")
    axis.set_title("Pixels by class; the dot is the class map")
    axis.legend(frameon=False, loc="lower left")
    return _save(figure, path)


def _draw_by_image(network_scores: NetworkScores, path: Path) -> Path:
    ordered = sorted(network_scores.images, key=lambda score: score.miou)
    figure, axes = _make_figure(max(5.0, 0.16 * len(ordered) + 2.0), 3.4)
    axis = axes[0, 0]
    for name, colour in zip(CLASS_NAMES, INK, strict=True):
        values = [np.nan if s.iou[name] is None else s.iou[name] for s in ordered]
        axis.plot(values, "o", ms=3.5, color=colour, label=name)
    axis.plot([score.miou for score in ordered], "-", color="black", lw=1, label="mean")
    if len(ordered) <= 60:
        names = [Path(score.name).stem for score in ordered]
        axis.set_xticks(range(len(ordered)), names, rotation=90, fontsize=6)
    axis.set_ylim(0.0, 1.02)
    axis.set_ylabel("IoU")
    axis.set_title("Image by image, worst first")
    axis.legend(frameon=False, ncols=4, loc="lower right")
    return _save(figure, path)


def _draw_worst(thumbnails: list[Thumbnail], path: Path) -> Path:
    figure, axes = _make_figure(9.0, 2.4 * max(1, len(thumbnails)), max(1, len(thumbnails)), 3)
    for row, one in zip(axes, thumbnails, strict=False):
        pictures = (
            one.image_rgb,
            tint(one.image_rgb, one.truth),
            tint(one.image_rgb, one.guess),
        )
        titles = (Path(one.name).name, "truth", f"network, mIoU {one.miou:.3f}")
        for axis, picture, title in zip(row, pictures, titles, strict=True):
            axis.imshow(picture)
            axis.set_title(title, fontsize=8)
    for axis in axes.flat:
        axis.set_axis_off()
    return _save(figure, path)


def tint(image_rgb: ByteArray, class_id: ByteArray, strength: float = 0.7) -> ByteArray:
    """Tint weeds red and crops green in an image (H, W, 3); soil stays as it is."""
    plants = class_id < 2
    colours = OVERLAY_RGB[np.minimum(class_id, 2)]
    mixed = image_rgb * (1.0 - strength) + colours * strength
    shown: ByteArray = np.where(plants[..., None], mixed, image_rgb).astype(np.uint8)
    return shown


def _draw_judged(axis: Any, rows: list[dict[str, str]]) -> None:
    """Draw what pictures set aside said, on an axis of its own, where there were any."""
    curves = {name: [row for row in rows if row.get(name)] for name in FIGURES}
    if not any(curves.values()):
        return
    beside = axis.twinx()
    for name, points, colour in zip(curves, curves.values(), INK, strict=False):
        steps, values = [int(p["step"]) for p in points], [float(p[name]) for p in points]
        if points:
            beside.plot(steps, values, color=colour, marker="o", ms=2.5, lw=1.0, label=name)
    beside.set_ylim(0.0, 1.0)
    beside.legend(loc="lower right", fontsize=7)


def write_curves(log: Path, path: Path) -> Path:
    """Draw the loss of every step of a training, its moving mean, and the figures of its judge."""
    with log.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    steps = np.array([int(row["step"]) for row in rows])
    loss = np.array([float(row["loss"]) for row in rows])
    figure, axes = _make_figure(6.0, 3.2)
    axis = axes[0, 0]
    axis.plot(steps, loss, color="#cccccc", lw=0.6)
    window = max(1, len(loss) // 60)
    smooth = np.convolve(loss, np.ones(window) / window, mode="valid")
    axis.plot(steps[window - 1 :], smooth, color=INK[2], lw=1.4)
    axis.set_ylabel("loss")
    axis.set_xlabel("step")
    _draw_judged(axis, rows)
    return _save(figure, path)
