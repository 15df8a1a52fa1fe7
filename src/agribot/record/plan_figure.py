"""Picture of a field plan: swaths, headland, turns and ways, and what is not covered."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.plan_certificate import Certificate
from agribot.autonomy.plan.coverage.plan_sweep import trace_tool
from agribot.core.messages import FloatArray
from agribot.record.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, new_figure

_COLOURS = {"swath": GREEN, "row": GREEN, "headland": BLUE, "link": ORANGE, "arc": ORANGE,
            "reverse": INK}  # fmt: skip
_NAMES = {
    "swath": "swath", "row": "crop row", "headland": "headland pass", "link": "way, tool off",
    "arc": "turn, tool off", "reverse": "backwards, tool off",
}  # fmt: skip
_LONGER_SIDE_IN = 9.0
_BAND_ALPHA = 0.22


def draw_plan(
    plan: FieldPlan, area: FieldArea, request: PlanRequest, certificate: Certificate
) -> Figure:
    """Draw metres East and North of the field's datum; bands are as wide as the tool."""
    corners = np.array(area.boundary)
    low, high = corners.min(axis=0), corners.max(axis=0)
    width_m, height_m = (high - low) + 2.0
    scale = _LONGER_SIDE_IN / max(width_m, height_m)
    figure, axes = new_figure(max(width_m * scale, 3.5) + 3.4, max(height_m * scale, 3.0) + 1.4)
    axes.set(
        xlim=(low[0] - 1, high[0] + 1), ylim=(low[1] - 1, high[1] + 1), aspect="equal",
        xlabel="East of the datum (m)", ylabel="North of the datum (m)",
    )  # fmt: skip
    _draw_field(axes, area)
    _draw_legs(axes, plan, request)
    _draw_marks(axes, plan, certificate)
    axes.set_title(_title(certificate), loc="left", fontsize=12, color=INK)
    handles, labels = axes.get_legend_handles_labels()
    kept = dict(zip(labels, handles, strict=True))
    axes.legend(
        kept.values(), kept.keys(), loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False
    )
    return figure


def _draw_field(axes: Axes, area: FieldArea) -> None:
    rings = [np.array([*ring, ring[0]]) for ring in (area.boundary, *area.holes)]
    for number, ring in enumerate(rings):
        axes.plot(*ring.T, color=INK, linewidth=1.6, label="boundary" if not number else "obstacle",
                  zorder=5)  # fmt: skip
        if number:
            axes.add_patch(PathPatch(Outline(ring), facecolor=GREY, alpha=0.45, zorder=1))
    for row in area.rows:
        axes.plot(*np.array(row).T, color=GREY, linewidth=3, alpha=0.6, label="crop", zorder=2)


def _draw_legs(axes: Axes, plan: FieldPlan, request: PlanRequest) -> None:
    by_kind: dict[str, list[Leg]] = {}
    for leg in plan.legs:
        by_kind.setdefault(leg.kind, []).append(leg)
    for kind, legs in by_kind.items():
        lines = [leg.xy_map_m for leg in legs]
        if legs[0].tool_on:
            axes.add_collection(PolyCollection(
                _make_bands([trace_tool(xy, request.tool_x_m) for xy in lines],
                       request.implement_width_m / 2.0), facecolors=_COLOURS[kind],
                edgecolors="none", alpha=_BAND_ALPHA, zorder=2))  # fmt: skip
        axes.add_collection(LineCollection(
            lines, colors=_COLOURS[kind], linewidths=1.1, label=_NAMES[kind],
            zorder=4 if legs[0].tool_on else 6))  # fmt: skip


def _make_bands(lines: list[FloatArray], half_width_m: float) -> list[FloatArray]:
    """Make the ground beside every piece of the lines, each (4, 2)."""
    starts = np.concatenate([line[:-1] for line in lines])
    ends = np.concatenate([line[1:] for line in lines])
    along = ends - starts
    length_m = np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    left = np.column_stack([-along[:, 1], along[:, 0]]) / length_m * half_width_m
    return list(np.stack([starts + left, ends + left, ends - left, starts - left], axis=1))


def _draw_marks(axes: Axes, plan: FieldPlan, certificate: Certificate) -> None:
    if plan.legs:
        for place, marker, label in (
            (plan.legs[0].xy_map_m[0], "o", "start"), (plan.legs[-1].xy_map_m[-1], "s", "end"),
        ):  # fmt: skip
            axes.plot(*place, marker=marker, markersize=8, markerfacecolor="white",
                      markeredgecolor=BLUE, markeredgewidth=2.4, linestyle="none", label=label,
                      zorder=8)  # fmt: skip
    spots = [(p.east_m, p.north_m) for p in certificate.problems if math.isfinite(p.east_m)]
    if spots:
        axes.plot(*np.array(spots).T, marker="X", markersize=11, color=RED, linestyle="none",
                  markeredgecolor="white", label="refused here", zorder=9)  # fmt: skip


def _title(certificate: Certificate) -> str:
    verdict = "certified" if certificate.ok else f"refused: {certificate.problems[0].rule}"
    return (
        f"{verdict}; {certificate.field_area_m2 / 1e4:.2f} ha, "
        f"{100 * certificate.coverage_ratio:.1f} % of the reachable ground worked, "
        f"{certificate.length_m / 1000:.2f} km"
    )
