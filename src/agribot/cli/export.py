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
from agribot.core.errors import AgribotError, ConfigError
from agribot.core.messages import ByteArray

SPEED_FRAMES = 15


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", help="name, or path to an .onnx file of agribot train")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the .onnx file to write")
    parser.add_argument("--precision", choices=("fp32", "fp16", "int8"), default="fp32")
    parser.add_argument("--size", help="input size, WxH px (default: as it is)")
    parser.add_argument(
        "--calibrate", type=Path, help="int8: folder of pictures like those to come"
    )
    parser.add_argument("--judge", type=Path, help="labelled folder on which to measure the cost")
    parser.add_argument(
        "--data", choices=("cwfid", "bonn", "phenobench", "folder"), default="folder"
    )
    add_ids_option(parser)
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(args: argparse.Namespace) -> int:
    """Convert the network and compare it with the original.

    Raises: ConfigError: int8 without pictures; PerceptionError: no such network.
    """
    from agribot.autonomy.perceive.segmenter import Segmenter, model_path
    from agribot.lab.train.networks import open_network

    if args.out.suffix != ".onnx":
        raise ConfigError(f"-o {args.out}: the file must end in .onnx")
    if args.precision == "int8" and args.calibrate is None:
        raise ConfigError("--precision int8 needs --calibrate FOLDER with pictures to set ranges")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    problems: list[str] = []
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
        _convert(args, source, before, problems)
    after = Segmenter(args.out)
    summary = _compare(args, before, after, problems)
    if args.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    return 1 if problems else 0


def _convert(args: argparse.Namespace, source: Path, before: Any, problems: list[str]) -> None:
    from agribot.lab.train import precision

    if args.precision == "fp32":
        shutil.copy(source, args.out)
    elif args.precision == "fp16":
        precision.convert_to_fp16(source, args.out)
    else:
        pictures = _read_pictures(args.calibrate, problems)
        first = next(pictures, None)
        if first is None:
            raise ConfigError(f"--calibrate {args.calibrate}: no picture there that can be read")
        precision.quantise_to_int8(source, args.out, [first, *pictures])


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
    from agribot.lab.dataset.classes import read_ids
    from agribot.lab.train.evaluate import evaluate
    from agribot.lab.train.photographs import check_sample, find_pairs, read_pairs

    pairs, wrong = find_pairs(args.judge, args.data, ids=read_ids(args.ids))
    if args.data == "folder" and args.ids is None:
        check_sample(pairs, args.judge)
    problems += wrong
    result = evaluate(
        lambda image_rgb: classify(network, image_rgb).class_id,
        read_pairs(pairs, problems.append),
    )
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
