"""The published plot: cross-track error of all missions, scenario by scenario."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from agribot.lab.bench.nav.judge import Outcome


def plot(path: Path, entries: Sequence[tuple[str, Sequence[Outcome]]]) -> None:
    """Distribution of RMS and of the worst error per mission; a log axis holds the original."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 0.55 * len(entries) + 1.6), layout="constrained")
    axes = figure.add_subplot()
    names = [f"{name} ({len(outcomes)})" for name, outcomes in entries]
    for index, (_, outcomes) in enumerate(entries):
        at = len(entries) - 1 - index
        for values, offset, colour, label in (
            ([100 * o.xte_rms_m for o in outcomes], 0.17, "tab:green", "RMS of a mission"),
            ([100 * o.xte_max_m for o in outcomes], -0.17, "tab:orange", "worst of a mission"),
        ):
            axes.boxplot(
                values, positions=[at + offset], widths=0.28, orientation="horizontal",
                whis=(0, 100), patch_artist=True, boxprops={"facecolor": colour},
                medianprops={"color": "black"}, label=label if index == 0 else None,
                manage_ticks=False,
            )  # fmt: skip
    axes.axvline(25.0, color="tab:red", linestyle="--", label="row lost (25 cm)")
    axes.set_yticks(range(len(names)), names[::-1])
    axes.set_xscale("log")
    axes.set_xticks(
        [0.5, 1, 2, 5, 10, 25, 50, 100, 300], ["0.5", "1", "2", "5", "10", "25", "50", "100", "300"]
    )
    axes.set_xlabel("true cross-track error in the rows (cm); box: half of the missions, line: all")
    axes.set_title("ROWS-10x12: every mission")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
