"""`agribot train`: draw images, train, judge on unseen scenes, export with a model card."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agribot.errors import ConfigError
from agribot.messages import ByteArray


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--data", choices=["sim"], default="sim", help="where images come from")
    parser.add_argument("--images", type=int, default=1500, help="training images to draw")
    parser.add_argument("--test-images", type=int, default=120, help="held-out images per test set")
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--minutes", type=float, default=20.0, help="CPU time of the training")
    budget.add_argument("--steps", type=int, help="optimiser steps, for an exact repetition")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1, help="CPU threads; part of the result")
    parser.add_argument("--name", default="agribot-sim", help="name of the network")
    parser.add_argument("--cache", type=Path, help="folder of drawn images (default: OUT/images)")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for checkpoint, log, weights and card"
    )


def run(args: argparse.Namespace) -> int:
    """Everything from images to a model card; goes on where an earlier call was stopped.

    Raises: ConfigError: an option is out of range.
    """
    _check(args)
    import torch

    from agribot.train.export import export_onnx
    from agribot.train.fit import Trainer

    torch.set_num_threads(args.threads)
    train_set, test_sets = _draw(args)
    images, labels = _in_memory(train_set.read(args.images))
    batches = _batch_source(images, labels)
    trainer = Trainer(_plan(args, batches), batches, args.out)
    network = trainer.run(_progress)
    onnx_path = args.out / f"{args.name}.onnx"
    export_onnx(network, onnx_path)
    card = _judge(args, trainer, onnx_path, test_sets)
    card.write(onnx_path)
    _progress(card.markdown())
    return 0


def _check(args: argparse.Namespace) -> None:
    for option in ("images", "test_images", "threads"):
        if getattr(args, option) < 1:
            flag = option.replace("_", "-")
            raise ConfigError(f"--{flag} is {getattr(args, option)}; it must be at least 1")
    if args.steps is not None and args.steps < 1:
        raise ConfigError(f"--steps is {args.steps}; it must be at least 1")
    if args.minutes <= 0.0:
        raise ConfigError(f"--minutes is {args.minutes}; it must be more than 0")


def _progress(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _draw(args: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """The training set and the held-out sets, drawn as far as they were missing."""
    from agribot.train.data import DataSet
    from agribot.train.farm import draw_farm
    from agribot.train.simulated import VIEWS_PER_SCENE, draw_random_field

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
        sets[name].draw(count, drawer, _progress)
    return sets.pop("train"), sets


def _in_memory(pairs: Any) -> tuple[list[ByteArray], list[ByteArray]]:
    images, labels = [], []
    for image_rgb, label in pairs:
        images.append(image_rgb)
        labels.append(label)
    return images, labels


def _batch_source(images: list[ByteArray], labels: list[ByteArray]) -> Callable[..., Any]:
    from agribot.train.augment import augmented_batch
    from agribot.train.fit import TrainingPlan

    defaults = TrainingPlan(steps=1)

    def batch(rng: np.random.Generator) -> Any:
        chosen = rng.integers(len(images), size=defaults.batch_size)
        return augmented_batch(
            [images[i] for i in chosen], [labels[i] for i in chosen], defaults.crop_px, rng
        )

    return batch


def _plan(args: argparse.Namespace, batches: Callable[..., Any]) -> Any:
    """The plan of a training under way in the folder, else a new one."""
    from agribot.train.fit import TrainingPlan, load_checkpoint, steps_within

    state = load_checkpoint(args.out)
    if state is not None and args.steps is None:
        plan = msgspec.convert(state["plan"], TrainingPlan)
        return msgspec.structs.replace(plan, seed=args.seed)
    plan = TrainingPlan(steps=args.steps or 1, seed=args.seed)
    if args.steps is None:
        plan = msgspec.structs.replace(plan, steps=1000)
        steps = steps_within(args.minutes, batches, plan, args.out)
        plan = msgspec.structs.replace(plan, steps=steps)
    return plan


def _judge(
    args: argparse.Namespace, trainer: Any, onnx_path: Path, test_sets: dict[str, Any]
) -> Any:
    """Scores of the exported file itself, run as the robot runs it."""
    from agribot.perceive.segmenter import Segmenter
    from agribot.train import card
    from agribot.train.evaluate import evaluate
    from agribot.train.network import parameter_count

    segmenter = Segmenter(onnx_path)
    tests = {
        name: evaluate(
            lambda image_rgb: segmenter.segment(image_rgb).class_id,
            test_set.read(args.test_images),
        )
        for name, test_set in test_sets.items()
    }
    return card.ModelCard(
        name=args.name,
        license=card.LICENSE,
        data=DATA_TEXT,
        command=(
            f"agribot train --data {args.data} --images {args.images} "
            f"--test-images {args.test_images} --steps {trainer.plan.steps} --seed {args.seed} "
            f"--threads {args.threads} --name {args.name} --out OUT"
        ),
        plan=trainer.plan,
        train_images=args.images,
        parameters=parameter_count(trainer.network),
        input_height_px=segmenter.map_shape[0],
        input_width_px=segmenter.map_shape[1],
        file_bytes=onnx_path.stat().st_size,
        sha256=card.sha256(onnx_path),
        cpu_ms_per_frame=round(card.cpu_ms_per_frame(segmenter), 1),
        cpu_ms_conditions=card.speed_conditions(threads=1),
        training_cpu_min=round(trainer.cpu_s / 60.0, 1),
        test=tests,
    )


DATA_TEXT = (
    "images of AGRIBOT's own simulator: procedural crop fields with weeds in random soil, light, "
    "growth stage, density and camera pose, labelled by the renderer; no photograph was used"
)
