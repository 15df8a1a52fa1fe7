"""Sets of photographs and labels, read before a network learns from them."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from agribot.core.errors import ConfigError
from agribot.lab.dataset.classes import MaskIds, read_ids
from agribot.lab.dataset.placement import PlacementTally
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.fit import Progress
from agribot.lab.train.photographs import (
    KINDS,
    Pair,
    PairFiles,
    find_pairs,
    read_pairs,
    refuse_doubt,
    split_fold,
    tally_classes,
)
from agribot.lab.train.validation import shrink_pair


class PhotoFolder(NamedTuple):
    """A folder of photographs, the kind of its data, and what `--ids` says of its masks."""

    kind: str
    path: Path
    ids: MaskIds | None = None


class PhotoSet(NamedTuple):
    """Readable pairs of a set, the shapes of its pictures, and a digest of names and labels.

    `held` are the pictures of the fold, None without one.
    """

    folder: PhotoFolder
    files: PairFiles
    shapes_px: list[tuple[int, int]]  # height, width
    digest: str
    held: Callable[[], Iterable[LabelledImage]] | None

    @property
    def show_rows(self) -> bool:
        """Whether the labels come from drawings of crop rows."""
        return any(pair.shows_rows for pair in self.files.pairs)


def list_folders(args: argparse.Namespace) -> list[PhotoFolder]:
    """List the folder of --data-dir and those of --with.

    Raises: ConfigError: a --with without a known kind or without a folder.
    """
    first = PhotoFolder(args.data, args.data_dir, read_ids(args.ids))
    return [first, *map(_read_folder, args.with_photographs)]


def _read_folder(text: str) -> PhotoFolder:
    kind, _, path = text.partition("=")
    if kind not in KINDS or not path:
        raise ConfigError(
            f"--with {text}: write KIND=FOLDER, such as folder=photographs; KIND is one of "
            f"{', '.join(KINDS)}"
        )
    return PhotoFolder(kind, Path(path))


def read_photographs(
    args: argparse.Namespace, folder: PhotoFolder, progress: Progress
) -> tuple[PhotoSet, list[str]]:
    """Read every picture to train on once, prepare those held out, collect what cannot be used.

    No picture is kept: a set may be larger than the memory.

    Raises: ConfigError: no pair, or classes that look swapped.
    """
    pairs, problems = find_pairs(folder.path, folder.kind, ids=folder.ids)
    held: list[Pair] = []
    if args.fold is not None:
        pairs, held = split_fold(pairs, args.folds, args.fold)
    for text in problems:
        progress(f"left out: {text}")

    def note(text: str) -> None:
        if text not in problems:  # those held out are read more than once
            problems.append(text)
            progress(f"left out: {text}")

    placement = PlacementTally()
    seen = _Reading(folder.path, note)
    tally = tally_classes(seen.read(pairs, placement))
    if not seen.pairs:
        raise ConfigError(f"{folder.path}: no pair can be read; the first problem: {problems[0]}")
    if folder.kind in {"folder", "rows"} and folder.ids is None:
        refuse_doubt(tally, pairs, folder.path)
    if placement.misplaced and not args.keep_misplaced:
        seen = seen.leave_out(placement)
    return seen.finish(folder, partial(read_pairs, held, note) if held else None), problems


class _Reading:
    """The pairs of a folder that were read, their shapes, and a digest of their labels."""

    def __init__(self, folder: Path, note: Callable[[str], None]) -> None:
        self.pairs: list[Pair] = []
        self.shapes_px: list[tuple[int, int]] = []
        self._digest = hashlib.sha256()
        self._folder, self._note = folder, note

    def read(self, pairs: Sequence[Pair], placement: PlacementTally) -> Iterator[LabelledImage]:
        for pair in pairs:
            for image_rgb, label in read_pairs([pair], self._note):
                self.pairs.append(pair)
                self.shapes_px.append((label.shape[0], label.shape[1]))
                self._digest.update(pair.image.relative_to(self._folder).as_posix().encode())
                self._digest.update(label.tobytes())
                placement.add(str(pair.image), image_rgb, label)
                yield image_rgb, label

    def leave_out(self, placement: PlacementTally) -> _Reading:
        """Read again those whose labels lie on their plants, and name the others.

        Raises: ConfigError: too many do not.
        """
        placement.refuse(str(self._folder))
        for name, reason in placement.misplaced.items():
            self._note(f"{name}: its labels do not lie on its plants; {reason}")
        good = [pair for pair in self.pairs if str(pair.image) not in placement.misplaced]
        again = _Reading(self._folder, self._note)
        for _ in again.read(good, PlacementTally()):
            pass
        return again

    def finish(
        self, folder: PhotoFolder, held: Callable[[], Iterable[LabelledImage]] | None
    ) -> PhotoSet:
        digest = self._digest.hexdigest()[:16]
        return PhotoSet(folder, PairFiles(self.pairs), self.shapes_px, digest, held)


def set_aside(
    read: PhotoSet, count: int, size_px: tuple[int, int]
) -> tuple[PhotoSet, list[LabelledImage]]:
    """Keep photographs, evenly over the set, from the training, to judge and calibrate with them.

    Raises: ConfigError: none would be left to train on.
    """
    total = len(read.shapes_px)
    if count >= total:
        raise ConfigError(
            f"--validate {count}: the set has {total} pictures; leave some of them to train on"
        )
    if not count:
        return read, []
    aside = {(2 * k + 1) * total // (2 * count) for k in range(count)}
    rest = [index for index in range(total) if index not in aside]
    shrunk = [shrink_pair(*read.files[index], size_px) for index in sorted(aside)]
    files = PairFiles([read.files.pairs[index] for index in rest])
    shapes_px = [read.shapes_px[index] for index in rest]
    return read._replace(files=files, shapes_px=shapes_px), shrunk
