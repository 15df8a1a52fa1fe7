"""What a training needs of its data, wherever that comes from."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from functools import partial

import msgspec
import numpy as np
from torch import Tensor

from agribot.errors import ConfigError
from agribot.messages import ByteArray
from agribot.train.augment import augmented_batch
from agribot.train.card import LICENSE, SIM_LIMITS
from agribot.train.data import DataSet, LabelledImage
from agribot.train.export import INPUT_HEIGHT_PX, INPUT_WIDTH_PX
from agribot.train.farm import draw_farm
from agribot.train.fit import BatchSource, Progress, TrainingPlan
from agribot.train.photo_batches import PhotoBatches
from agribot.train.photographs import KINDS, Pair, find_pairs, fold_of, read_pairs
from agribot.train.simulated import VIEWS_PER_SCENE, draw_random_field

# Order weed, crop, soil; crop is the rarest class of the photographs.
PHOTO_WEIGHTS = (1.0, 2.0, 0.6)
STRIDE_PX = 32


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """`tests` holds sets that no training image is in; `problems` what could not be read."""

    batches: BatchSource
    recipe: TrainingPlan
    tests: dict[str, Callable[[], Iterable[LabelledImage]]]
    train_images: int
    input_size_px: tuple[int, int]  # height, width
    antialias: bool
    about: str
    license: str
    limits: str
    command: str
    problems: tuple[str, ...] = ()


def simulated_source(args: argparse.Namespace, progress: Progress) -> Source:
    """The training set and the held-out sets, drawn as far as they were missing."""
    folder = args.cache or args.out / "images"
    wanted = (
        ("train", 0, draw_random_field, args.images),
        ("random-fields", 101, draw_random_field, args.test_images),
        ("farm", 102, draw_farm, args.test_images),
    )
    sets = {}
    for name, stream, drawer, count in wanted:
        sets[name] = DataSet(
            folder=folder,
            name=name,
            stream=stream,
            seed=args.seed,
            views_per_scene=VIEWS_PER_SCENE,
        )
        sets[name].draw(count, drawer, progress)
    images, labels = _in_memory(sets.pop("train").read(args.images))
    recipe = TrainingPlan(steps=1)
    return Source(
        batches=_view_batches(images, labels, recipe),
        recipe=recipe,
        tests={name: partial(one.read, args.test_images) for name, one in sets.items()},
        train_images=args.images,
        input_size_px=(INPUT_HEIGHT_PX, INPUT_WIDTH_PX),
        antialias=False,
        about=SIM_TEXT,
        license=LICENSE,
        limits=SIM_LIMITS,
        command=f"agribot train --data sim --images {args.images} --test-images {args.test_images}",
    )


def photo_source(args: argparse.Namespace, progress: Progress) -> Source:
    """Photographs of a folder, all of them or all but one fold.

    Raises: ConfigError: no pairs, or an option out of range.
    """
    height_px, width_px = read_size(args.size)
    pairs, problems = find_pairs(args.data_dir, args.data)
    held: list[Pair] = []
    if args.fold is not None:
        pairs, held = fold_of(pairs, args.folds, args.fold)
    for text in problems:
        progress(f"left out: {text}")

    def note(text: str) -> None:
        problems.append(text)
        progress(f"left out: {text}")

    read = list(read_pairs(pairs, args.data, note))
    if not read:
        raise ConfigError(f"{args.data_dir}: no pair can be read; the first problem: {problems[0]}")
    fold = "" if args.fold is None else f" --folds {args.folds} --fold {args.fold}"
    recipe = TrainingPlan(
        steps=1,
        class_weights=PHOTO_WEIGHTS,
        overlap_loss=args.loss,
        data=f"{args.data}{fold} --train-width {args.train_width}",
    )
    scale = args.train_width / float(np.median([label.shape[1] for _, label in read]))
    return Source(
        batches=PhotoBatches(read, scale, recipe.batch_size, recipe.crop_px),
        recipe=recipe,
        tests={f"fold {args.fold} of {args.folds}": partial(read_pairs, held, args.data, note)}
        if held
        else {},
        train_images=len(read),
        input_size_px=(height_px, width_px),
        antialias=True,
        about=KINDS[args.data].about,
        license=KINDS[args.data].license,
        limits="judged on pictures of the same camera and field as it was trained on; other crops, "
        "soils and cameras were not measured.",
        command=f"agribot train --data {args.data} --data-dir DIR --model {args.model} "
        f"--loss {args.loss} --train-width {args.train_width} --size {args.size}{fold}",
        problems=tuple(problems),
    )


def read_size(text: str) -> tuple[int, int]:
    """(height, width) of "WIDTHxHEIGHT".

    Raises: ConfigError: not two multiples of the network's stride.
    """
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.isdigit() and int(word) for word in words):
        raise ConfigError(f"--size {text}: write width and height such as 512x384")
    width_px, height_px = (int(word) for word in words)
    if width_px % STRIDE_PX or height_px % STRIDE_PX:
        raise ConfigError(f"--size {text}: both must be multiples of {STRIDE_PX} pixels")
    return height_px, width_px


def _in_memory(
    pairs: Iterable[LabelledImage],
) -> tuple[list[ByteArray], list[ByteArray]]:
    images, labels = [], []
    for image_rgb, label in pairs:
        images.append(image_rgb)
        labels.append(label)
    return images, labels


def _view_batches(
    images: list[ByteArray], labels: list[ByteArray], recipe: TrainingPlan
) -> BatchSource:
    def batch(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        chosen = rng.integers(len(images), size=recipe.batch_size)
        return augmented_batch(
            [images[i] for i in chosen], [labels[i] for i in chosen], recipe.crop_px, rng
        )

    return batch


SIM_TEXT = (
    "images of AGRIBOT's own simulator: procedural crop fields with weeds in random soil, light, "
    "growth stage, density and camera pose, labelled by the renderer; no photograph was used"
)
