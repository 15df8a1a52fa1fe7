"""The data of a training, drawn or photographed."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
import torch
from torch import Tensor

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray
from agribot.lab.dataset.classes import read_ids
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.augment import augment_batch
from agribot.lab.train.card import LICENSE, SIM_LIMITS
from agribot.lab.train.data import DataSet, LabelledImage
from agribot.lab.train.export import INPUT_HEIGHT_PX, INPUT_WIDTH_PX
from agribot.lab.train.farm import draw_farm, draw_row_crop, draw_turn
from agribot.lab.train.fit import BatchSource, Progress, TrainingPlan
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
from agribot.lab.train.plant_targets import augment_views
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.precision import sample_pictures
from agribot.lab.train.simulated import (
    ROUGH_VIEWS_PER_SCENE,
    VIEWS_PER_SCENE,
    draw_random_field,
)
from agribot.lab.train.standing import Judge
from agribot.lab.train.validation import HeldOutPictures, shrink_pair
from agribot.sim.random_scenes import STANDARD, VARIETIES, Variety

# Order weed, crop, soil; crop is the rarest class of the photographs.
PHOTO_WEIGHTS = (1.0, 2.0, 0.6)
VariedDrawer = Callable[..., Iterator[DrawnView]]  # of a scene; all but one of any variety
CROP_PX = 320
VALIDATION = ("valid-random", "valid-rows")
FOLDERS = {one: "" if one is STANDARD else name for name, one in VARIETIES.items()}


class TrainingSource(msgspec.Struct, frozen=True, kw_only=True):
    """The data; `tests` are sets without any training image, `problems` unreadable files.

    `aside` are images for nothing but the temperature of the confidence; None: leave it as it is.
    `judge` looks at pictures that are for nothing but the curve of the training and its best step.
    """

    batches: BatchSource
    recipe: TrainingPlan
    tests: dict[str, Callable[[], Iterable[LabelledImage]]]
    aside: Callable[[], Iterable[LabelledImage]] | None = None
    judge: Judge | None = None
    pictures: Sequence[ByteArray]  # some that were trained on, to calibrate 8-bit numbers
    train_images: int
    input_size_px: tuple[int, int]  # height, width
    antialias: bool
    about: str
    license: str
    limits: str
    command: str
    problems: tuple[str, ...] = ()


def make_simulated_source(args: argparse.Namespace, progress: Progress) -> TrainingSource:
    """Draw what is missing of the training sets and the held-out sets."""
    counts = {
        "train-random": args.images - args.row_images - args.turn_images,
        "train-rows": args.row_images,
        "train-turns": args.turn_images,
    }
    finds_plants = find_architecture(args.model).finds_plants
    learns_classes = not args.keep_classes
    sets = _draw_sets(args, counts, progress, finds_plants, learns_classes)
    trained = [(sets.pop(name), count) for name, count in counts.items()]
    recipe = TrainingPlan(steps=1, crop_px=args.crop_px, data=f"sim --variety {args.variety}")
    words = f" --model {args.model}" if finds_plants else ""
    words += f" --crop-px {args.crop_px}" if args.crop_px != CROP_PX else ""
    judge = _make_view_judge(args, [sets.pop(name) for name in VALIDATION])
    if finds_plants:
        views = [view for one, count in trained for view in one.read_views(count)]
        images = [view.image_rgb for view in views]
        batches = _make_plant_batches(views, recipe)
    else:
        images, labels = _load(
            itertools.chain.from_iterable(one.read(count) for one, count in trained)
        )
        batches = _make_view_batches(images, labels, recipe)
    aside = None
    if learns_classes:
        asides = sets.pop("aside-random"), sets.pop("aside-rows")
        aside = partial(_read_all, asides, args.test_images // 2)
    return TrainingSource(
        aside=aside,
        judge=judge,
        batches=batches,
        pictures=images,
        recipe=recipe,
        tests={name: partial(one.read, args.test_images) for name, one in sets.items()},
        train_images=args.images,
        input_size_px=(INPUT_HEIGHT_PX, INPUT_WIDTH_PX),
        antialias=False,
        about=f"{SIM_TEXT}{VARIETY_TEXTS.get(args.variety, '')}; no photograph was used",
        license=LICENSE,
        limits=SIM_LIMITS,
        command=f"agribot train --data sim --variety {args.variety}{words} --images {args.images} "
        f"--row-images {args.row_images} --turn-images {args.turn_images} "
        f"--test-images {args.test_images}",
    )


def _make_view_judge(args: argparse.Namespace, sets: list[DataSet]) -> Judge | None:
    pictures: list[LabelledImage | DrawnView] = []
    for one, count in zip(sets, _split_validation(args), strict=True):
        pictures += one.read_views(count) if one.has_plants else one.read(count)
    if not pictures:
        return None
    features = find_architecture(args.model).features
    return HeldOutPictures(pictures, (INPUT_HEIGHT_PX, INPUT_WIDTH_PX), features)


def _split_validation(args: argparse.Namespace) -> tuple[int, int]:
    """Count the pictures of --validate from random masts, and those along rows."""
    return args.validate // 2, args.validate - args.validate // 2


def _read_all(sets: Iterable[DataSet], count: int) -> Iterator[LabelledImage]:
    return itertools.chain.from_iterable(one.read(count) for one in sets)


def _draw_sets(
    args: argparse.Namespace,
    counts: dict[str, int],
    progress: Progress,
    has_plants: bool,
    sets_aside: bool,
) -> dict[str, DataSet]:
    """Draw the sets, with plants those of the variety's own, and some to be set aside."""
    own = VARIETIES[args.variety]
    masts, rows = _split_validation(args)
    usual = STANDARD if own.rough_share else own  # a test set that others have too
    wanted: list[tuple[str, int, VariedDrawer, Variety, int]] = [
        ("train-random", 0, draw_random_field, own, counts["train-random"]),
        ("train-rows", 1, draw_row_crop, own, counts["train-rows"]),
        ("train-turns", 2, draw_turn, own, counts["train-turns"]),
        ("valid-random", 109, draw_random_field, own, masts),
        ("valid-rows", 110, draw_row_crop, own, rows),
        ("random-fields", 101, draw_random_field, usual, args.test_images),
        ("farm", 102, draw_farm, usual, args.test_images),
        ("row-crops", 103, draw_row_crop, usual, args.test_images),
        ("turns", 106, draw_turn, usual, args.test_images),
    ]
    if sets_aside:
        wanted += [
            ("aside-random", 104, draw_random_field, own, args.test_images // 2),
            ("aside-rows", 105, draw_row_crop, own, args.test_images // 2),
        ]
    if own.rough_share:
        wanted += [
            (f"{args.variety}-fields", 107, draw_random_field, own, args.test_images),
            (f"{args.variety}-rows", 108, draw_row_crop, own, args.test_images),
        ]
    sets = {}
    for name, stream, drawer, variety, count in wanted:
        sets[name] = DataSet(
            folder=(args.cache or args.out / "images") / FOLDERS[variety],
            name=name,
            stream=stream,
            seed=args.seed,
            views_per_scene=ROUGH_VIEWS_PER_SCENE if variety.rough_share else VIEWS_PER_SCENE,
            has_plants=has_plants and variety is own,
        )
        varied = drawer if drawer is draw_farm else partial(drawer, variety=variety)
        sets[name].draw(count, varied, progress)
    return sets


def make_photo_source(args: argparse.Namespace, progress: Progress) -> TrainingSource:
    """Read the photographs of a folder, all of them or all but one fold.

    Raises: ConfigError: no pairs, or an option out of range.
    """
    height_px, width_px = read_size(args.size, STRIDE_PX)
    read, held, problems = _read_photographs(args, progress)
    read, judge = _set_aside(read, args.validate, (height_px, width_px), args.model)
    options = _format_options(args)
    recipe = TrainingPlan(
        steps=1,
        crop_px=args.crop_px,
        class_weights=PHOTO_WEIGHTS,
        overlap_loss=args.loss,
        data=f"{args.data}{options.ids}{options.fold} --train-width {args.train_width}"
        f"{options.with_sim}",
    )
    return TrainingSource(
        judge=judge,
        batches=_make_photo_batches(args, read, recipe, progress),
        pictures=_read_sample(args, read.files),
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
        f"--crop-px {args.crop_px}{options.ids}{options.fold}{options.with_sim}",
        problems=tuple(problems),
    )


class _Photographs(NamedTuple):
    """What can be read of a set, and how wide the pictures are."""

    files: PairFiles
    widths_px: list[int]


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
        problems.append(text)
        progress(f"left out: {text}")

    good: list[Pair] = []
    widths_px: list[int] = []

    def read_all() -> Iterator[LabelledImage]:
        for pair in pairs:
            for image_rgb, label in read_pairs([pair], note):
                good.append(pair)
                widths_px.append(label.shape[1])
                yield image_rgb, label

    tally = tally_classes(read_all())
    if not good:
        raise ConfigError(f"{args.data_dir}: no pair can be read; the first problem: {problems[0]}")
    if args.data == "folder" and ids is None:
        refuse_doubt(tally, pairs, args.data_dir)
    read = _Photographs(PairFiles(good), widths_px)
    return read, partial(read_pairs, held, note) if held else None, problems


def _set_aside(
    read: _Photographs, count: int, size_px: tuple[int, int], model: str
) -> tuple[_Photographs, Judge | None]:
    """Keep photographs, evenly over the set, from the training, to judge it as it goes.

    Raises: ConfigError: none would be left to train on.
    """
    total = len(read.widths_px)
    if count >= total:
        raise ConfigError(
            f"--validate {count}: the set has {total} pictures; leave some of them to train on"
        )
    if not count:
        return read, None
    aside = {(2 * k + 1) * total // (2 * count) for k in range(count)}
    rest = [index for index in range(total) if index not in aside]
    shrunk = [shrink_pair(*read.files[index], size_px) for index in sorted(aside)]
    files = PairFiles([read.files.pairs[index] for index in rest])
    judge = HeldOutPictures(shrunk, size_px, find_architecture(model).features)
    return _Photographs(files, [read.widths_px[index] for index in rest]), judge


def _read_sample(args: argparse.Namespace, files: PairFiles) -> list[ByteArray]:
    """Read some of the pictures, on which 8-bit numbers are calibrated."""
    if args.precision != "int8":
        return []
    return [files[index][0] for index in sample_pictures(range(len(files)))]


class _DataOptions(NamedTuple):
    """Options as they stand in a command, each with a space before it, or nothing."""

    ids: str
    fold: str
    with_sim: str


def _format_options(args: argparse.Namespace) -> _DataOptions:
    return _DataOptions(
        ids=f" --ids {args.ids}" if args.ids else "",
        fold="" if args.fold is None else f" --folds {args.folds} --fold {args.fold}",
        with_sim=f" --with-sim {args.with_sim}" if args.with_sim else "",
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
    drawn = DataSet(
        folder=args.cache or args.out / "images",
        name="train-random",
        stream=0,
        seed=args.seed,
        views_per_scene=VIEWS_PER_SCENE,
    )
    drawn.draw(args.with_sim, draw_random_field, progress)
    images = list(drawn.read(args.with_sim))
    simulated = PhotoBatches(
        images, scale([label.shape[1] for _, label in images]), aside, recipe.crop_px
    )

    def draw_mixed(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        parts = photos(rng), simulated(rng)
        return torch.cat([image for image, _ in parts]), torch.cat([label for _, label in parts])

    return draw_mixed


def _load(
    pairs: Iterable[LabelledImage],
) -> tuple[list[ByteArray], list[ByteArray]]:
    images, labels = [], []
    for image_rgb, label in pairs:
        images.append(image_rgb)
        labels.append(label)
    return images, labels


def _make_view_batches(
    images: list[ByteArray], labels: list[ByteArray], recipe: TrainingPlan
) -> BatchSource:
    def batch(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        chosen = rng.integers(len(images), size=recipe.batch_size)
        return augment_batch(
            [images[i] for i in chosen], [labels[i] for i in chosen], recipe.crop_px, rng
        )

    return batch


def _make_plant_batches(views: list[DrawnView], recipe: TrainingPlan) -> BatchSource:
    def batch(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        chosen = rng.integers(len(views), size=recipe.batch_size)
        return augment_views([views[i] for i in chosen], recipe.crop_px, rng)

    return batch


SIM_TEXT = (
    "images of AGRIBOT's own simulator: procedural fields of several crops and weeds in random "
    "soil, light, growth stage and density, some from random camera poses, the others from the "
    "robot's own camera along and beside rows, labelled by the renderer"
)
VARIETY_TEXTS = {
    "rough": "; five crops from seedlings on, half of the fields with the relief, litter, "
    "moisture, light and sowing errors of the presets field and hard",
    "dense": "; five crops from seedlings to rows that close, 5 cm to 1.5 m from plant to plant, "
    "up to 80 weeds on a square metre, six fields of ten with the relief, litter, moisture, light "
    "and sowing errors of the presets field and hard",
}
