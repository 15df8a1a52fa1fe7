"""Batches of several sets of photographs, and of drawn images beside them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.farm import draw_row_crop
from agribot.lab.train.fit import Progress, TrainingPlan
from agribot.lab.train.loader import BatchSource
from agribot.lab.train.losses import IGNORED, OF_ROWS
from agribot.lab.train.photo_batches import ALONG_ROWS, STRAIGHT_DOWN, PhotoBatches
from agribot.lab.train.photo_reading import PhotoSet
from agribot.lab.train.picture_stack import PictureStack
from agribot.lab.train.plant_targets import make_class_targets
from agribot.lab.train.plant_truth import DrawnView
from agribot.lab.train.simulated import draw_random_field
from agribot.lab.train.sources import TAUGHT, WantedSet, count_further, draw_set, make_batches
from agribot.sim.random_scenes import DENSE, STANDARD

FIRST_SHARE = 2.0 / 3.0  # share of the crops of photographs from the first of several sets


def count_drawn(args: argparse.Namespace) -> int:
    """Count the drawn images beside photographs."""
    further: int = sum(count_further(args).values())
    return further + int(args.with_sim)


def mix_sets(
    sets: Sequence[PhotoSet], count: int, args: argparse.Namespace, size_px: tuple[int, int]
) -> BatchSource:
    """Cut `count` crops from photographs, two thirds of them from the first of several sets."""
    if len(sets) == 1:
        return _cut_crops(sets[0], count, args, size_px)
    sources = [
        _mark_rows(_cut_crops(one, 1, args, size_px))
        if one.show_rows
        else _cut_crops(one, 1, args, size_px)
        for one in sets
    ]
    others = (1.0 - FIRST_SHARE) / (len(sets) - 1)
    shares = [FIRST_SHARE, *[others] * (len(sets) - 1)]

    def draw(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        chosen = rng.choice(len(sources), size=count, p=shares)
        return _join(*(sources[index](rng) for index in chosen))

    return draw


def _cut_crops(
    read: PhotoSet, count: int, args: argparse.Namespace, size_px: tuple[int, int]
) -> BatchSource:
    """Cut crops of pictures in the shape in which the network of (height, width) sees them."""
    height_px, width_px = np.median(np.array(read.shapes_px), axis=0)
    return PhotoBatches(
        read.files,
        float(args.train_width / width_px),
        count,
        args.crop_px,
        view=ALONG_ROWS if read.show_rows else STRAIGHT_DOWN,
        stretch=float(size_px[0] / size_px[1] * width_px / height_px),
    )


def _mark_rows(crops: BatchSource) -> BatchSource:
    """Mark labels as those of drawn rows, as of `losses.mixed_loss`."""

    def draw(rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        images, label = crops(rng)
        return images, torch.where(label == IGNORED, label, label + OF_ROWS)

    return draw


def add_drawn(
    photos: BatchSource,
    count: int,
    args: argparse.Namespace,
    recipe: TrainingPlan,
    progress: Progress,
) -> BatchSource:
    """Add `count` crops of drawn images to every batch."""
    if find_architecture(args.model).finds_plants:
        return mix_with_plants(photos, draw_plants(args, progress), count, recipe)
    images = [
        picture
        for one in _list_sets(args, has_plants=False)
        for picture in draw_set(args, one, progress).read(one.images)
    ]
    drawn = make_batches(PictureStack(images, len(images)), count, recipe.crop_px)
    return lambda rng: _join(photos(rng), drawn(rng))


def draw_plants(args: argparse.Namespace, progress: Progress) -> list[DrawnView]:
    """Draw dense fields, half of them seen by the robot along rows: what keeps stems in mind."""
    return [
        view
        for one in _list_sets(args, has_plants=True)
        for view in draw_set(args, one, progress, has_plants=True).read_views(one.images)
    ]


def _list_sets(args: argparse.Namespace, *, has_plants: bool) -> list[WantedSet]:
    """List the drawn sets beside photographs: fields from masts, with plants rows, and others."""
    variety = DENSE if has_plants else STANDARD
    masts = args.with_sim // 2 if has_plants else args.with_sim
    sets = [
        WantedSet("train-random", 0, draw_random_field, variety, masts),
        WantedSet("train-rows", 1, draw_row_crop, variety, args.with_sim - masts),
    ]
    for name, images in count_further(args).items():
        stream, drawer, is_usual = TAUGHT[name]
        sets.append(WantedSet(name, stream, drawer, STANDARD if is_usual else variety, images))
    return [one for one in sets if one.images]


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
