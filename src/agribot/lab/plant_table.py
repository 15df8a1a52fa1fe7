"""Scores of single plants in lines of text and as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from agribot.lab.plant_scores import PlantScores


def format_table(scenes: Mapping[str, PlantScores]) -> str:
    """Format scores by scene as a table of Markdown."""
    lines = [f"| scene | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 1) + "|"]
    for name, scores in scenes.items():
        lines.append(f"| {name} | {' | '.join(cell(scores) for cell in COLUMNS.values())} |")
    return "\n".join(lines) + "\n"


def format_head() -> str:
    return f"{'':10}" + "".join(f"{title:>{_find_width(title)}}" for title in COLUMNS)


def format_line(name: str, scores: PlantScores) -> str:
    cells = (f"{cell(scores):>{_find_width(title)}}" for title, cell in COLUMNS.items())
    return f"{name:10}" + "".join(cells)


def _find_width(title: str) -> int:
    return max(len(title), 4) + 2


def _format(value: float | None, decimals: int = 2, unit: str = "", scale: float = 1.0) -> str:
    return "-" if value is None else f"{value * scale:.{decimals}f}{unit}"


# Title of a column -> its text for the scores.
COLUMNS: dict[str, Callable[[PlantScores], str]] = {
    "crops": lambda s: str(s.crops_truth),
    "recall": lambda s: _format(s.crop_recall),
    "precision": lambda s: _format(s.crop_precision),
    "weeds": lambda s: str(s.weeds_truth),
    "of weeds, recall": lambda s: _format(s.weed_recall),
    "of weeds, precision": lambda s: _format(s.weed_precision),
    "stems, median": lambda s: _format(s.stem_error_median_m, 1, " cm", 100.0),
    "stems, 95 %": lambda s: _format(s.stem_error_p95_m, 1, " cm", 100.0),
    "crops hit": lambda s: str(s.crops_hit),
    "PQ": lambda s: _format(s.pq),
}
