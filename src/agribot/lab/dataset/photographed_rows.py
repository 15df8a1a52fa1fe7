"""Photographs of a field become a set that a network learns from, by their rows alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

import msgspec

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.lab.dataset.layouts import IMAGE_FOLDERS, index_files
from agribot.lab.dataset.photo_rows import (
    BANDS,
    DIRECTIONS,
    ROW_TURNS_RAD,
    PhotoRow,
    PhotoRowProfile,
    RowDirection,
    choose_band,
    label_by_row,
    score_crop,
    search_row,
    turn,
)
from agribot.lab.dataset.pictures import (
    SUFFIXES,
    PictureError,
    read_picture,
    resize_nearest,
)
from agribot.lab.dataset.taught_set import TaughtSet

# Least ratio of pictures whose crop gathers along the rows to those whose crop gathers across.
LEAST_DOMINANCE = 2.0
NEEDED = (
    "give pictures from straight above with one row in each, all down the pictures or all across "
    "them, try another --model, or label some by hand (agribot label)"
)
PASSES = 3  # passes over all pictures: the rows' direction, their places, their contents
Progress = Callable[[int], None]


class RowsOfSet(NamedTuple):
    """Rows of a set: their direction, their width, and the lean of all."""

    direction: RowDirection
    band: int
    turn_rad: float


class PhotoLabelReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result for the photographs; shares are of the pixels of those that were labelled."""

    folder: str
    pictures: int
    labelled: int
    without_row: int
    rows: RowDirection
    turn_deg: float
    half_row_ratio: float
    pixel_ratio: dict[str, float]
    problems: tuple[str, ...]


class Photographs(NamedTuple):
    """The pictures in a folder, or in that of images in it, and what cannot be used."""

    folder: Path
    paths: list[Path]
    left_out: tuple[str, ...]


def list_photographs(folder: Path) -> Photographs:
    """List the pictures in a folder, or in that of images in it.

    Raises: ConfigError: no folder, or no picture in it.
    """
    if not folder.is_dir():
        raise ConfigError(f"{folder} is no folder; check the path")
    inner = next((folder / name for name in IMAGE_FOLDERS if (folder / name).is_dir()), folder)
    found, left_out = index_files(folder, inner)
    if not found:
        raise ConfigError(
            f"{inner} holds neither the recording of a run, run.mcap, nor a picture "
            f"({', '.join(sorted(SUFFIXES))}); name another folder"
        )
    paths = [folder / name for name in found.values()]
    return Photographs(inner, paths, tuple(f"{folder / file}: {why}" for why, file in left_out))


class PhotographedRows:
    """A folder of photographs from straight above, each with one row of crop.

    The rows run down all pictures or across all; `direction` None: as they gather more of the crop.
    """

    def __init__(
        self, folder: Path, segmenter: Segmenter, direction: RowDirection | None = None
    ) -> None:
        """Find the pictures in the folder, or in that of images in it.

        Raises: ConfigError: no folder, or no picture in it.
        """
        self._folder, self._paths, self._left_out = list_photographs(folder)
        self._segmenter, self._direction = segmenter, direction
        self._problems: dict[Path, str] = {}

    def __len__(self) -> int:
        return len(self._paths)

    def label(self, out: Path, progress: Progress) -> PhotoLabelReport:
        """Write the pictures with a row to `out`/images and their classes to `out`/masks.

        Pictures that cannot be read are left out, and named in the report.
        Raises: ConfigError: the folder holds files, or no picture shows a row.
        """
        taught = TaughtSet(out)
        course = self._find_course(progress)
        rows, half_ratio = self._find_rows(course, progress)
        for path, image_rgb, classes in self._see(progress, 2):
            if path in rows:
                kind, confidence = classes.class_id, classes.confidence
                upright = turn(kind, course.direction), turn(confidence, course.direction)
                small = label_by_row(*upright, rows[path], half_ratio)
                label = resize_nearest(turn(small, course.direction), image_rgb.shape[:2])
                name = path.relative_to(self._folder).as_posix().replace("/", "-")
                taught.add(name, path.read_bytes(), label)
        return PhotoLabelReport(
            folder=str(out),
            pictures=len(self) + len(self._left_out),
            labelled=len(rows),
            without_row=len(self) - len(self._problems) - len(rows),
            rows=course.direction,
            turn_deg=math.degrees(course.turn_rad),
            half_row_ratio=half_ratio,
            pixel_ratio=taught.pixel_ratio,
            problems=(*self._left_out, *self._problems.values()),
        )

    def _see(self, progress: Progress, pass_: int) -> Iterator[tuple[Path, ByteArray, ClassMap]]:
        """See each picture that can be read."""
        for done, path in enumerate(self._paths, pass_ * len(self) + 1):
            if path not in self._problems:
                try:
                    image_rgb = read_picture(path)
                except PictureError as error:
                    self._problems[path] = str(error)
                else:
                    yield path, image_rgb, self._segmenter.segment(image_rgb)
            progress(done)

    def _find_course(self, progress: Progress) -> RowsOfSet:
        ways = [(direction, band) for direction in DIRECTIONS for band in BANDS]
        found: dict[tuple[RowDirection, int], list[PhotoRow]] = {way: [] for way in ways}
        for _, _, classes in self._see(progress, 0):
            score = score_crop(classes)
            for direction, band in ways:
                search = search_row(turn(score, direction), band)
                found[direction, band] += [search.row] if search.is_row else []

        def find_way(direction: RowDirection) -> tuple[RowDirection, int]:
            return direction, choose_band({band: len(found[direction, band]) for band in BANDS})

        asked = DIRECTIONS if self._direction is None else (self._direction,)
        direction, band = max(map(find_way, asked), key=lambda way: len(found[way]))
        other = DIRECTIONS[1 - DIRECTIONS.index(direction)]
        rows, crossing = found[direction, band], found[other, band]
        if not rows or len(rows) < LEAST_DOMINANCE * len(crossing):
            raise ConfigError(
                f"of {len(self)} pictures, the crop that the network sees gathers along a line "
                f"{direction} {len(rows)} of them and {other} {len(crossing)}: these show no rows "
                f"that run alike; {NEEDED}"
            )
        return RowsOfSet(direction, band, median(row.turn_rad for row in rows))

    def _find_rows(
        self, course: RowsOfSet, progress: Progress
    ) -> tuple[dict[Path, PhotoRow], float]:
        """Find the row of each picture that shows one, and how far its plants stand from it."""
        rows: dict[Path, PhotoRow] = {}
        profile = PhotoRowProfile()
        for path, _, classes in self._see(progress, 1):
            score = turn(score_crop(classes), course.direction)
            search = search_row(score, course.band, course.turn_rad + ROW_TURNS_RAD)
            if search.is_row:
                rows[path] = search.row
                profile.add(score, search.row)
        if not rows:
            raise ConfigError(f"no picture shows a single row of crop; {NEEDED}")
        return rows, profile.find_half_ratio()
