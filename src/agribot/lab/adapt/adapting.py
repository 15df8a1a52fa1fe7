"""Adapt a network to a field by its rows: see them, learn from them, and say what that brought."""

from __future__ import annotations

import hashlib
import math
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from agribot.app.run_recording import find_recording
from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.whole_file import write_at_once
from agribot.lab.adapt.field_training import Budget, FieldTraining, choose_size_px
from agribot.lab.adapt.place_names import read_row_pictures
from agribot.lab.adapt.row_figures import TaughtFigures, draw_sheet, judge_rows
from agribot.lab.adapt.row_teacher import PASSES, find_cameras, see_rows, teach
from agribot.lab.dataset.photographed_rows import list_photographs
from agribot.lab.dataset.recorded_rows import PASSES as DRIVE_PASSES
from agribot.lab.dataset.recorded_rows import RecordedPictures, label_recordings
from agribot.lab.rows.lines import PhotoCamera
from agribot.lab.train.card import hash_file
from agribot.lab.train.fit import load_checkpoint
from agribot.lab.train.photographs import Pair, find_pairs, read_pair

PICTURES_OF = 6  # pictures with rows in a group: one chooses, one judges, the others teach
MOST_CHOOSING = 24  # pictures, at which a training looks again and again
SHEET_PICTURES = 6
TAUGHT, NOTE = "taught", "taught.json"


class Taught(msgspec.Struct, frozen=True, kw_only=True):
    """Results of rows beside the pictures: a second call goes on with them.

    `files` is a digest of the names and sizes of the source's files. `cameras` are those of the
    pictures, where their rows show them.
    """

    source: str
    files: str
    base: str
    pictures: int = 0
    rows_seen: int = 0
    problems: tuple[str, ...] = ()
    cameras: dict[str, PhotoCamera] = {}
    cpu_s: float = 0.0


class Adaptation(msgspec.Struct, frozen=True, kw_only=True):
    """Results of an adaptation; the figures are of pictures that it did not learn from.

    `cpu_s` is that of all calls that it took.
    """

    pictures: int
    rows_seen: int
    before: TaughtFigures
    after: TaughtFigures
    cpu_s: float
    steps: int
    model: str
    sheet: str
    problems: tuple[str, ...]


class _Seen(NamedTuple):
    """What was seen of rows, as `Taught` keeps it."""

    pictures: int
    rows_seen: int
    problems: tuple[str, ...]
    cameras: dict[str, PhotoCamera]


class Wanted(NamedTuple):
    """Pictures to adapt to, the network, and the file of the weights."""

    source: Path
    base: str
    out: Path
    budget: Budget
    seed: int


class Listener(NamedTuple):
    """Receives progress: lines of text, and counts of pictures."""

    show_line: Callable[[str], None]
    start_count: Callable[[int], Callable[[int], None]]


def adapt(wanted: Wanted, listener: Listener) -> Adaptation:
    """Adapt a network; a call that was stopped is gone on with by the same call.

    What it needs until it is done lies in a folder beside the weights.
    Raises: ConfigError: no rows, or a network that cannot learn; RecordingError: a broken
    recording, or a full disk.
    """
    base = model_path(wanted.base)
    folder = wanted.out.with_name(f"{wanted.out.stem}-adapt")
    earlier_s = _count_earlier_s(folder) - time.process_time()
    training = FieldTraining(base, folder, wanted.seed)
    taught = _teach_once(wanted, base, folder, listener)
    pairs, choosing, aside = _part(folder / TAUGHT)
    listener.show_line(
        f"{taught.rows_seen} of {taught.pictures} pictures show rows; {len(choosing)} of them "
        f"choose the best network, {len(aside)} judge it, and {len(pairs)} teach"
    )
    network = Segmenter(base)
    before = judge_rows(network, read_row_pictures(aside, taught.cameras))
    size_px = choose_size_px(network, [read_pair(pair)[1].shape[:2] for pair in aside])
    budget = wanted.budget
    if not training.is_begun:
        # Judging again costs about as much as what was done since the rows were found.
        spent_s = 2.0 * (earlier_s + time.process_time()) - taught.cpu_s
        budget = _leave(budget, spent_s / 60.0)
    chosen_by = list(read_row_pictures(choosing, taught.cameras))
    trained = training.run(pairs, chosen_by, budget, size_px, wanted.out, listener.show_line)
    adapted = Segmenter(wanted.out)
    return Adaptation(
        pictures=taught.pictures,
        rows_seen=taught.rows_seen,
        before=before,
        after=judge_rows(adapted, read_row_pictures(aside, taught.cameras)),
        steps=trained.step,
        model=str(wanted.out),
        sheet=str(_draw(wanted.out, aside, network, adapted)),
        problems=taught.problems,
        cpu_s=earlier_s + time.process_time(),
    )


def _count_earlier_s(folder: Path) -> float:
    """Count the CPU time that earlier calls spent on seeing rows and on learning."""
    state, taught = load_checkpoint(folder), _read_note(folder)
    return (taught.cpu_s if taught else 0.0) + (state["cpu_s"] if state else 0.0)


def _leave(budget: Budget, spent_min: float) -> Budget:
    """Take what was spent from a budget.

    Raises: ConfigError: nothing is left.
    """
    if budget.steps is None and budget.minutes <= spent_min:
        raise ConfigError(
            f"--minutes {budget.minutes:g}: seeing the rows and judging take {spent_min:.1f} "
            "CPU-minutes, which leaves none to learn; give more"
        )
    return budget._replace(minutes=budget.minutes - spent_min)


def _part(folder: Path) -> tuple[list[Pair], list[Pair], list[Pair]]:
    """Part the pictures with rows in those to learn from, those that choose, and those that judge.

    Raises: ConfigError: too few to judge with any.
    """
    pairs, _ = find_pairs(folder, "folder")
    if len(pairs) < PICTURES_OF:
        raise ConfigError(
            f"{len(pairs)} pictures show rows, {PICTURES_OF} are needed; record more of them with "
            "--set record.image_rate_hz=2"
        )
    choosing, aside = (pairs[first::PICTURES_OF] for first in (2, PICTURES_OF - 1))
    teaching = [pair for pair in pairs if pair not in choosing and pair not in aside]
    return teaching, choosing[:: math.ceil(len(choosing) / MOST_CHOOSING)], aside


def _draw(out: Path, aside: Sequence[Pair], before: Segmenter, after: Segmenter) -> Path:
    sheet = out.with_name(f"{out.stem}-before-after.jpg")
    shown = aside[:: max(1, len(aside) // SHEET_PICTURES)][:SHEET_PICTURES]
    draw_sheet(sheet, [read_pair(pair)[0] for pair in shown], before, after)
    return sheet


def _read_note(folder: Path) -> Taught | None:
    try:
        return msgspec.json.decode((folder / NOTE).read_bytes(), type=Taught)
    except FileNotFoundError:
        return None
    except msgspec.DecodeError as error:
        raise RecordingError(
            f"{folder / NOTE}: is broken ({error}); move the folder away to begin anew"
        ) from error


def _teach_once(wanted: Wanted, base: Path, folder: Path, listener: Listener) -> Taught:
    """See the rows and label by them, unless an earlier call has done so.

    Raises: ConfigError: no rows, or the folder is of another adaptation.
    """
    source = str(wanted.source.absolute())
    note = Taught(source=source, files=_digest(wanted.source), base=hash_file(base)[:16])
    taught = _read_note(folder)
    if taught is None:
        return _teach(wanted, base, folder, listener, note)
    if (taught.source, taught.files, taught.base) != (note.source, note.files, note.base):
        raise ConfigError(
            f"{folder} holds an adaptation to {taught.source} with other pictures or another "
            "--model; give another -o, or move the folder away"
        )
    return taught


def _digest(source: Path) -> str:
    files = sorted(source.rglob("*")) if source.is_dir() else [source]
    sizes = [
        (str(path.relative_to(source)), path.stat().st_size) for path in files if path.is_file()
    ]
    return hashlib.sha256(msgspec.json.encode(sizes)).hexdigest()[:16]


def _teach(wanted: Wanted, base: Path, folder: Path, listener: Listener, note: Taught) -> Taught:
    shutil.rmtree(folder / TAUGHT, ignore_errors=True)  # labels of a call that was stopped
    started_s = time.process_time()
    is_drive = not wanted.source.is_dir() or find_recording(wanted.source).exists()
    see = _see_drive if is_drive else _see_photographs
    seen = see(wanted.source, base, folder / TAUGHT, listener)
    cpu_s = time.process_time() - started_s
    taught = msgspec.structs.replace(note, **seen._asdict(), cpu_s=cpu_s)
    write_at_once(folder / NOTE, msgspec.json.encode(taught))
    return taught


def _see_drive(source: Path, base: Path, out: Path, listener: Listener) -> _Seen:
    recording = RecordedPictures(source)
    count = listener.start_count(DRIVE_PASSES * len(recording))
    report = label_recordings([recording], out, count)
    return _Seen(report.pictures, report.labelled, (), {})


def _see_photographs(source: Path, base: Path, out: Path, listener: Listener) -> _Seen:
    _, paths, left_out = list_photographs(source)
    count = listener.start_count(PASSES * len(paths))
    seen = see_rows(paths, Segmenter(base), count)
    teach(seen, out, lambda done: count(len(paths) + done))
    problems = (*left_out, *seen.problems)
    return _Seen(len(paths) + len(left_out), len(seen.rows), problems, find_cameras(seen))
