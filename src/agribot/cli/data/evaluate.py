"""`agribot eval`: score a network on labelled pictures, image by image.

The table of scores goes to stdout, progress to stderr.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agribot.cli.data.evaluate_rows import judge_rows
from agribot.cli.folder_options import NAME_FOLDERS, list_given
from agribot.cli.ids_option import add_ids_option
from agribot.cli.ranges import threads
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", nargs="?", type=Path, help="folder of images and masks")
    parser.add_argument("--data-dir", type=Path, help="the same as FOLDER")
    parser.add_argument(
        "--data",
        choices=("cwfid", "bonn", "phenobench", "folder", "rows"),
        default="folder",
        help="layout and mask values (default: any pair of folders); rows: images/ and labels/ "
        "with crop rows as white lines on black",
    )
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")
    parser.add_argument("--size", help="another input size for the network, WxH px")
    parser.add_argument("--tile", help="judge in overlapping tiles of WxH image px")
    parser.add_argument("--images", help="name of the folder of images, for other layouts")
    parser.add_argument("--masks", help="name of the folder of masks, for other layouts")
    add_ids_option(parser)
    parser.add_argument("--folds", type=int, default=5, help="parts of cross-validation")
    parser.add_argument("--fold", type=int, help="judge on this part only")
    parser.add_argument("--threads", type=threads, default=1)
    parser.add_argument("--out", type=Path, help="folder for figures and eval.json with details")
    parser.add_argument("--json", action="store_true", help="print the result as the last line")


def run(args: argparse.Namespace) -> int:
    """Return 1 where a picture or mask could not be used; the rest is scored all the same.

    Raises: ConfigError: nothing to judge, or an option out of range.
    """
    from agribot.lab.dataset.classes import read_ids
    from agribot.lab.train.network_scores import NetworkScores
    from agribot.lab.train.networks import open_network, read_size
    from agribot.lab.train.photographs import check_sample, find_pairs, split_fold
    from agribot.lab.train.plant_judge import PicturePlantJudge, format_plants

    folder = _find_folder(args)
    if args.out:
        extras.require("report", "--out")
    if args.data == "rows":
        return judge_rows(args, folder)
    tile_px = read_size(args.tile) if args.tile else None
    segmenter = open_network(args.model, args.threads, args.size)
    pairs, problems = find_pairs(
        folder, args.data, list_given(args.images), list_given(args.masks), read_ids(args.ids),
        NAME_FOLDERS,
    )  # fmt: skip
    if args.fold is not None:
        pairs = split_fold(pairs, args.folds, args.fold)[1]
    if args.data == "folder" and args.ids is None:
        check_sample(pairs, folder)
    for text in problems:
        print_line(f"left out: {text}")
    network_scores, plant_judge = NetworkScores(), PicturePlantJudge()
    doubts: list[float] = []
    cpu_s = _evaluate(network_scores, plant_judge, segmenter, pairs, tile_px, problems, doubts)
    if not network_scores.images:
        raise ConfigError(f"{folder}: no pair can be read; the first problem: {problems[0]}")
    _print_scores(network_scores)
    doubt = float(np.median(doubts)) if doubts else None
    sys.stdout.write(f"doubt: {'-' if doubt is None else f'{doubt:.3f}'}\n")
    summary = _summarise(args, folder, network_scores, segmenter.map_shape)
    summary["doubt_median"] = doubt
    if (single := plant_judge.compute_scores()) is not None:
        sys.stdout.write(format_plants(single) + "\n")
        summary["single_plants"] = msgspec.to_builtins(single)
    summary["fps_cpu"] = 1.0 / float(np.median(cpu_s))
    if args.out:
        _write(args.out, summary, network_scores, problems)
    if args.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    return 1 if problems else 0


def _find_folder(args: argparse.Namespace) -> Path:
    """Raise: ConfigError: none is given, or two are."""
    if args.folder and args.data_dir:
        raise ConfigError(f"{args.folder} and --data-dir {args.data_dir}: two folders; give one")
    folder: Path | None = args.folder or args.data_dir
    if folder is None:
        raise ConfigError(
            "agribot eval: no folder; give that of images and masks, agribot eval FOLDER"
        )
    return folder


def _print_scores(network_scores: Any) -> None:
    from agribot.lab.train.network_scores import format_scores

    sys.stdout.write(format_scores(network_scores.scores) + "\n")
    outlines = ", ".join(
        f"{name} {'-' if value is None else f'{value:.3f}'}"
        for name, value in network_scores.boundary_f1.items()
    )
    sys.stdout.write(f"boundary F1: {outlines}\n")
    found = network_scores.reliability
    plants = "-" if found.plant_error is None else f"{found.plant_error:.3f}"
    sys.stdout.write(
        f"calibration error: {found.calibration_error:.3f}, {plants} over pixels called plants\n"
    )
    for name, found in network_scores.plants.items():
        total = found.right + found.confused + found.missed
        sys.stdout.write(
            f"{name} plants: {found.right} of {total} right, {found.missed} not seen\n"
        )


def _summarise(
    args: argparse.Namespace, folder: Path, network_scores: Any, map_shape: tuple[int, int]
) -> dict[str, Any]:
    from agribot.lab.train.networks import read_card

    result = network_scores.scores
    height_px, width_px = map_shape
    return {
        "dataset": args.data if args.data != "folder" else folder.resolve().name,
        "images": result.images,
        "height_px": height_px,
        "width_px": width_px,
        "model": args.model,
        "iou": result.iou,
        "miou": result.miou,
        "precision": result.precision,
        "recall": result.recall,
        "f1": result.f1,
        "boundary_f1": network_scores.boundary_f1,
        "calibration_error": network_scores.reliability.calibration_error,
        "plant_calibration_error": network_scores.reliability.plant_error,
        "confusion": result.confusion,
        "params": read_card(args.model).get("parameters"),
    }


def _evaluate(
    network_scores: Any,
    plant_judge: Any,
    segmenter: Any,
    pairs: Any,
    tile_px: tuple[int, int] | None,
    problems: list[str],
    doubts: list[float],
) -> list[float]:
    """Return CPU seconds per picture of resize, network and mask, not of reading and enlarging."""
    from agribot.autonomy.perceive.pictures import classify, see_picture
    from agribot.lab.dataset.pictures import PictureError
    from agribot.lab.labelled_plants import read_plants
    from agribot.lab.train.photographs import read_pair

    cpu_s = []
    for pair in pairs:
        try:
            image_rgb, truth = read_pair(pair)
            plants = read_plants(pair.mask, truth)
        except PictureError as error:
            problems.append(str(error))
            print_line(f"left out: {error}")
            continue
        seen = see_picture(segmenter, image_rgb) if tile_px is None else None
        guess = classify(segmenter, image_rgb, tile_px) if seen is None else seen.classes
        if seen is not None and seen.class_map.doubt is not None:
            doubts.append(seen.class_map.doubt)
        if plants is not None:
            finds_plants = seen is not None and segmenter.finds_plants
            plant_judge.add(plants, seen if finds_plants else guess)
        started_s = time.process_time()
        segmenter.segment(image_rgb)
        cpu_s.append(time.process_time() - started_s)
        score = network_scores.add(str(pair.image), image_rgb, truth, guess)
        print_line(f"{pair.image.name}: mIoU {score.miou:.3f}")
    return cpu_s


def _write(folder: Path, summary: dict[str, Any], network_scores: Any, problems: list[str]) -> None:
    from agribot.lab.train.figures import write_figures

    write_figures(network_scores, folder)
    details = {
        **summary,
        "plants": msgspec.to_builtins(network_scores.plants),
        "reliability": msgspec.to_builtins(network_scores.reliability),
        "by_image": msgspec.to_builtins(network_scores.images),
        "problems": problems,
    }
    (folder / "eval.json").write_text(json.dumps(details, indent=2) + "\n", encoding="utf-8")
    print_line(f"figures and eval.json in {folder}")
