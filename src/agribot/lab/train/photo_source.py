"""The data of a training on photographs, with drawn images beside them where they are wanted."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from agribot.core.messages import ByteArray
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.fit import Progress, TrainingPlan
from agribot.lab.train.loader import BatchSource
from agribot.lab.train.networks import STRIDE_PX, read_size
from agribot.lab.train.photo_mixing import add_drawn, count_drawn, mix_sets
from agribot.lab.train.photo_reading import (
    PhotoSet,
    list_folders,
    read_photographs,
    set_aside,
)
from agribot.lab.train.photographs import KINDS, PairFiles
from agribot.lab.train.precision import sample_pictures
from agribot.lab.train.sources import (
    BATCH_SIZE,
    SIM_TEXT,
    TrainingSource,
    format_further,
)
from agribot.lab.train.standing import Judge
from agribot.lab.train.validation import HeldOutPictures, shrink_pair

# Order weed, crop, soil; crop is the rarest class of the photographs.
PHOTO_WEIGHTS = (1.0, 2.0, 0.6)
# Class weights of labels from drawn rows beside masks. Weeds between rows are few.
ROW_WEIGHTS = (15.0, 1.0, 0.5)
DRAWN_SHARE = 0.25  # share of a batch from drawn images, where there are any


def make_photo_source(args: argparse.Namespace, progress: Progress) -> TrainingSource:
    """Read the photographs of one or more folders, all of them or all but one fold.

    Raises: ConfigError: no pairs, or an option out of range.
    """
    size_px = read_size(args.size, STRIDE_PX)
    found = [read_photographs(args, one, progress) for one in list_folders(args)]
    problems = [text for _, texts in found for text in texts]
    parted = [set_aside(read, args.validate or 0, size_px) for read, _ in found]
    sets = [read for read, _ in parted]
    aside = [picture for _, pictures in parted for picture in pictures]
    tests = _list_tests(sets, args)
    recipe = _make_recipe(sets, args)
    kinds = [KINDS[read.folder.kind] for read in sets]
    drawn = count_drawn(args)
    return TrainingSource(
        aside=(lambda: aside) if aside else _shrink_held(tests, size_px),
        has_tests_aside=bool(tests) and not aside,
        judge=_make_judge(aside, size_px, args.model),
        batches=_make_batches(sets, args, size_px, recipe, progress),
        labels=lambda: (read.files[index][1] for read in sets for index in range(len(read.files))),
        pictures=[picture for read in sets for picture in _read_sample(read.files)],
        recipe=recipe,
        tests=tests,
        train_images=sum(len(read.files) for read in sets),
        input_size_px=size_px,
        antialias=True,
        about="; ".join(dict.fromkeys(kind.about for kind in kinds))
        + (f", and {drawn} {SIM_TEXT}" if drawn else ""),
        license="; ".join(dict.fromkeys(kind.license for kind in kinds)),
        limits="judged on pictures of the same camera and field as it was trained on; other crops, "
        "soils and cameras were not measured.",
        command=_format_command(args),
        problems=tuple(problems),
    )


def _make_recipe(sets: Sequence[PhotoSet], args: argparse.Namespace) -> TrainingPlan:
    options = _format_options(args)
    first, *others = sets
    further = "".join(
        f"; {len(one.files)} of {one.folder.kind}, labels {one.digest}" for one in others
    )
    return TrainingPlan(
        steps=1,
        batch_size=args.batch_size,
        crop_px=args.crop_px,
        class_weights=PHOTO_WEIGHTS,
        row_weights=ROW_WEIGHTS if others and any(one.show_rows for one in sets) else None,
        overlap_loss=args.loss,
        data=f"{args.data}{options.ids}{options.fold} --train-width {args.train_width}"
        f"{options.drawn}{options.validate}, {len(first.files)} photographs, "
        f"labels {first.digest}{further}",
    )


def _list_tests(
    sets: Sequence[PhotoSet], args: argparse.Namespace
) -> dict[str, Callable[[], Iterable[LabelledImage]]]:
    """List the pictures of the fold, of several sets each by its own folder."""
    name = f"fold {args.fold} of {args.folds}"
    return {
        f"{name} of {one.folder.path.name}" if len(sets) > 1 else name: one.held
        for one in sets
        if one.held is not None
    }


def _shrink_held(
    tests: dict[str, Callable[[], Iterable[LabelledImage]]], size_px: tuple[int, int]
) -> Callable[[], Iterable[LabelledImage]] | None:
    """Bring the pictures of the fold to the size of the network, as the deployed file does."""
    if not tests:
        return None
    return lambda: (shrink_pair(*pair, size_px) for held in tests.values() for pair in held())


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
    drawn: str
    validate: str


def _format_options(args: argparse.Namespace) -> _DataOptions:
    share = f" --drawn-share {args.drawn_share:g}" if args.drawn_share != DRAWN_SHARE else ""
    return _DataOptions(
        batch_size="" if args.batch_size == BATCH_SIZE else f" --batch-size {args.batch_size}",
        ids=f" --ids {args.ids}" if args.ids else "",
        fold="" if args.fold is None else f" --folds {args.folds} --fold {args.fold}",
        drawn=f"{' --with-sim ' + str(args.with_sim) if args.with_sim else ''}"
        f"{format_further(args)}{share}",
        validate=f" --validate {args.validate}" if args.validate else "",
    )


def _format_command(args: argparse.Namespace) -> str:
    options = _format_options(args)
    further = "".join(f" --with {one.kind}={one.path.name}" for one in list_folders(args)[1:])
    return (
        f"agribot train --data {args.data} --data-dir DIR{further} --model {args.model} "
        f"--loss {args.loss} --train-width {args.train_width} --size {args.size} "
        f"--crop-px {args.crop_px}{options.batch_size}{options.ids}{options.fold}"
        f"{options.drawn}{' --keep-misplaced' if args.keep_misplaced else ''}"
    )


def _make_batches(
    sets: Sequence[PhotoSet],
    args: argparse.Namespace,
    size_px: tuple[int, int],
    recipe: TrainingPlan,
    progress: Progress,
) -> BatchSource:
    """Crop the photographs; drawn images, if any, give their share of every batch."""
    drawn = count_drawn(args)
    aside = max(1, round(args.drawn_share * recipe.batch_size)) if drawn else 0
    photos = mix_sets(sets, recipe.batch_size - aside, args, size_px)
    return add_drawn(photos, aside, args, recipe, progress) if aside else photos
