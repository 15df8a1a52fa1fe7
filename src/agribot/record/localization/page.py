"""The page of a log: one file with map, figures, outages, and what was not used and why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from agribot.core.version import __version__
from agribot.record.localization import page_figures
from agribot.record.localization.camera import CameraStudy, describe_camera
from agribot.record.localization.result import LocalizationResult, LocalizationRun, LogFacts
from agribot.record.report import write_file
from agribot.record.templates import fill_template
from agribot.record.tiles import Tile, format_number

_TILES = (
    ("Began after", "started_after_s", 1, " s", "from the first message of the log"),
    ("Way until then", "started_after_m", 1, " m", "by the wheels"),
    ("Off the fixes", "rms_to_fixes_m", 2, " m", "RMS from 60 s on, fixes that were given"),
    ("Within 3 sigma", "within_3_sigma_ratio", 3, "", "of pose and receiver together"),
    ("Normalised innovation", "nis_mean", 2, "", "squared, mean; 2 if both sigmas are honest"),
)


def write_localization_page(
    path: Path,
    runs: Sequence[LocalizationRun],
    facts: LogFacts,
    camera: CameraStudy | None = None,
) -> None:
    """Write report.html of a log; `runs` are one or two passes of the filter.

    Raises: RecordingError: the file cannot be written.
    """
    write_file(path, render_page(runs, facts, camera).encode())


def render_page(
    runs: Sequence[LocalizationRun], facts: LogFacts, camera: CameraStudy | None = None
) -> str:
    return fill_template(
        "record/localization/page.html.j2", log=describe_log(runs, facts, camera),
        is_good=runs[0].result.reason == "ok", version=__version__,
    )  # fmt: skip


def describe_log(
    runs: Sequence[LocalizationRun], facts: LogFacts, camera: CameraStudy | None = None
) -> dict[str, object]:
    """Describe all that sections.html.j2 shows: the page below its head, for other pages as well.

    The figures are drawn.
    """
    return {
        "runs": runs,
        "facts": facts,
        "tiles": _make_tiles(runs[0].result),
        "figures": (
            ("Map", page_figures.draw_map(runs), "Map of fixes and poses", "map"),
            ("Fixes and estimate", page_figures.draw_offsets(runs), "Distance of fixes", ""),
            ("Innovations", page_figures.draw_innovations(runs), "Normalised innovations", ""),
        ),
        "comparison": _compare(*(run.result for run in runs)) if len(runs) > 1 else (),
        "outages": [
            ("" if number == 0 else ", changed", outage)
            for number, run in enumerate(runs)
            for outage in run.result.outages
        ],
        "camera": None if camera is None else describe_camera(camera),
    }


def _make_tiles(result: LocalizationResult) -> list[Tile]:
    tiles = [
        (name, format_number(getattr(result, key), decimals, unit), note)
        for name, key, decimals, unit, note in _TILES
    ]
    return [*tiles, ("Fixes used", f"{result.used} of {result.fixes}", "")]


def _compare(before: LocalizationResult, after: LocalizationResult) -> list[tuple[object, ...]]:
    rows = [
        (name, *(format_number(getattr(each, key), decimals) for each in (before, after)))
        for name, key, decimals, *_ in _TILES
    ]
    return [*rows, ("Fixes used", before.used, after.used)]
