"""`agribot eval --data rows`: judge a network on photographs with labelled crop rows."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agribot.cli.folder_options import NAME_FOLDERS, list_given
from agribot.cli.standard_error import print_line
from agribot.core.errors import ConfigError

if TYPE_CHECKING:
    from agribot.autonomy.perceive.segmenter import Segmenter
    from agribot.lab.rows.judge import JudgedPicture
    from agribot.lab.rows.lines import PhotoCameras
    from agribot.lab.train.photographs import Pair

IMAGES, LABELS = ("images",), ("labels",)


def judge_rows(args: argparse.Namespace, folder: Path) -> int:
    """Return 1 where a picture or label could not be used; the rest is judged all the same.

    Raises: ConfigError: nothing to judge, or an option that has no meaning here.
    """
    from agribot.lab.train.networks import open_network

    segmenter = open_network(args.model, args.threads, args.size)
    pairs, problems = _find_pairs(args, folder)
    for text in problems:
        print_line(f"left out: {text}")
    pictures = _judge(args, folder, segmenter, pairs, problems)
    summary = _gather(args, pictures, problems)
    if not summary["pictures"]:
        raise ConfigError(f"{folder}: no picture can be judged; the first problem: {problems[0]}")
    if args.json:
        sys.stdout.write(json.dumps(summary) + "\n")
    return 1 if problems else 0


def _find_pairs(args: argparse.Namespace, folder: Path) -> tuple[Sequence[Pair], list[str]]:
    from agribot.lab.train.photographs import find_pairs, split_fold

    if args.ids is not None:
        raise ConfigError(
            "--ids says what the values of masks mean, and labels of rows are white lines on "
            "black; leave it out with --data rows"
        )
    pairs, problems = find_pairs(
        folder, "folder", list_given(args.images) or IMAGES, list_given(args.masks) or LABELS,
        {}, NAME_FOLDERS,
    )  # fmt: skip
    if args.fold is not None:
        pairs = split_fold(pairs, args.folds, args.fold)[1]
    return pairs, problems


def _judge(
    args: argparse.Namespace,
    folder: Path,
    segmenter: Segmenter,
    pairs: Sequence[Pair],
    problems: list[str],
) -> Iterator[JudgedPicture]:
    """Judge picture by picture; what cannot be read is added to the problems."""
    from agribot.autonomy.perceive.pictures import classify
    from agribot.lab.dataset.pictures import PictureError, read_picture
    from agribot.lab.rows.conditions import find_condition, read_conditions
    from agribot.lab.rows.judge import PictureJudge
    from agribot.lab.rows.labelled import RowPhoto, fit_classes, fit_picture, read_lines
    from agribot.lab.train.networks import read_size

    tile_px = read_size(args.tile) if args.tile else None
    table, judge = read_conditions(folder), PictureJudge(_find_cameras(pairs))
    for pair in pairs:
        try:
            image_rgb = read_picture(pair.image)
            lines = read_lines(pair.mask, image_rgb.shape)
        except PictureError as error:
            problems.append(str(error))
            print_line(f"left out: {error}")
            continue
        classes = fit_classes(classify(segmenter, image_rgb, tile_px))
        picture = RowPhoto(fit_picture(image_rgb), lines)
        yield judge.judge(pair.image.name, find_condition(pair.image, table), picture, classes)


def _find_cameras(pairs: Iterable[Pair]) -> PhotoCameras:
    """Find what the labels of all pictures say of their cameras; unreadable ones say nothing."""
    from agribot.lab.dataset.pictures import PictureError
    from agribot.lab.rows.labelled import read_lines
    from agribot.lab.rows.lines import PhotoCameras, trace_lines

    found = []
    for pair in pairs:
        try:
            found.append(trace_lines(read_lines(pair.mask)))
        except PictureError:
            continue
    return PhotoCameras(found)


def _gather(
    args: argparse.Namespace, pictures: Iterable[JudgedPicture], problems: Sequence[str]
) -> dict[str, Any]:
    """Gather the figures of all pictures, print them, and write what --out asks for."""
    from agribot.lab.rows.judge import RowJudge, format_summary, summarise_picture
    from agribot.lab.rows.sheet import WorstPictures

    total, worst, by_picture = RowJudge(), WorstPictures(), []
    by_condition: dict[str, RowJudge] = {}
    for judged in pictures:
        total.add(judged)
        worst.add(judged)
        by_picture.append(summarise_picture(judged))
        if judged.condition:
            by_condition.setdefault(judged.condition, RowJudge()).add(judged)
        print_line(f"{judged.name}: {_format_right(judged)}")
    summary = total.summarise()
    if by_condition:
        summary["by_condition"] = {
            name: by_condition[name].summarise() for name in sorted(by_condition)
        }
    if total.pictures:
        sys.stdout.write(format_summary(summary, total.names) + "\n")
        if args.out:
            _write(args.out, {**summary, "by_picture": by_picture, "problems": problems}, worst)
    return summary


def _format_right(judged: JudgedPicture) -> str:
    right = judged.scores.right_ratio
    if right is None:
        return "no plant on or between its rows"
    return f"{right:.0%} of the plant pixels on and between its rows named rightly"


def _write(folder: Path, details: dict[str, Any], worst: Any) -> None:
    from agribot.lab.rows.sheet import draw_sheet

    folder.mkdir(parents=True, exist_ok=True)
    draw_sheet(worst.pictures, folder / "worst.png")
    (folder / "eval.json").write_text(json.dumps(details, indent=2) + "\n", encoding="utf-8")
    print_line(f"worst.png and eval.json in {folder}")
