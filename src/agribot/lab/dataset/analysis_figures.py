"""Figures of what a set of images and masks holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from agribot.lab.dataset.analysis import GroupCounts, PictureCounts, SetAnalysis
from agribot.record.drawing import BLUE, GREEN, GREY, RED, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INKS = {"weed": RED, "crop": GREEN, "soil": BLUE}
BINS = 30
LEAST_SHARE = 1e-4  # least share of a class in a picture, on the axis of the histogram
MOST_NAMES = 40  # names of sets below an axis
WHOLE = "all"  # name of a set that is no part of a collection


def draw_figures(analysis: SetAnalysis, groups: Sequence[GroupCounts]) -> dict[str, Figure]:
    """Draw all figures, by the names of their files; only the first where no pair can be read."""
    figures = {"annotated": _draw_annotated(groups)}
    if analysis.pictures:
        figures["classes"] = _draw_classes(groups)
        figures["shares"] = _draw_shares(analysis.pictures)
        figures["greenness"] = _draw_greenness(analysis.pictures)
        figures["weed-places"] = _draw_places(analysis, 0, "weed", "Reds")
        figures["crop-places"] = _draw_places(analysis, 1, "crop", "Greens")
    return figures


def _draw_annotated(groups: Sequence[GroupCounts]) -> Figure:
    figure, axes = new_figure(11.0, 3.6)
    places = np.arange(len(groups))
    annotated = [one.annotated for one in groups]
    left = [one.images - one.annotated for one in groups]
    axes.bar(places, annotated, color=GREEN, label="annotated")
    axes.bar(places, left, bottom=annotated, color=GREY, hatch="///", label="without a mask")
    axes.set_ylabel("images")
    axes.locator_params(axis="y", integer=True)
    _name_groups(axes, groups)
    _add_legend(axes)
    return figure


def _draw_classes(groups: Sequence[GroupCounts]) -> Figure:
    figure, axes = new_figure(11.0, 3.6)
    counted = [one for one in groups if one.pictures]
    pixels = np.array([[one.weed_px, one.crop_px, one.soil_px] for one in counted], dtype=float)
    shares = 100.0 * pixels / np.maximum(pixels.sum(axis=1, keepdims=True), 1.0)
    places = np.arange(len(counted))
    for index, (name, ink) in enumerate(INKS.items()):
        axes.bar(places + 0.27 * (index - 1), shares[:, index], 0.25, color=ink, label=name)
    axes.set_yscale("log")
    axes.set_ylabel("% of the pixels")
    _name_groups(axes, counted)
    _add_legend(axes)
    return figure


def _draw_shares(pictures: Sequence[PictureCounts]) -> Figure:
    figure, axes = new_figure(11.0, 3.4)
    bins = 100.0 * np.geomspace(LEAST_SHARE, 1.0, BINS + 1)
    known = np.maximum([one.known_px for one in pictures], 1)
    for name, counts in (
        ("weed", [one.weed_px for one in pictures]),
        ("crop", [one.crop_px for one in pictures]),
    ):
        shares = 100.0 * np.array(counts) / known
        none = int((shares == 0.0).sum())
        shown = np.maximum(shares[shares > 0.0], bins[0])
        label = f"{name}; {none} pictures without"
        axes.hist(
            shown, bins.tolist(), histtype="step", linewidth=1.8, color=INKS[name], label=label
        )
    axes.set_xscale("log")
    axes.set(xlabel="% of the pixels of a picture", ylabel="pictures")
    _add_legend(axes)
    return figure


def _draw_greenness(pictures: Sequence[PictureCounts]) -> Figure:
    figure, axes = new_figure(11.0, 3.4)
    cover = [100.0 * (one.weed_px + one.crop_px) / max(1, one.known_px) for one in pictures]
    axes.plot(cover, [one.greenness for one in pictures], "o", markersize=4, color=GREEN, alpha=0.6)
    axes.set(xlabel="% of the pixels that are plants", ylabel="mean excess green")
    return figure


def _draw_places(analysis: SetAnalysis, index: int, name: str, colours: str) -> Figure:
    figure, axes = new_figure(5.4, 3.8)
    share = 100.0 * analysis.where[index] / len(analysis.pictures)
    shown = axes.imshow(share, cmap=colours, vmin=0.0, aspect="auto", extent=(0.0, 1.0, 1.0, 0.0))
    axes.grid(visible=False)
    axes.set(xlabel="left to right", ylabel="top to bottom", title=f"{name}, % of the pixels there")
    figure.colorbar(shown, ax=axes)
    return figure


def _name_groups(axes: Axes, groups: Sequence[GroupCounts]) -> None:
    if len(groups) <= MOST_NAMES:
        names = [one.group or WHOLE for one in groups]
        axes.set_xticks(
            range(len(groups)), names, rotation=30 if len(names) > 6 else 0, ha="center"
        )
    else:
        axes.set_xlabel(f"{len(groups)} sets, by name")


def _add_legend(axes: Axes) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, fontsize=9,
        borderaxespad=0.2,
    )  # fmt: skip
