"""`agribot train`: get images, train, judge on images never trained on, export with a card."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import msgspec

from agribot.errors import ConfigError

DATA_CHOICES = ("sim", "cwfid", "bonn", "phenobench", "folder")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data",
        choices=DATA_CHOICES,
        default="sim",
        help="where images come from: drawn by the simulator, or the layout of --data-dir",
    )
    parser.add_argument("--data-dir", type=Path, help="folder of photographs and masks")
    parser.add_argument("--model", help="network (default: agribot-sim for sim, else agribot-s)")
    parser.add_argument(
        "--loss",
        choices=("lovasz", "dice", "iou", "none"),
        default="lovasz",
        help="photographs: added to the cross-entropy (none: the original's loss alone)",
    )
    parser.add_argument("--folds", type=int, default=5, help="parts for cross-validation")
    parser.add_argument("--fold", type=int, help="part to hold out and judge on (default: none)")
    parser.add_argument("--size", default="512x384", help="input of the exported network, WxH px")
    parser.add_argument(
        "--train-width",
        type=int,
        default=512,
        help="px over which a photograph is seen in training",
    )
    parser.add_argument("--images", type=int, default=1500, help="sim: training images to draw")
    parser.add_argument("--test-images", type=int, default=120, help="sim: images per test set")
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--minutes", type=float, default=20.0, help="CPU time of the training")
    budget.add_argument("--steps", type=int, help="optimiser steps, for an exact repetition")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1, help="CPU threads; part of the result")
    parser.add_argument("--name", help="name of the weights (default: that of the network)")
    parser.add_argument(
        "--scores-from",
        type=Path,
        metavar="CARD.json",
        help="without --fold: card of the same recipe with a fold held out, to state its scores",
    )
    parser.add_argument("--cache", type=Path, help="sim: folder of drawn images (OUT/images)")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for checkpoint, log, weights and card"
    )


def run(args: argparse.Namespace) -> int:
    """Everything from images to a model card; goes on where an earlier call was stopped.

    Raises: ConfigError: an option is out of range.
    """
    _check(args)
    import torch

    from agribot.train.architectures import architecture
    from agribot.train.card import read_held_out
    from agribot.train.export import export_onnx
    from agribot.train.figures import write_curves
    from agribot.train.fit import LOG, Trainer

    torch.set_num_threads(args.threads)
    source = _source(args)
    plan = _plan(args, source)
    held_out = read_held_out(args.scores_from, plan) if args.scores_from else None
    trainer = Trainer(plan, source.batches, args.out)
    network = trainer.run(_progress)
    onnx_path = args.out / f"{args.name}.onnx"
    height_px, width_px = source.input_size_px
    features = architecture(args.model).features
    export_onnx(network, onnx_path, height_px, width_px, source.antialias, features)
    card = msgspec.structs.replace(_judge(args, trainer, onnx_path, source), held_out=held_out)
    card.write(onnx_path)
    write_curves(args.out / LOG, args.out / "training.png")
    _progress(card.markdown())
    return 1 if source.problems else 0


def _check(args: argparse.Namespace) -> None:
    for option in ("images", "test_images", "threads", "train_width"):
        if getattr(args, option) < 1:
            flag = option.replace("_", "-")
            raise ConfigError(f"--{flag} is {getattr(args, option)}; it must be at least 1")
    if args.steps is not None and args.steps < 1:
        raise ConfigError(f"--steps is {args.steps}; it must be at least 1")
    if args.minutes <= 0.0:
        raise ConfigError(f"--minutes is {args.minutes}; it must be more than 0")
    if (args.data == "sim") != (args.data_dir is None):
        raise ConfigError(
            f"--data {args.data} "
            + (
                "draws its own images; leave --data-dir out"
                if args.data_dir
                else "needs --data-dir"
            )
        )
    if args.scores_from and (args.data == "sim" or args.fold is not None):
        raise ConfigError("--scores-from is for photographs without --fold: this training has none")
    args.model = args.model or ("agribot-sim" if args.data == "sim" else "agribot-s")
    args.name = args.name or args.model


def _progress(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _source(args: argparse.Namespace) -> Any:
    if args.data == "sim":
        from agribot.train.sources import simulated_source

        return simulated_source(args, _progress)
    from agribot.train.sources import photo_source

    return photo_source(args, _progress)


def _plan(args: argparse.Namespace, source: Any) -> Any:
    """The plan of a training under way in the folder, else a new one."""
    from agribot.train.fit import TrainingPlan, load_checkpoint, steps_within

    state = load_checkpoint(args.out)
    if state is not None and args.steps is None:
        plan = msgspec.convert(state["plan"], TrainingPlan)
        return msgspec.structs.replace(
            plan,
            seed=args.seed,
            model=args.model,
            overlap_loss=source.recipe.overlap_loss,
            data=source.recipe.data,
        )
    plan = msgspec.structs.replace(
        source.recipe, steps=args.steps or 1000, seed=args.seed, model=args.model
    )
    if args.steps is None:
        steps = steps_within(args.minutes, source.batches, plan, args.out)
        plan = msgspec.structs.replace(plan, steps=steps)
    return plan


def _judge(args: argparse.Namespace, trainer: Any, onnx_path: Path, source: Any) -> Any:
    """Scores of the exported file itself, run as the robot runs it."""
    from agribot.perceive.pictures import classify
    from agribot.perceive.segmenter import Segmenter
    from agribot.train import card
    from agribot.train.evaluate import evaluate
    from agribot.train.network import parameter_count

    segmenter = Segmenter(onnx_path)
    tests = {
        name: evaluate(lambda image_rgb: classify(segmenter, image_rgb).class_id, pairs())
        for name, pairs in source.tests.items()
    }
    return card.ModelCard(
        name=args.name,
        license=source.license,
        data=source.about,
        limits=source.limits,
        chosen_blind=args.data == "sim",
        command=f"{source.command} --steps {trainer.plan.steps} --seed {args.seed} "
        f"--threads {args.threads} --name {args.name} "
        + ("--scores-from CARD.json " if args.scores_from else "")
        + "--out OUT",
        plan=trainer.plan,
        train_images=source.train_images,
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
