"""The data of a training on photographs, with drawn images beside them where they are wanted."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.lab.dataset.classes import read_ids
from agribot.lab.dataset.placement import PlacementTally
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.farm import draw_row_crop
from agribot.lab.train.fit import Progress, TrainingPlan
from agribot.lab.train.loader import BatchSource
from agribot.lab.train.networks import STRIDE_PX, read_size
from agribot.lab.train.photo_batches import PhotoBatches
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
from agribot.lab.train.picture_stack import PictureStack
from agribot.lab.train.plant_targets import make_class_targets
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.precision import sample_pictures
from agribot.lab.train.simulated import (
    draw_random_field,
)
from agribot.lab.train.sources import (
    BATCH_SIZE,
    SIM_TEXT,
    TrainingSource,
    WantedSet,
    draw_set,
    make_batches,
)
from agribot.lab.train.standing import Judge
from agribot.lab.train.validation import HeldOutPictures, shrink_pair
from agribot.sim.random_scenes import DENSE, STANDARD

# Order weed, crop, soil; crop is the rarest class of the photographs.
PHOTO_WEIGHTS = (1.0, 2.0, 0.6)


def make_photo_source(args: argparse.Namespace, progress: Progress) -> TrainingSource:
    """Read the photographs of a folder, all of them or all but one fold.

    Raises: ConfigError: no pairs, or an option out of range.
    """
    height_px, width_px = read_size(args.size, STRIDE_PX)
    read, held, problems = _read_photographs(args, progress)
    read, aside = _set_aside(read, args.validate or 0, (height_px, width_px))
    options = _format_options(args)
    recipe = TrainingPlan(
        steps=1,
        batch_size=args.batch_size,
        crop_px=args.crop_px,
        class_weights=PHOTO_WEIGHTS,
        overlap_loss=args.loss,
        data=f"{args.data}{options.ids}{options.fold} --train-width {args.train_width}"
        f"{options.with_sim}{options.validate}, {len(read.files)} photographs, "
        f"labels {read.digest}",
    )
    return TrainingSource(
        aside=(lambda: aside) if aside else _shrink_held(held, (height_px, width_px)),
        has_tests_aside=held is not None and not aside,
        judge=_make_judge(aside, (height_px, width_px), args.model),
        batches=_make_photo_batches(args, read, recipe, progress),
        labels=lambda: (read.files[index][1] for index in range(len(read.files))),
        pictures=_read_sample(read.files),
        recipe=recipe,
        tests={f"fold {args.fold} of {args.folds}": held} if held else {},
        train_images=len(read.files),
        input_size_px=(height_px, width_px),
        antialias=True,
        about=KINDS[args.data].about
        + (f", and {args.with_sim} {SIM_TEXT}" if args.with_sim else ""),
        license=KINDS[args.data].license,
        limits="judged on pictures of the same camera and field as it was trained on; other crops, "
        "soils and cameras were not measured.",
        command=f"agribot train --data {args.data} --data-dir DIR --model {args.model} "
        f"--loss {args.loss} --train-width {args.train_width} --size {args.size} "
        f"--crop-px {args.crop_px}{options.batch_size}{options.ids}{options.fold}"
        f"{options.with_sim}{' --keep-misplaced' if args.keep_misplaced else ''}",
        problems=tuple(problems),
    )


class _Photographs(NamedTuple):
    """Readable pairs of a set, the width of its pictures, and a digest of names and labels."""

    files: PairFiles
    widths_px: list[int]
    digest: str


def _read_photographs(
    args: argparse.Namespace, progress: Progress
) -> tuple[_Photographs, Callable[[], Iterable[LabelledImage]] | None, list[str]]:
    """Read every picture to train on once, prepare those held out, collect what cannot be used.

    No picture is kept: a set may be larger than the memory.

    Raises: ConfigError: no pair, or classes that look swapped.
    """
    ids = read_ids(args.ids)
    pairs, problems = find_pairs(args.data_dir, args.data, ids=ids)
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
    seen = _Reading(args.data_dir, note)
    tally = tally_classes(seen.read(pairs, placement))
    if not seen.pairs:
        raise ConfigError(f"{args.data_dir}: no pair can be read; the first problem: {problems[0]}")
    if args.data in {"folder", "rows"} and ids is None:
        refuse_doubt(tally, pairs, args.data_dir)
    if placement.misplaced and not args.keep_misplaced:
        seen = seen.leave_out(placement)
    read = _Photographs(PairFiles(seen.pairs), seen.widths_px, seen.digest.hexdigest()[:16])
    return read, partial(read_pairs, held, note) if held else None, problems


class _Reading:
    """The pairs of a folder that were read, how wide they are, and a digest of their labels."""

    def __init__(self, folder: Path, note: Callable[[str], None]) -> None:
        self.pairs: list[Pair] = []
        self.widths_px: list[int] = []
        self.digest = hashlib.sha256()
        self._folder, self._note = folder, note

    def read(self, pairs: Sequence[Pair], placement: PlacementTally) -> Iterator[LabelledImage]:
        for pair in pairs:
            for image_rgb, label in read_pairs([pair], self._note):
                self.pairs.append(pair)
                self.widths_px.append(label.shape[1])
                self.digest.update(pair.image.relative_to(self._folder).as_posix().encode())
                self.digest.update(label.tobytes())
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


def _set_aside(
    read: _Photographs, count: int, size_px: tuple[int, int]
) -> tuple[_Photographs, list[LabelledImage]]:
    """Keep photographs, evenly over the set, from the training, to judge and calibrate with them.

    Raises: ConfigError: none would be left to train on.
    """
    total = len(read.widths_px)
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
    widths_px = [read.widths_px[index] for index in rest]
    return read._replace(files=files, widths_px=widths_px), shrunk


def _shrink_held(
    held: Callable[[], Iterable[LabelledImage]] | None, size_px: tuple[int, int]
) -> Callable[[], Iterable[LabelledImage]] | None:
    """Bring the pictures of the fold to the size of the network, as the deployed file does."""
    if held is None:
        return None
    return lambda: (shrink_pair(*pair, size_px) for pair in held())


def _make_judge(aside: list[LabelledImage], size_px: tuple[int, int], model: str) -> Judge | None:
    if not aside:
        return None
    return HeldOutPictures(aside, size_px, find_architecture(model).features)


def _read_sample(files: PairFiles) -> list[ByteArray]:
    """Read some of the pictures, on which 8-bit numbers are calibrated and doubt is limited."""
    return [files[index][0] for index in sample_pictures(range(len(files)))]


class _DataOptions(NamedTuple):
    """Options as they stand in a command, each with a space before it, or nothing."""

    batch_size: str
    ids: str
    fold: str
    with_sim: str
    validate: str


def _format_options(args: argparse.Namespace) -> _DataOptions:
    return _DataOptions(
        batch_size="" if args.batch_size == BATCH_SIZE else f" --batch-size {args.batch_size}",
        ids=f" --ids {args.ids}" if args.ids else "",
        fold="" if args.fold is None else f" --folds {args.folds} --fold {args.fold}",
        with_sim=f" --with-sim {args.with_sim}" if args.with_sim else "",
        validate=f" --validate {args.validate}" if args.validate else "",
    )


def _make_photo_batches(
    args: argparse.Namespace, read: _Photographs, recipe: TrainingPlan, progress: Progress
) -> BatchSource:
    """Crop the photographs; simulated images, if any, give a quarter of every batch."""
    aside = recipe.batch_size // 4 if args.with_sim else 0

    def scale(widths_px: list[int]) -> float:
        return float(args.train_width / np.median(widths_px))

    photos = PhotoBatches(
        read.files, scale(read.widths_px), recipe.batch_size - aside, recipe.crop_px
    )
    if not aside:
        return photos
    if find_architecture(args.model).finds_plants:
        return mix_with_plants(photos, draw_plants(args, progress), aside, recipe)
    wanted = WantedSet("train-random", 0, draw_random_field, STANDARD, args.with_sim)
    drawn = draw_set(args, wanted, progress)
    images = list(drawn.read(args.with_sim))
    simulated = PhotoBatches(
        images, scale([label.shape[1] for _, label in images]), aside, recipe.crop_px
    )

    def draw_mixed(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        return _join(photos(rng), simulated(rng))

    return draw_mixed


def draw_plants(args: argparse.Namespace, progress: Progress) -> list[DrawnView]:
    """Draw dense fields, half of them seen by the robot along rows: what keeps stems in mind."""
    masts = args.with_sim // 2
    sets = (
        WantedSet("train-random", 0, draw_random_field, DENSE, masts),
        WantedSet("train-rows", 1, draw_row_crop, DENSE, args.with_sim - masts),
    )
    return [
        view
        for one in sets
        for view in draw_set(args, one, progress, has_plants=True).read_views(one.images)
    ]


def mix_with_plants(
    photos: BatchSource, views: list[DrawnView], count: int, recipe: TrainingPlan
) -> BatchSource:
    """Photographs teach classes alone; of every batch `count` are views that teach stems, too."""
    drawn = make_batches(PictureStack(views, len(views)), count, recipe.crop_px)

    def draw_mixed(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        images, label = photos(rng)
        return _join((images, make_class_targets(label)), drawn(rng))

    return draw_mixed


def _join(*parts: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    return torch.cat([image for image, _ in parts]), torch.cat([truth for _, truth in parts])
