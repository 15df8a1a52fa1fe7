"""`agribot train`: get images, train, score on images never trained on, export with a card."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import msgspec

from agribot.cli.data.train_options import (
    add_drawn_options,
    add_recipe_options,
    apply_recipe_options,
    check_drawn_options,
    check_recipe_options,
)
from agribot.cli.ids_option import add_ids_option
from agribot.cli.misplaced_option import add_misplaced_option
from agribot.cli.ranges import check_above, check_within, finite, seed
from agribot.core.errors import ConfigError
from agribot.lab.train.networks import STRIDE_PX, read_size

MOST_WORKERS = 64
DATA_CHOICES = ("sim", "cwfid", "bonn", "phenobench", "folder", "rows")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data",
        choices=DATA_CHOICES,
        default="sim",
        help="where images come from: drawn by the simulator, or the layout of --data-dir",
    )
    parser.add_argument("--model", help="network (default: agribot-sim for sim, else agribot-s)")
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--minutes", type=finite, default=20.0, help="CPU time of the steps")
    budget.add_argument("--steps", type=int, help="optimiser steps, for an exact repetition")
    parser.add_argument("--seed", type=seed, default=0)
    parser.add_argument("--threads", type=int, default=1, help="CPU threads; part of the result")
    parser.add_argument(
        "--workers", type=int, default=0, metavar="N",
        help="processes that draw images, and threads that draw batches ahead; the weights are the "
        "same (default: none)",
    )  # fmt: skip
    parser.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), default="auto", help="auto: a GPU if any"
    )
    parser.add_argument(
        "--precision", choices=("fp32", "int8"), default="fp32",
        help="numbers of the file that is written; int8 keeps NAME-fp32.onnx beside it",
    )  # fmt: skip
    parser.add_argument("--name", help="name of the weights (default: that of the network)")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for checkpoint, log, weights and card"
    )
    add_recipe_options(parser.add_argument_group("how it learns"))
    add_drawn_options(parser.add_argument_group("drawn images"))
    photographs = parser.add_argument_group("photographs")
    _add_photographs(photographs)
    _add_mix(photographs)


def _add_photographs(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--data-dir", type=Path, help="folder of photographs and masks")
    add_ids_option(group)
    add_misplaced_option(group)
    group.add_argument(
        "--loss",
        choices=(
            "lovasz",
            "dice",
            "dice-pooled",
            "dice-squared",
            "dice-generalised",
            "iou",
            "none",
        ),
        default="lovasz",
        help="added to the cross-entropy (none: the original's loss alone); dice: mean over the "
        "classes of a batch; dice-pooled: all classes as one; dice-squared: over sums of squares, "
        "picture by picture; dice-generalised: each class by 1 / its area squared",
    )
    group.add_argument("--folds", type=int, default=5, help="parts for cross-validation")
    group.add_argument("--fold", type=int, help="part to hold out and judge on (default: none)")
    group.add_argument("--size", default="512x384", help="input of the exported network, WxH px")
    group.add_argument(
        "--train-width", type=int, default=512, help="px over which a photograph is trained on"
    )
    group.add_argument(
        "--scores-from",
        type=Path,
        metavar="CARD.json",
        help="without --fold: card of the same recipe with a fold held out, to state its scores "
        "and take over how sure it is",
    )


def _add_mix(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--with",
        dest="with_photographs",
        action="append",
        default=[],
        metavar="KIND=FOLDER",
        help="another folder to learn from as well, of a kind as of --data; that of --data-dir "
        "gives two thirds of the photographs in a batch; may be repeated",
    )
    group.add_argument(
        "--with-sim",
        type=int,
        default=0,
        metavar="N",
        help="N drawn images beside photographs; --front-images, --seedling-images and "
        "--usual-images add theirs",
    )
    group.add_argument(
        "--drawn-share",
        type=finite,
        default=0.25,
        metavar="SHARE",
        help="share of every batch from drawn images, where there are any (default: 0.25)",
    )


def run(args: argparse.Namespace) -> int:
    """Do everything from images to a model card; continue where an earlier call was stopped.

    Raises: ConfigError: an option is out of range.
    """
    from agribot.lab.train.cpu_meter import CpuMeter

    meter = CpuMeter()
    _check(args)
    from agribot.lab.train.processes import join_group, leave_group, use_threads

    use_threads(args.threads)
    group = join_group(args.device)
    try:
        source = group.run_leader_first(lambda: _make_source(args, group.device))
        plan = _make_plan(args, source, group)
        return _train(args, source, plan, group, meter)
    finally:
        leave_group()


def _train(args: argparse.Namespace, source: Any, plan: Any, group: Any, meter: Any) -> int:
    from agribot.lab.train.architectures import find_architecture
    from agribot.lab.train.card import read_held_out
    from agribot.lab.train.export import export_onnx
    from agribot.lab.train.figures import write_curves
    from agribot.lab.train.fit import LOG, Trainer
    from agribot.lab.train.precision import quantise_to_int8, sample_pictures

    held_out = read_held_out(args.scores_from, plan) if args.scores_from else None
    trainer = Trainer(
        plan, source.batches, args.out, group, args.start, source.judge, args.workers, meter
    )
    network = trainer.run(_print_progress if group.is_leader else lambda text: None).cpu()
    if not group.is_leader:
        return 0
    if args.blend < 1.0:
        network = _blend(network, args, source)
    onnx_path = args.out / f"{args.name}.onnx"
    features = find_architecture(args.model).features
    if source.aside is not None:
        _print_progress("finding how sure it may be on pictures set aside")
    calibration = _calibrate(network, features, source)
    kept_temperatures = keep_temperatures(args)
    height_px, width_px = source.input_size_px
    is_small = args.precision == "int8"
    plain_path = args.out / f"{args.name}-fp32.onnx" if is_small else onnx_path
    _print_progress(f"writing {plain_path}")
    export_onnx(
        network,
        plain_path,
        height_px,
        width_px,
        antialias=source.antialias,
        features=features,
        temperatures=_choose_temperatures(calibration, kept_temperatures, held_out),
    )
    if is_small:
        _print_progress(f"writing {onnx_path} with 8-bit numbers")
        quantise_to_int8(plain_path, onnx_path, sample_pictures(source.pictures))
    card = msgspec.structs.replace(
        _evaluate(args, trainer, onnx_path, source),
        held_out=held_out,
        calibration=calibration,
        kept_temperatures=kept_temperatures,
    )
    card.write(onnx_path)
    write_curves(args.out / LOG, args.out / "training.png")
    _print_progress(card.markdown())
    _print_progress(f"done: {meter.spent_s / 60.0:.1f} CPU-min in all")
    return 1 if source.problems else 0


def _blend(network: Any, args: argparse.Namespace, source: Any) -> Any:
    import numpy as np

    from agribot.lab.train.architectures import find_architecture
    from agribot.lab.train.blend import blend_weights

    images, _ = source.batches(np.random.default_rng(args.seed))
    x = find_architecture(args.model).features(images.cpu())
    return blend_weights(network, args.blend_with or args.start, args.blend, x)


def _check(args: argparse.Namespace) -> None:
    read_size(args.size, STRIDE_PX)
    if args.fold is not None:
        check_within("--fold", args.fold, 0, args.folds - 1, "of --folds")
    for option in ("images", "test_images", "threads", "train_width", "crop_px", "batch_size"):
        check_within(f"--{option.replace('_', '-')}", getattr(args, option), 1)
    if args.crop_px % STRIDE_PX:
        raise ConfigError(f"--crop-px {args.crop_px}: out of step; give a multiple of {STRIDE_PX}")
    check_drawn_options(args)
    if args.steps is not None:
        check_within("--steps", args.steps, 1)
    check_within("--workers", args.workers, 0, MOST_WORKERS)
    check_above("--minutes", args.minutes, 0.0)
    if (args.data == "sim") != (args.data_dir is None):
        raise ConfigError(
            f"--data {args.data} "
            + (
                "draws its own images; leave --data-dir out"
                if args.data_dir
                else "needs --data-dir"
            )
        )
    _check_mix(args)
    if args.scores_from and (args.data == "sim" or args.fold is not None):
        raise ConfigError("--scores-from is for photographs without --fold; leave it out")
    _fill_in_names(args)
    check_recipe_options(args)


def _check_mix(args: argparse.Namespace) -> None:
    """Refuse photographs beside drawn images alone, and a share that leaves one of both out."""
    if args.with_photographs and args.data == "sim":
        raise ConfigError(
            f"--with {args.with_photographs[0]}: adds to the photographs of --data-dir; give them "
            "as --data and --data-dir, and drawn images as --with-sim N"
        )
    if not 0.0 < args.drawn_share < 1.0:
        raise ConfigError(
            f"--drawn-share {args.drawn_share:g}: out of range; give more than 0 and below 1"
        )


def _fill_in_names(args: argparse.Namespace) -> None:
    args.model = args.model or ("agribot-sim" if args.data == "sim" else "agribot-s")
    args.name = args.name or args.model
    if Path(args.name).name != args.name:
        raise ConfigError(f"--name {args.name}: a name without folders; --out says where it goes")


def _print_progress(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _make_source(args: argparse.Namespace, device: str) -> Any:
    if args.data == "sim":
        from agribot.lab.train.sources import make_simulated_source

        return make_simulated_source(args, _print_progress, device)
    from agribot.lab.train.photo_source import make_photo_source

    return make_photo_source(args, _print_progress)


def _make_plan(args: argparse.Namespace, source: Any, group: Any) -> Any:
    """Make the plan; a training under way in the folder says how many steps fit into --minutes.

    Raises: ConfigError: processes that measure how many steps fit in would not agree.
    """
    from agribot.lab.train.fit import count_steps_within, load_checkpoint

    if group.size > 1 and args.steps is None:
        raise ConfigError(f"{group.size} processes train together; give --steps, not --minutes")
    plan = msgspec.structs.replace(
        source.recipe,
        steps=args.steps or 1000,
        seed=args.seed,
        model=args.model,
        processes=group.size,
    )
    plan = apply_recipe_options(plan, args)
    if args.weighting:
        plan = _weigh_classes(plan, source, args.weighting, group)
    if args.steps is None:
        state = load_checkpoint(args.out)
        steps = (
            count_steps_within(args.minutes, source.batches, plan, args.out, group)
            if state is None
            else state["plan"]["steps"]
        )
        plan = msgspec.structs.replace(plan, steps=steps)
    return plan


def _weigh_classes(plan: Any, source: Any, weighting: str, group: Any) -> Any:
    """Compute the class weights from the labels of the pictures to train on, and print them.

    Raises: ConfigError: a class that they lack.
    """
    from agribot.lab.train.class_weights import compute_weights, count_classes, describe_weights

    counts = count_classes(source.labels())
    weights = compute_weights(counts, weighting)
    words = describe_weights(counts, weights, weighting)
    if group.is_leader:
        _print_progress(words)
    return msgspec.structs.replace(plan, class_weights=weights, class_weighting=words)


def _calibrate(network: Any, features: Any, source: Any) -> Any:
    """Find temperatures on the images set aside; where they are those of the test, by turns."""
    if source.aside is None:
        return None
    import itertools

    from agribot.lab.train.calibration import calibrate
    from agribot.lab.train.export import make_deployed

    height_px, width_px = source.input_size_px
    deployed = make_deployed(network, height_px, width_px, features).eval()
    others = [] if source.has_tests_aside else source.tests.values()
    tests = itertools.chain.from_iterable(pairs() for pairs in others)
    return calibrate(deployed.logits, source.aside(), tests)


def keep_temperatures(args: argparse.Namespace) -> Any:
    """Return those of weights whose classes are kept; None for a network that learns its own."""
    from agribot.lab.train.export import read_temperatures

    return read_temperatures(args.start) if args.keep_classes else None


def _choose_temperatures(calibration: Any, kept: Any, held_out: Any) -> Any:
    """Take the network's own, those of its start, or those of a training that held images out."""
    from agribot.lab.train.calibration import AS_TRAINED

    found = calibration or (held_out.calibration if held_out else None)
    return found.temperatures if found else kept or AS_TRAINED


def _evaluate(args: argparse.Namespace, trainer: Any, onnx_path: Path, source: Any) -> Any:
    """Score the exported file itself, run as the robot runs it."""
    from agribot.autonomy.perceive.pictures import classify
    from agribot.autonomy.perceive.segmenter import Segmenter
    from agribot.lab.train import card
    from agribot.lab.train.evaluate import evaluate
    from agribot.lab.train.network import count_parameters

    segmenter = Segmenter(onnx_path)
    tests = {}
    for name, pairs in source.tests.items():
        _print_progress(f"judging on {name}")
        tests[name] = evaluate(lambda image_rgb: classify(segmenter, image_rgb).class_id, pairs())
    plants = _judge_plants(args, onnx_path) if segmenter.finds_plants else {}
    return card.ModelCard(
        name=args.name,
        license=source.license,
        data=source.about,
        limits=source.limits,
        chosen_blind=args.data == "sim",
        command=f"{source.command} --steps {trainer.plan.steps} --seed {args.seed} "
        f"--threads {args.threads} --name {args.name} "
        + args.recipe_words
        + ("--precision int8 " if args.precision == "int8" else "")
        + ("--scores-from CARD.json " if args.scores_from else "")
        + "--out OUT",
        plan=trainer.plan,
        train_images=source.train_images,
        precision=args.precision,
        most_doubt=_limit_doubt(segmenter, source),
        parameters=count_parameters(trainer.network),
        input_height_px=segmenter.map_shape[0],
        input_width_px=segmenter.map_shape[1],
        file_bytes=onnx_path.stat().st_size,
        sha256=card.hash_file(onnx_path),
        cpu_ms_per_frame=round(card.measure_cpu_ms_per_frame(segmenter), 1),
        cpu_ms_conditions=card.describe_speed_conditions(threads=1),
        training_cpu_min=round(trainer.meter.spent_s / 60.0, 1),
        training_device=trainer.device_name,
        test=tests,
        plants=plants,
    )


def _limit_doubt(segmenter: Any, source: Any) -> float | None:
    from agribot.lab.train.doubt_limit import find_most_doubt
    from agribot.lab.train.precision import sample_pictures

    if not segmenter.finds_plants:
        return None
    return find_most_doubt(segmenter, sample_pictures(source.pictures))


def _judge_plants(args: argparse.Namespace, onnx_path: Path) -> Any:
    """Judge single plants, scene by scene and all together."""
    from agribot.lab.bench.plant_scenes import SCENES
    from agribot.lab.bench.plants import FRAMES, judge_scenes, list_scores

    _print_progress("judging on single plants of drawn scenes")
    frames = min(FRAMES, args.test_images)
    scenes = list(SCENES.values())
    return list_scores(judge_scenes(scenes, str(onnx_path), frames=frames, seed=args.seed))
