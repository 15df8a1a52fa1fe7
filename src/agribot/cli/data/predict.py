"""`agribot predict`: run a network on pictures and videos; results as files and as a table."""

from __future__ import annotations

import argparse
import csv
import glob
import json
import statistics
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from agribot.cli.data.result_names import is_video, list_frames, name_results
from agribot.cli.ranges import above, check_within, threads
from agribot.core.config import DEFAULT_MODEL
from agribot.core.errors import CHECK_DISK, AgribotError, ConfigError, explain_os_error
from agribot.core.fact_text import render
from agribot.core.messages import ByteArray, PlantClass

MEGAPIXELS, MOST_MEGAPIXELS = 64.0, 250.0
KINDS = ("mask", "overlay", "panel")
AREAS, PLANTS = "areas.csv", "plants.csv"
AREA_COLUMNS = (
    "image", "frame", "width_px", "height_px", "weed_px", "crop_px", "soil_px", "weed_ratio",
    "crop_ratio", "weed_count", "crop_count", "unknown_count", "confidence", "doubt", "unfit",
    "cpu_ms",
)  # fmt: skip
PLANT_COLUMNS = (
    "image", "frame", "class", "u_px", "v_px", "area_px", "confidence", "left_px", "top_px",
    "width_px", "height_px", "weed_probability", "crop_probability",
)  # fmt: skip
UNKNOWN = "unknown"  # a stem that may be of a weed or of a crop


class InputPicture(NamedTuple):
    """One picture, or one frame of a video; with its folder where others have the same name."""

    name: str
    frame: int | None
    image_rgb: ByteArray


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "inputs", nargs="+", metavar="INPUT", help="picture, folder, glob pattern or video"
    )
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name, or path to an .onnx file")
    parser.add_argument("--size", help="another input size for the network, WxH px")
    parser.add_argument("--tile", help="look at overlapping tiles of WxH image px")
    parser.add_argument("--only", help="of mask,overlay,panel (default: all three)")
    parser.add_argument("--format", choices=("png", "jpg", "tif"), default="png")
    parser.add_argument("--least-px", type=int, default=100, help="smallest plant to count")
    parser.add_argument(
        "--megapixels",
        type=above(0.0, MOST_MEGAPIXELS),
        default=MEGAPIXELS,
        metavar="N",
        help="largest picture, which takes 30 MB of memory for each (default: %(default)g)",
    )
    parser.add_argument("--threads", type=threads, default=1)
    parser.add_argument("--json", action="store_true", help="print a summary as the last line")


def run(args: argparse.Namespace) -> int:
    """Return 1 where a picture could not be read; the others are done all the same.

    Raises: ConfigError: no picture at all, or an option out of range.
    """
    from agribot.lab.train.networks import open_network, read_size

    kinds = _list_kinds(args)
    tile_px = read_size(args.tile) if args.tile else None
    files = list_inputs(args.inputs)
    _refuse_to_replace(args.out, files, kinds, args.format)
    segmenter = open_network(args.model, args.threads, args.size)
    args.out.mkdir(parents=True, exist_ok=True)
    problems: list[str] = []
    done = 0
    doubts: list[float] = []
    unfit = 0
    counted = ("weed_px", "crop_px", "soil_px", "weed_count", "crop_count", "unknown_count")
    total = dict.fromkeys(counted, 0)
    with (
        closing(_Table(args.out / AREAS, AREA_COLUMNS)) as areas,
        closing(_Table(args.out / PLANTS, PLANT_COLUMNS)) as plants,
    ):
        for stem, seen in _read_pictures(files, problems, round(args.megapixels * 1e6)):
            row, found = _predict(seen, segmenter, tile_px, args, kinds, stem)
            areas.add([row])
            plants.add(found)
            done += 1
            doubts += [row["doubt"]] if row["doubt"] != "" else []
            unfit += row["unfit"] != ""
            for name in total:
                total[name] += row[name]
            sys.stderr.write(
                f"{seen.name}: weed {row['weed_ratio']:.1%} in {row['weed_count']} plants, crop "
                f"{row['crop_ratio']:.1%} in {row['crop_count']}"
                + (f"; {row['unfit']}" if row["unfit"] else "")
                + "\n"
            )
    sys.stderr.write(f"{done} pictures; areas.csv, plants.csv and pictures in {args.out}\n")
    if args.json:
        median = statistics.median(doubts) if doubts else None
        summary = {
            "out": str(args.out), "pictures": done, **total, "doubt_median": median,
            "unfit_pictures": unfit, "problems": problems,
        }  # fmt: skip
        sys.stdout.write(json.dumps(summary) + "\n")
    return 1 if problems else 0


class _Table:
    """A CSV file that grows with every picture.

    Raises: RecordingError: it cannot be written.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._path = path
        with self._naming_path():
            self._file = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.DictWriter(self._file, columns, lineterminator="\n")
        with self._naming_path():
            self._writer.writeheader()

    def add(self, rows: Sequence[dict[str, Any]]) -> None:
        with self._naming_path():
            self._writer.writerows(rows)
            self._file.flush()

    def close(self) -> None:
        with self._naming_path():
            self._file.close()

    @contextmanager
    def _naming_path(self) -> Iterator[None]:
        with explain_os_error(f"cannot write {self._path}", CHECK_DISK):
            yield


def _list_kinds(args: argparse.Namespace) -> tuple[str, ...]:
    kinds = tuple(args.only.split(",")) if args.only else KINDS
    unknown = set(kinds) - set(KINDS)
    if unknown:
        raise ConfigError(f"--only {args.only}: unknown; choose from {', '.join(KINDS)}")
    check_within("--least-px", args.least_px, 1)
    return kinds


def list_inputs(inputs: list[str]) -> list[Path]:
    """List files of all inputs: folders give their pictures and videos, patterns their matches.

    Raises: ConfigError: an input matches nothing.
    """
    from agribot.cli.data.videos import VIDEO_SUFFIXES
    from agribot.lab.dataset.pictures import SUFFIXES

    files: list[Path] = []
    for text in inputs:
        path = Path(text)
        if path.is_dir():
            wanted = SUFFIXES | VIDEO_SUFFIXES
            found = sorted(p for p in path.iterdir() if p.suffix.lower() in wanted)
        elif path.is_file():
            found = [path]
        else:
            found = [Path(p) for p in sorted(glob.glob(text, recursive=True)) if Path(p).is_file()]
        if not found:
            raise ConfigError(f"{text}: no picture or video there; check the path or the pattern")
        files += found
    return list(dict.fromkeys(files))


def _refuse_to_replace(out: Path, files: list[Path], kinds: tuple[str, ...], form: str) -> None:
    """Keep masks that somebody painted: results replace those of an earlier call alone.

    Raises: ConfigError: the folder holds other files with the names of results.
    """
    from agribot.cli.data.drawings import name_drawing

    if (out / AREAS).exists():
        return
    stems = [
        stem
        for file, stem in zip(files, name_results(files), strict=True)
        for stem in (list_frames(out, stem) if is_video(file) else [stem])
    ]
    wanted = [name_drawing(out / stem, kind, form) for stem in stems for kind in kinds]
    there = next((path for path in (out / PLANTS, *wanted) if path.exists()), None)
    if there is not None:
        raise ConfigError(
            f"-o {out}: {there.name} is there, of no earlier call of agribot predict, and would be "
            "replaced; give another folder"
        )


def _read_pictures(
    files: list[Path], problems: list[str], most_px: int
) -> Iterator[tuple[str, InputPicture]]:
    """Read (name of the results, picture) of all files; the rest goes to `problems`."""
    from agribot.cli.data.videos import read_frames
    from agribot.lab.dataset.pictures import (
        MISNAMED,
        PictureError,
        is_text,
        read_picture,
        show_name,
    )

    shared = Counter(file.name for file in files)
    for file, stem in zip(files, name_results(files), strict=True):
        name = file.name if shared[file.name] == 1 else file.as_posix()
        try:
            if not is_text(name):
                raise PictureError(f"{show_name(str(file))}: {MISNAMED}")
            if is_video(file):
                for index, frame in enumerate(read_frames(file)):
                    yield f"{stem}-{index:06d}", InputPicture(name, index, frame)
            else:
                yield stem, InputPicture(name, None, read_picture(file, most_px))
        except AgribotError as error:
            problems.append(str(error))
            sys.stderr.write(f"left out: {error}\n")


def _predict(
    seen: InputPicture,
    segmenter: Any,
    tile_px: tuple[int, int] | None,
    args: argparse.Namespace,
    kinds: tuple[str, ...],
    stem: str,
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Write the pictures; return the row of areas and the rows of plants."""
    import numpy as np

    from agribot.cli.data.drawings import write_drawings

    found, plants, sure, cpu_ms = _look(seen.image_rgb, segmenter, tile_px, args.least_px)
    write_drawings(seen.image_rgb, found, args.out / stem, kinds, args.format)
    height, width = found.class_id.shape
    counts = np.bincount(found.class_id.ravel(), minlength=len(PlantClass))
    frame = "" if seen.frame is None else seen.frame
    row: dict[str, Any] = {
        "image": seen.name,
        "frame": frame,
        "width_px": width,
        "height_px": height,
        "confidence": round(float(found.confidence.mean()) / 255.0, 4),
        **sure,
        "cpu_ms": round(cpu_ms, 1),
    }
    for kind in PlantClass:
        row[f"{kind.name.lower()}_px"] = int(counts[kind])
    for kind in (PlantClass.WEED, PlantClass.CROP):
        row[f"{kind.name.lower()}_ratio"] = round(float(counts[kind]) / (height * width), 6)
    for name in ("weed", "crop", UNKNOWN):
        row[f"{name}_count"] = sum(plant["class"] == name for plant in plants)
    return row, [{"image": seen.name, "frame": frame, **plant} for plant in plants]


def _look(
    image_rgb: ByteArray, segmenter: Any, tile_px: tuple[int, int] | None, least_px: int
) -> tuple[Any, list[dict[str, Any]], dict[str, Any], float]:
    """Return classes, single plants, how far to believe them, and the CPU time of classes, ms.

    Plants are those of stems where the network finds them in a whole picture, else connected
    pieces of one class.
    """
    from agribot.autonomy.perceive.instances import plants_in
    from agribot.autonomy.perceive.picture_light import find_fault
    from agribot.autonomy.perceive.picture_stems import list_stems, own_pixels
    from agribot.autonomy.perceive.pictures import classify, see_picture

    started_s = time.process_time()
    if segmenter.finds_plants and tile_px is None:
        seen = see_picture(segmenter, image_rgb)
        cpu_ms = 1e3 * (time.process_time() - started_s)
        stems = list_stems(own_pixels(seen), least_px)
        plants = [_describe_stem(stem) for stem in stems]
        return seen.classes, plants, _describe_doubt(image_rgb, seen.class_map), cpu_ms
    found = classify(segmenter, image_rgb, tile_px)
    cpu_ms = 1e3 * (time.process_time() - started_s)
    pieces = plants_in(found.class_id, found.confidence, least_px)
    sure = {"doubt": "", "unfit": render(find_fault(image_rgb))}
    return found, [_describe_piece(plant) for plant in pieces], sure, cpu_ms


def _describe_doubt(image_rgb: ByteArray, class_map: Any) -> dict[str, Any]:
    from agribot.autonomy.perceive.unfit import find_unfit

    doubt = "" if class_map.doubt is None else round(class_map.doubt, 4)
    return {"doubt": doubt, "unfit": render(find_unfit(image_rgb, class_map))}


def _describe_stem(stem: Any) -> dict[str, Any]:
    return {
        "class": UNKNOWN if stem.plant is None else stem.plant.name.lower(),
        **_describe_place(stem),
        "confidence": round(max(stem.weed, stem.crop), 4),
        "weed_probability": round(stem.weed, 4),
        "crop_probability": round(stem.crop, 4),
    }


def _describe_piece(plant: Any) -> dict[str, Any]:
    return {
        "class": plant.plant.name.lower(),
        **_describe_place(plant),
        "confidence": round(plant.confidence, 4),
    }


def _describe_place(plant: Any) -> dict[str, Any]:
    whole = ("area_px", "left_px", "top_px", "width_px", "height_px")
    place = {"u_px": round(plant.u_px, 2), "v_px": round(plant.v_px, 2)}
    return place | {name: getattr(plant, name) for name in whole}
