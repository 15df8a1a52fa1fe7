"""`agribot export`: a network at another input size or precision, and its cost."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agribot.cli.ids_option import add_ids_option
from agribot.cli.ranges import check_within, finite
from agribot.cli.standard_error import print_line
from agribot.core.errors import AgribotError, ConfigError
from agribot.core.messages import ByteArray

SPEED_FRAMES = 15
MOST_LOSS = 0.005


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", help="name, or path to an .onnx file of agribot train")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the .onnx file to write")
    parser.add_argument("--precision", choices=("fp32", "fp16", "int8"), default="fp32")
    parser.add_argument("--size", help="input size, WxH px (default: as it is)")
    parser.add_argument(
        "--calibrate",
        type=Path,
        help="folder of pictures like those to come: ranges of int8, and how much doubt is usual",
    )
    parser.add_argument(
        "--auto", action="store_true",
        help="choose size and precision: the cheapest on this machine that is as good on --judge",
    )  # fmt: skip
    parser.add_argument(
        "--most-loss", type=finite, default=MOST_LOSS, metavar="IOU",
        help="--auto: mean IoU that may be given up for speed (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument("--judge", type=Path, help="labelled folder on which to measure the cost")
    parser.add_argument(
        "--data", choices=("cwfid", "bonn", "phenobench", "folder"), default="folder"
    )
    add_ids_option(parser)
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(args: argparse.Namespace) -> int:
    """Convert the network and compare it with the original.

    Raises: ConfigError: int8 without pictures, or --auto without a judge; PerceptionError: no such
    network.
    """
    from agribot.autonomy.perceive.segmenter import Segmenter, model_path
    from agribot.lab.train.exported_card import write_card
    from agribot.lab.train.networks import open_network, write_network

    if args.out.suffix != ".onnx":
        raise ConfigError(f"-o {args.out}: not a name of a network; end it with .onnx")
    if args.precision == "int8" and args.calibrate is None:
        raise ConfigError("--precision int8: needs pictures to set ranges; give --calibrate FOLDER")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    problems: list[str] = []
    if args.auto:
        return _export_automatically(args, problems)
    pictures = list(_read_pictures(args.calibrate, problems)) if args.calibrate else []
    before = open_network(args.model, 1, args.size)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source.onnx"
        if args.size:
            from agribot.lab.train.networks import STRIDE_PX, read_size
            from agribot.lab.train.resizing import resize_network

            source.write_bytes(
                resize_network(model_path(args.model), *read_size(args.size, STRIDE_PX))
            )
        else:
            shutil.copy(model_path(args.model), source)
        made = Path(folder) / "made.onnx"
        _convert(args, source, made, pictures)
        Segmenter(made)  # a network that does not run replaces nothing
        write_network(made, args.out)
    write_card(model_path(args.model), args.out, args.precision, pictures)
    after = Segmenter(args.out)
    summary = _compare(args, before, after, problems)
    if args.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    return 1 if problems else 0


def _export_automatically(args: argparse.Namespace, problems: list[str]) -> int:
    """Try sizes and precisions on labelled pictures, and write the file that is chosen."""
    from agribot.autonomy.perceive.segmenter import Segmenter, model_path
    from agribot.lab.train.export_choice import Trial, choose_export

    if args.judge is None or args.size or args.precision != "fp32":
        raise ConfigError(
            "--auto chooses size and precision by --judge FOLDER, labelled pictures that the "
            "network was not trained on; give that, and neither --size nor --precision"
        )
    check_within("--most-loss", args.most_loss, 0.0)
    source = model_path(args.model)
    pictures = None
    if args.calibrate and not Segmenter(source).finds_plants:
        pictures = _read_pictures(args.calibrate, problems)
    with tempfile.TemporaryDirectory() as folder:
        pairs = _JudgedPairs(args, problems)
        trial = Trial(source, Path(folder), pairs, measure_cpu_ms, print_line)
        chosen = choose_export(trial, args.most_loss, pictures, args.out)
    print_line(f"{args.out}: {chosen.describe()}")
    if args.json:
        tried = [{**one._asdict(), "path": one.path.name} for one in trial.tried]
        summary = {"file": str(args.out), "chosen": chosen.path.name, "tried": tried}
        sys.stdout.write(json.dumps(summary | {"problems": sorted(set(problems))}) + "\n")
    return 1 if problems else 0


class _JudgedPairs:
    """The labelled pictures of --judge, read anew whenever they are gone through."""

    def __init__(self, args: argparse.Namespace, problems: list[str]) -> None:
        from agribot.lab.dataset.classes import read_ids
        from agribot.lab.train.photographs import check_sample, find_pairs

        self._problems = problems
        self._pairs, wrong = find_pairs(args.judge, args.data, ids=read_ids(args.ids))
        if args.data == "folder" and args.ids is None:
            check_sample(self._pairs, args.judge)
        problems += wrong

    def __iter__(self) -> Iterator[tuple[ByteArray, ByteArray]]:
        from agribot.lab.train.photographs import read_pairs

        return read_pairs(self._pairs, self._problems.append)


def _convert(args: argparse.Namespace, source: Path, made: Path, pictures: list[ByteArray]) -> None:
    from agribot.lab.train import precision

    if args.precision == "fp32":
        shutil.copy(source, made)
    elif args.precision == "fp16":
        precision.convert_to_fp16(source, made)
    else:
        if not pictures:
            raise ConfigError(
                f"--calibrate {args.calibrate}: no picture there can be read; "
                "name a folder of JPEG or PNG files"
            )
        precision.quantise_to_int8(source, made, pictures)


def _read_pictures(folder: Path, problems: list[str]) -> Iterator[ByteArray]:
    from agribot.lab.dataset.pictures import SUFFIXES, read_picture
    from agribot.lab.train.precision import sample_pictures

    if not folder.is_dir():
        raise ConfigError(f"--calibrate {folder} is no folder; check the path")
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    for file in sample_pictures(files):
        try:
            yield read_picture(file)
        except AgribotError as error:
            problems.append(str(error))
            sys.stderr.write(f"left out: {error}\n")


def _compare(
    args: argparse.Namespace, before: Any, after: Any, problems: list[str]
) -> dict[str, Any]:
    """Compare speed, size and, with labelled pictures, accuracy of the old and the new file."""
    summary: dict[str, Any] = {"file": str(args.out), "precision": args.precision}
    for name, network in (("before", before), ("after", after)):
        found: dict[str, Any] = {"cpu_ms": round(measure_cpu_ms(network), 1)}
        if args.judge:
            found |= _measure_accuracy(network, args, problems)
        summary[name] = found
        accuracy = f", mIoU {found['miou']:.4f}" if args.judge else ""
        sys.stderr.write(f"{name}: {found['cpu_ms']} ms CPU per frame{accuracy}\n")
    summary["bytes"] = args.out.stat().st_size
    summary["problems"] = sorted(set(problems))
    sys.stderr.write(f"{args.out}: {summary['bytes'] / 1e6:.2f} MB\n")
    return summary


def _measure_accuracy(
    network: Any, args: argparse.Namespace, problems: list[str]
) -> dict[str, Any]:
    from agribot.autonomy.perceive.pictures import classify
    from agribot.lab.train.evaluate import evaluate

    pairs = _JudgedPairs(args, problems)
    result = evaluate(lambda image_rgb: classify(network, image_rgb).class_id, pairs)
    return {"miou": result.miou, "iou": result.iou, "images": result.images}


def measure_cpu_ms(network: Any) -> float:
    """Measure the median CPU time of a noise image of the network's own size."""
    height, width = network.map_shape
    image_rgb = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    network.segment(image_rgb)
    times_ms = []
    for _ in range(SPEED_FRAMES):
        started_s = time.process_time()
        network.segment(image_rgb)
        times_ms.append(1e3 * (time.process_time() - started_s))
    return float(np.median(times_ms))
