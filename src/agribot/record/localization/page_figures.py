"""Figures of a log: map, offsets of the fixes, normalised innovations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from agribot.core.messages import FloatArray
from agribot.record.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, new_figure, sample_every
from agribot.record.localization.result import LocalizationRun

COLOURS = (BLUE, ORANGE)
NAMES = ("estimate", "with the changes")
ELLIPSES = 40  # circles of sigma along the way
LIMIT_NIS = 9.0  # 3 sigma, squared


def draw_map(runs: Sequence[LocalizationRun]) -> Figure:
    """Draw fixes and estimates, metres East and North of the first fix."""
    figure, axes = new_figure(10.0, 8.0)
    fixes = runs[0].fixes
    given = fixes[:, 6] > 0.0
    for rows, colour, label in (
        (fixes[given], GREY, "fix"), (fixes[~given], RED, "fix that was withheld"),
    ):  # fmt: skip
        if len(rows):
            points = sample_every(rows, 5000)
            axes.plot(points[:, 1], points[:, 2], ".", color=colour, markersize=4, label=label)
    for run, colour, name in zip(runs, COLOURS, NAMES, strict=False):
        if len(run.poses):
            _draw_way(axes, run.poses, colour, name)
    axes.set(xlabel="East of the first fix (m)", ylabel="North of the first fix (m)")
    axes.set_aspect("equal", adjustable="datalim")
    _place_legend(axes)
    return figure


def _draw_way(axes: Axes, poses: FloatArray, colour: str, name: str) -> None:
    way = sample_every(poses, 4000)
    axes.plot(way[:, 1], way[:, 2], color=colour, linewidth=1.8, label=name, zorder=4)
    axes.plot(
        *way[0, 1:3], "o", color=colour, markersize=9, markerfacecolor="white", zorder=5,
        label="where it began" if colour == BLUE else None,
    )  # fmt: skip
    for place in sample_every(poses, ELLIPSES):
        circle = Circle(
            (place[1], place[2]), place[4], facecolor=colour, edgecolor="none", alpha=0.12
        )
        axes.add_patch(circle)


def draw_offsets(runs: Sequence[LocalizationRun]) -> Figure:
    """Draw how far each fix lies off the estimate, with the 1 sigma of the pose and of the fix."""
    figure, axes = new_figure(11.0, 3.6)
    _shade_outages(axes, runs[0])
    for run, colour, name in zip(runs, COLOURS, NAMES, strict=False):
        fixes = sample_every(run.fixes, 4000)
        axes.plot(
            fixes[:, 0], fixes[:, 4], ".", color=colour, markersize=3.5, label=f"fix off {name}"
        )
        poses = sample_every(run.poses, 2000)
        axes.plot(
            poses[:, 0], poses[:, 4], color=colour, linewidth=1.4, alpha=0.8,
            label=f"1 sigma of {name}",
        )  # fmt: skip
    fixes = sample_every(runs[0].fixes, 2000)
    axes.plot(
        fixes[:, 0], fixes[:, 3], color=GREEN, linewidth=1.2, label="1 sigma the receiver states"
    )
    axes.set(xlabel="Time (s)", ylabel="Distance (m)")
    axes.set_ylim(bottom=0.0)
    _place_legend(axes)
    return figure


def draw_innovations(runs: Sequence[LocalizationRun]) -> Figure:
    """Draw the squared distance of each given fix from the estimate before it, by both sigmas."""
    figure, axes = new_figure(11.0, 3.0)
    _shade_outages(axes, runs[0])
    for run, colour, name in zip(runs, COLOURS, NAMES, strict=False):
        fixes = sample_every(run.fixes, 4000)
        axes.plot(
            fixes[:, 0],
            np.maximum(fixes[:, 5], 1e-3),
            ".",
            color=colour,
            markersize=3.5,
            label=name,
        )
    axes.axhline(LIMIT_NIS, color=RED, linewidth=1.0, label="3 sigma")
    axes.axhline(2.0, color=INK, linewidth=1.0, linestyle=(0, (3, 2)), label="mean if honest: 2")
    axes.set(xlabel="Time (s)", ylabel="Squared, normalised", yscale="log")
    _place_legend(axes)
    return figure


def _shade_outages(axes: Axes, run: LocalizationRun) -> None:
    for number, outage in enumerate(run.result.outages):
        axes.axvspan(
            outage.from_s, outage.to_s, color=RED, alpha=0.08, linewidth=0,
            label=None if number else "fixes withheld",
        )  # fmt: skip


def _place_legend(axes: Axes) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=9,
        borderaxespad=0.2,
    )  # fmt: skip
