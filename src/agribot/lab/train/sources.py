"""The data of a training that the simulator draws."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
from torch import Tensor

from agribot.core.messages import ByteArray
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.augment import augment_batch
from agribot.lab.train.card import LICENSE, SIM_LIMITS
from agribot.lab.train.data import DataSet, LabelledImage
from agribot.lab.train.export import INPUT_HEIGHT_PX, INPUT_WIDTH_PX
from agribot.lab.train.farm import draw_farm, draw_row_crop, draw_turn
from agribot.lab.train.fit import Progress, TrainingPlan
from agribot.lab.train.loader import BatchSource
from agribot.lab.train.picture_stack import PictureStack
from agribot.lab.train.plant_targets import augment_views
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.precision import sample_pictures
from agribot.lab.train.simulated import (
    ROUGH_VIEWS_PER_SCENE,
    TAUGHT_VIEWS_PER_SCENE,
    VIEWS_PER_SCENE,
    draw_front,
    draw_random_field,
    draw_seedlings,
)
from agribot.lab.train.standing import Judge
from agribot.lab.train.validation import HeldOutPictures
from agribot.sim.random_scenes import STANDARD, VARIETIES, Variety

VariedDrawer = Callable[..., Iterator[DrawnView]]  # drawer of a scene; all but one of any variety
CROP_PX = 320
BATCH_SIZE = 8
FOLDERS = {one: "" if one is STANDARD else name for name, one in VARIETIES.items()}


# Sets that a network learns from, and is judged on while it learns: stream and drawer of each, and
# whether its fields are those of the standard variety.
TAUGHT: dict[str, tuple[int, VariedDrawer, bool]] = {
    "train-random": (0, draw_random_field, False),
    "train-rows": (1, draw_row_crop, False),
    "train-turns": (2, draw_turn, False),
    "train-usual-rows": (113, draw_row_crop, True),
    "train-usual-turns": (114, draw_turn, True),
    "train-seedlings": (117, draw_seedlings, False),
    "train-front": (118, draw_front, False),
    "valid-random": (109, draw_random_field, False),
    "valid-rows": (110, draw_row_crop, False),
    "valid-usual-rows": (115, draw_row_crop, True),
    "valid-usual-turns": (116, draw_turn, True),
}


class WantedSet(NamedTuple):
    """A set of images to be drawn, each of its own stream of random numbers."""

    name: str
    stream: int
    drawer: VariedDrawer
    variety: Variety
    images: int


class TrainingSource(msgspec.Struct, frozen=True, kw_only=True):
    """The data; `tests` are sets without any training image, `problems` unreadable files.

    `aside` are images that only give the temperatures of the confidence; None keeps it
    unchanged. Where no others are left for that, `has_tests_aside`: they are those of `tests`.
    `judge` looks at pictures that are for nothing but the curve of the training and its best step.
    """

    batches: BatchSource
    recipe: TrainingPlan
    labels: Callable[[], Iterable[ByteArray]]  # labels of the pictures to train on
    tests: dict[str, Callable[[], Iterable[LabelledImage]]]
    aside: Callable[[], Iterable[LabelledImage]] | None = None
    has_tests_aside: bool = False
    judge: Judge | None = None
    pictures: Sequence[
        ByteArray
    ]  # some that were trained on, for 8-bit numbers and the limit of doubt
    train_images: int
    input_size_px: tuple[int, int]  # height, width
    antialias: bool
    about: str
    license: str
    limits: str
    command: str
    problems: tuple[str, ...] = ()


def make_simulated_source(
    args: argparse.Namespace, progress: Progress, device: str = "cpu"
) -> TrainingSource:
    """Draw what is missing of the training sets and the held-out sets.

    The pictures to train on lie in the memory of `device`, where batches are cut from them.
    """
    counts, judged = _count_training(args), _count_validation(args)
    finds_plants = find_architecture(args.model).finds_plants
    learns_classes = not args.keep_classes
    sets = _draw_sets(args, counts | judged, progress, finds_plants, learns_classes)
    trained = [(sets.pop(name), count) for name, count in counts.items()]
    recipe = TrainingPlan(
        steps=1,
        batch_size=args.batch_size,
        crop_px=args.crop_px,
        data=f"sim --variety {args.variety}",
    )
    judge = _make_view_judge(args, [(sets.pop(name), count) for name, count in judged.items()])
    stack = PictureStack(
        itertools.chain.from_iterable(
            one.read_views(count) if finds_plants else one.read(count) for one, count in trained
        ),
        sum(counts.values()),
        device,
    )
    batches = make_batches(stack, args.batch_size, args.crop_px)
    aside = None
    if learns_classes:
        asides = sets.pop("aside-random"), sets.pop("aside-rows")
        aside = partial(_read_all, asides, _count_aside(args))
    return TrainingSource(
        aside=aside,
        judge=judge,
        batches=batches,
        labels=lambda: (label.numpy(force=True) for label in stack.labels),
        pictures=_copy_sample(stack),
        recipe=recipe,
        tests={name: partial(one.read, args.test_images) for name, one in sets.items()},
        train_images=sum(counts.values()),
        input_size_px=(INPUT_HEIGHT_PX, INPUT_WIDTH_PX),
        antialias=False,
        about=f"{SIM_TEXT}{VARIETY_TEXTS.get(args.variety, '')}"
        f"{SEEDLING_TEXT if args.seedling_images else ''}"
        f"{FRONT_TEXT if args.front_images else ''}; no photograph was used",
        license=LICENSE,
        limits=SIM_LIMITS,
        command=_format_command(args),
    )


def _format_command(args: argparse.Namespace) -> str:
    """Write what was asked as a command; the network is named where it finds plants."""
    words = f" --model {args.model}" if find_architecture(args.model).finds_plants else ""
    words += f" --batch-size {args.batch_size}" if args.batch_size != BATCH_SIZE else ""
    words += f" --crop-px {args.crop_px}" if args.crop_px != CROP_PX else ""
    return (
        f"agribot train --data sim --variety {args.variety}{words} --images {args.images} "
        f"--row-images {args.row_images} --turn-images {args.turn_images}{format_further(args)} "
        f"--test-images {args.test_images}"
    )


def format_further(args: argparse.Namespace) -> str:
    """Return the options of further drawn images, each with a space before it."""
    asked = {name: getattr(args, f"{name}_images") for name in ("usual", "seedling", "front")}
    return "".join(f" --{name}-images {count}" for name, count in asked.items() if count)


def _make_view_judge(args: argparse.Namespace, sets: list[tuple[DataSet, int]]) -> Judge | None:
    pictures: list[LabelledImage | DrawnView] = []
    for one, count in sets:
        pictures += one.read_views(count) if one.has_plants else one.read(count)
    if not pictures:
        return None
    features = find_architecture(args.model).features
    return HeldOutPictures(pictures, (INPUT_HEIGHT_PX, INPUT_WIDTH_PX), features)


def _count_training(args: argparse.Namespace) -> dict[str, int]:
    own = {
        "train-random": args.images - args.row_images - args.turn_images,
        "train-rows": args.row_images,
        "train-turns": args.turn_images,
    }
    return own | count_further(args)


def count_further(args: argparse.Namespace) -> dict[str, int]:
    """Count the images drawn beside those of a variety, by set; empty sets are left out."""
    own = {"train-seedlings": args.seedling_images, "train-front": args.front_images}
    asked = {name: count for name, count in own.items() if count}
    return asked | _halve("train-usual", args.usual_images)


def _count_validation(args: argparse.Namespace) -> dict[str, int]:
    count = args.validate or 0
    usual = count // 2 if args.usual_images else 0
    masts = (count - usual) // 2
    own = {"valid-random": masts, "valid-rows": count - usual - masts}
    return own | _halve("valid-usual", usual)


def _halve(name: str, images: int) -> dict[str, int]:
    """Count the images along rows and those in turns; empty for 0 images."""
    turns = images // 2
    return {f"{name}-rows": images - turns, f"{name}-turns": turns} if images else {}


def _count_aside(args: argparse.Namespace) -> int:
    """Count the images of each set that only the temperature comes from."""
    half: int = args.test_images // 2
    return max(1, half)


def _read_all(sets: Iterable[DataSet], count: int) -> Iterator[LabelledImage]:
    return itertools.chain.from_iterable(one.read(count) for one in sets)


def _draw_sets(
    args: argparse.Namespace,
    taught: dict[str, int],
    progress: Progress,
    has_plants: bool,
    sets_aside: bool,
) -> dict[str, DataSet]:
    """Draw the sets, with plants those of the variety's own, and some to be set aside."""
    own = VARIETIES[args.variety]
    usual = STANDARD if own.rough_share else own  # a test set that others have too
    wanted = [
        *(
            WantedSet(name, stream, drawer, STANDARD if is_usual else own, taught[name])
            for name, (stream, drawer, is_usual) in TAUGHT.items()
            if name in taught
        ),
        WantedSet("random-fields", 101, draw_random_field, usual, args.test_images),
        WantedSet("farm", 102, draw_farm, usual, args.test_images),
        WantedSet("row-crops", 103, draw_row_crop, usual, args.test_images),
        WantedSet("turns", 106, draw_turn, usual, args.test_images),
    ]
    if sets_aside:
        wanted += [
            WantedSet("aside-random", 104, draw_random_field, own, _count_aside(args)),
            WantedSet("aside-rows", 105, draw_row_crop, own, _count_aside(args)),
        ]
    if own.rough_share:
        wanted += [
            WantedSet(f"{args.variety}-fields", 107, draw_random_field, own, args.test_images),
            WantedSet(f"{args.variety}-rows", 108, draw_row_crop, own, args.test_images),
        ]
    return {
        one.name: draw_set(
            args,
            one,
            progress,
            has_plants=has_plants and (one.name in taught or one.variety is own),
        )
        for one in wanted
    }


def draw_set(
    args: argparse.Namespace, wanted: WantedSet, progress: Progress, *, has_plants: bool = False
) -> DataSet:
    """Draw the images of a set that are not in its folder yet."""
    name, stream, drawer, variety, images = wanted
    drawn = DataSet(
        folder=(args.cache or args.out / "images") / FOLDERS[variety],
        name=name,
        stream=stream,
        seed=args.seed,
        views_per_scene=_count_views(wanted),
        has_plants=has_plants,
    )
    drawn.draw(
        images,
        drawer if drawer is draw_farm else partial(drawer, variety=variety),
        progress,
        max(1, args.workers),
    )
    return drawn


def _count_views(wanted: WantedSet) -> int:
    """Count the views of each scene of a set."""
    if not wanted.variety.rough_share or wanted.drawer in {draw_seedlings, draw_front}:
        return VIEWS_PER_SCENE
    return TAUGHT_VIEWS_PER_SCENE if wanted.name in TAUGHT else ROUGH_VIEWS_PER_SCENE


def _copy_sample(stack: PictureStack) -> list[ByteArray]:
    """Copy some of the pictures, on which 8-bit numbers are calibrated and doubt is limited."""
    return [stack.images[index].cpu().numpy() for index in sample_pictures(range(len(stack)))]


def make_batches(stack: PictureStack, count: int, crop_px: int) -> BatchSource:
    """Draw batches with classes, or of pictures with plants with the targets of stems as well."""
    augment = augment_views if stack.has_plants else augment_batch

    def batch(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        return augment(stack, count, crop_px, rng)

    return batch


SIM_TEXT = (
    "images of AGRIBOT's own simulator: procedural fields of several crops and weeds in random "
    "soil, light, growth stage and density, some from random camera poses, the others from the "
    "robot's own camera along and beside rows, labelled by the renderer"
)
SEEDLING_TEXT = (
    "; young carrots or parsley among weeds from close above, half of them in red and near infrared"
)
FRONT_TEXT = (
    "; rows from the camera to the horizon, of stony or bare fields in any light, as the front "
    "camera of a robot sees them"
)
VARIETY_TEXTS = {
    "rough": "; five crops from seedlings on, half of the fields with the relief, litter, "
    "moisture, light and sowing errors of the presets field and hard",
    "dense": "; five crops from seedlings to rows that close, 5 cm to 1.5 m from plant to plant, "
    "up to 80 weeds on a square metre, six fields of ten with the relief, litter, moisture, light "
    "and sowing errors of the presets field and hard, posts on three of ten",
}
