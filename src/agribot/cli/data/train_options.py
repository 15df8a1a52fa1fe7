"""The options of `agribot train`: what is drawn, how a network begins and how it learns."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import msgspec

from agribot.cli.ranges import check_above, check_within, finite
from agribot.core.errors import ConfigError
from agribot.core.messages import PlantClass

HIGHEST_RATE = 1.0
VALIDATION_VIEWS = 24
STEM_VIEWS = 150  # drawn, beside photographs


def add_recipe_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--start",
        metavar="MODEL",
        help="begin with these weights of the same network, a name or an .onnx file; imagenet: "
        "an encoder that has learned there (the default of agribot-s and agribot-m); random",
    )
    group.add_argument(
        "--blend",
        type=finite,
        default=1.0,
        metavar="SHARE",
        help="with --start: write weights at SHARE of the way from its own to those learned, "
        "0.5 half-way, which know nearly all of both (default: 1)",
    )
    group.add_argument(
        "--blend-with",
        metavar="MODEL",
        help="with --blend: begin at these weights instead, of another network of the same kind",
    )
    _add_weight_options(group)
    _add_memory_options(group)
    group.add_argument("--crop-px", type=int, default=320, help="width of the crops trained on")
    group.add_argument("--batch-size", type=int, default=8, help="crops in a step")
    group.add_argument(
        "--validate",
        type=int,
        default=None,
        metavar="N",
        help="pictures set aside, from which alone the curve of the training comes, the step whose "
        "weights are kept and, of photographs, how sure the network is (default: 24 drawn images, "
        "no photograph)",
    )
    group.add_argument(
        "--keep-classes",
        action="store_true",
        help="of a network that finds plants: only the stems learn, the classes of the weights "
        "that it begins with stay as they are",
    )


def _add_weight_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--class-weights",
        metavar="WEED,CROP,SOIL|HOW",
        help="in the cross-entropy (default: 1,2,0.6 for photographs, 1,1,0.6 for drawn images), "
        "or how they come from the labels: median-frequency, inverse-frequency, inverse-root, "
        "which is auto",
    )
    group.add_argument(
        "--learning-rate",
        type=float,
        metavar="RATE",
        help="at its highest (default: 0.003; 0.0015 with imagenet, 0.001 with another start)",
    )


def _add_memory_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--keep-norms",
        action="store_true",
        help="with --start: normalisations keep the statistics that they begin with",
    )
    group.add_argument(
        "--remember",
        type=finite,
        default=0.0,
        metavar="WEIGHT",
        help="with --start and photographs, of a network that finds plants: on drawn images it "
        "learns its first answers as well, by this weight in the loss, such as 1 (default: 0)",
    )


def check_recipe_options(args: argparse.Namespace) -> None:
    """Make a path of `args.start`, or None where the plan says how to begin.

    `args.asked` becomes what the plan has to hold instead of its own.

    Raises: ConfigError: an option that is out of range, or no such network.
    """
    from agribot.autonomy.perceive.segmenter import model_path
    from agribot.lab.train.architectures import find_architecture
    from agribot.lab.train.class_weights import WEIGHTINGS
    from agribot.lab.train.start import IMAGENET, RANDOM

    args.asked = {}
    args.weighting = args.class_weights if args.class_weights in WEIGHTINGS else ""
    if args.class_weights is not None and not args.weighting:
        args.asked["class_weights"] = read_class_weights(args.class_weights)
    if args.learning_rate is not None:
        check_above("--learning-rate", args.learning_rate, 0.0, HIGHEST_RATE)
        args.asked["learning_rate"] = args.learning_rate
    if args.validate is None:
        args.validate = VALIDATION_VIEWS if args.data == "sim" else 0
    check_within("--validate", args.validate, 0)
    usual = IMAGENET if find_architecture(args.model).load_imagenet else RANDOM
    wanted = args.start or usual
    args.is_imagenet = wanted == IMAGENET
    args.recipe_words = _format_options(args, "" if wanted == usual else Path(wanted).name)
    args.start = None if wanted in {IMAGENET, RANDOM} else model_path(wanted)
    args.blend_with = model_path(args.blend_with) if args.blend_with else None
    _check_blend(args)
    if find_architecture(args.model).finds_plants:
        _check_plants(args)
    elif args.keep_classes:
        raise ConfigError(
            f"--keep-classes: {args.model} learns nothing but classes; give --model agribot-plants"
        )
    _check_memory(args)
    args.asked |= {
        "keeps_classes": args.keep_classes,
        "keeps_norms": args.keep_norms,
        "remembers": args.remember,
    }


def _check_blend(args: argparse.Namespace) -> None:
    """Refuse a blend that cannot be made.

    Raises: ConfigError: no share of the way, or nothing to begin at.
    """
    check_above("--blend", args.blend, 0.0, 1.0)
    if args.blend < 1.0 and args.start is None and args.blend_with is None:
        raise ConfigError(
            f"--blend {args.blend}: is between the weights that the training begins with and what "
            "it learns; give --start MODEL or --blend-with MODEL, or leave it out"
        )
    if args.blend_with is not None and args.blend == 1.0:
        raise ConfigError(
            "--blend-with needs the share of the way from there; give --blend SHARE, or leave "
            "both out"
        )


def _check_memory(args: argparse.Namespace) -> None:
    """Refuse to keep what a training does not begin with.

    Raises: ConfigError: no weights, drawn images alone, or a network that finds no plants.
    """
    from agribot.lab.train.architectures import find_architecture

    if args.keep_norms and args.start is None:
        raise ConfigError("--keep-norms: keeps those of --start MODEL; give it, or leave both out")
    check_within("--remember", args.remember, 0.0)
    if args.remember and (args.data == "sim" or not find_architecture(args.model).finds_plants):
        raise ConfigError(
            f"--remember {args.remember:g}: is for photographs with drawn images beside them; give "
            "--model agribot-plants --start agribot-plants and photographs, or leave it out"
        )


def _check_plants(args: argparse.Namespace) -> None:
    """Refuse what a network that finds plants cannot learn from, begin with or be written as.

    Raises: ConfigError: photographs, no weights for the classes, or 8-bit numbers.
    """
    if args.data != "sim":
        _check_stems(args)
    if args.keep_classes and args.start is None:
        raise ConfigError(
            "--keep-classes keeps those of the weights that the training begins with; give them, "
            "such as --start agribot-plants"
        )
    if args.precision != "fp32":
        raise ConfigError(
            f"--precision {args.precision}: not for {args.model}; 8-bit ways to a stem were not "
            "measured; give fp32"
        )


def _check_stems(args: argparse.Namespace) -> None:
    """Let drawn images keep the stems in mind that photographs cannot teach.

    Raises: ConfigError: a start without stems, or classes that are to stay as they are.
    """
    from agribot.autonomy.perceive.segmenter import Segmenter

    if args.keep_classes:
        raise ConfigError("--keep-classes: photographs teach nothing but classes; leave it out")
    if args.start is None or not Segmenter(args.start).finds_plants:
        raise ConfigError(
            f"--model {args.model} learns no stems from photographs: a mask does not say which "
            "pixels are one plant; begin with weights that find them: --start agribot-plants"
        )
    args.with_sim = args.with_sim or STEM_VIEWS


def _format_options(args: argparse.Namespace, start: str) -> str:
    """Return the options as they stand in a command, each with a space after it."""
    words = f"--start {start} " if start else ""
    if args.class_weights is not None:
        words += f"--class-weights {args.class_weights} "
    if args.learning_rate is not None:
        words += f"--learning-rate {args.learning_rate} "
    words += f"--blend {args.blend:g} " if args.blend < 1.0 else ""
    words += f"--blend-with {Path(args.blend_with).name} " if args.blend_with else ""
    words += "--keep-classes " if args.keep_classes else ""
    words += "--keep-norms " if args.keep_norms else ""
    words += f"--remember {args.remember:g} " if args.remember else ""
    if args.validate != (VALIDATION_VIEWS if args.data == "sim" else 0):
        words += f"--validate {args.validate} "
    return words


def apply_recipe_options(plan: Any, args: argparse.Namespace) -> Any:
    """Return the plan with its first weights, the rate that suits them, and what was asked."""
    from agribot.lab.train.start import IMAGENET, IMAGENET_LEARNING_RATE, LEARNING_RATE

    if args.is_imagenet:
        plan = msgspec.structs.replace(plan, start=IMAGENET, learning_rate=IMAGENET_LEARNING_RATE)
    elif args.start:
        plan = msgspec.structs.replace(
            plan, start=_describe_start(args.start), learning_rate=LEARNING_RATE
        )
    return msgspec.structs.replace(plan, **args.asked)


def read_class_weights(text: str) -> tuple[float, float, float]:
    """Read the weights of weed, crop and soil from "1,2,0.6".

    Raises: ConfigError: not three finite numbers above 0.
    """
    try:
        weights = [float(word) for word in text.split(",")]
    except ValueError:
        weights = []
    if len(weights) != len(PlantClass) or not all(0.0 < one < math.inf for one in weights):
        raise ConfigError(
            f"--class-weights {text}: not weights; give three numbers above 0, of weed, crop and "
            "soil, as in 1,2,0.6, or auto, median-frequency, inverse-frequency or inverse-root"
        )
    weed, crop, soil = weights
    return weed, crop, soil


def _describe_start(path: Path) -> str:
    from agribot.lab.train.card import hash_file

    return f"{path.stem} {hash_file(path)[:16]}"


def add_drawn_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--variety",
        choices=("standard", "wide", "rough", "dense"),
        default="standard",
        help="wide: all species, and soil with residue, stones and wet patches; rough: all crops, "
        "half of the fields on the ground and in the light of the presets field and hard; dense: "
        "so too, with rows that close and carpets of weeds",
    )
    group.add_argument("--images", type=int, default=2000, help="to train on")
    group.add_argument(
        "--row-images",
        type=int,
        metavar="N",
        help="as many of them from the robot's camera along rows (default: half)",
    )
    group.add_argument(
        "--turn-images",
        type=int,
        metavar="N",
        help="as many of them from the robot's camera in turns beside rows (default: 1 of 6)",
    )
    group.add_argument(
        "--usual-images",
        type=int,
        default=0,
        metavar="N",
        help="N more of the fields of --variety standard, half along rows and half in turns, "
        "which another variety forgets; half of --validate then are such pictures, too",
    )
    group.add_argument(
        "--seedling-images",
        type=int,
        default=0,
        metavar="N",
        help="N more of young carrots or parsley among weeds, from close above, half in red "
        "and near infrared",
    )
    group.add_argument(
        "--front-images",
        type=int,
        default=0,
        metavar="N",
        help="N more of rows from the camera to the horizon, on stony or bare fields in any light",
    )
    group.add_argument("--test-images", type=int, default=120, help="of each test set")
    group.add_argument("--cache", type=Path, help="where they lie (default: OUT/images)")


def check_drawn_options(args: argparse.Namespace) -> None:
    """Fill in the counts that were left out.

    Raises: ConfigError: a count that is out of range.
    """
    if args.with_sim < 0 or (args.with_sim and args.data == "sim"):
        raise ConfigError(
            f"--with-sim {args.with_sim}: a number of images to add to photographs; leave it out "
            "with --data sim"
        )
    is_usual = args.data == "sim" and args.variety == "standard"
    if args.usual_images < 0 or (args.usual_images and is_usual):
        raise ConfigError(
            f"--usual-images {args.usual_images}: a number of images to add to those of another "
            "--variety; leave it out with standard"
        )
    check_within("--seedling-images", args.seedling_images, 0)
    check_within("--front-images", args.front_images, 0)
    if args.row_images is None:
        args.row_images = args.images // 2
    if args.turn_images is None:
        args.turn_images = args.images // 6
    for option in ("row_images", "turn_images"):
        flag = f"--{option.replace('_', '-')}"
        check_within(flag, getattr(args, option), 0, args.images, "(--images)")
    if (on_robot := args.row_images + args.turn_images) > args.images:
        raise ConfigError(
            f"--row-images and --turn-images ask for {on_robot} of the {args.images} of --images; "
            "give more images, or fewer of these"
        )
