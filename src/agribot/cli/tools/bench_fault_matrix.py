"""`agribot bench faults` without `--in-row`: faults by states of the robot, courses and pairs."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from agribot.cli.counting import CountProgress
from agribot.cli.stopping import stop_on_signal
from agribot.cli.tools.result_files import read_page, write_result
from agribot.cli.word_list import parse_names
from agribot.core import extras
from agribot.core.errors import ConfigError
from agribot.lab.bench.fault_matrix import cells as matrix
from agribot.lab.bench.fault_matrix.cells import Cell
from agribot.lab.bench.fault_matrix.driving import CellResult
from agribot.lab.bench.fault_matrix.folder import MatrixFolder, find_onsets_s
from agribot.lab.bench.fault_matrix.sums import summarise
from agribot.lab.bench.fault_matrix.tables import describe, format_csv, format_page, format_red
from agribot.lab.bench.fault_matrix.verdict import judge_all
from agribot.lab.bench.fault_tables import rewrite_block
from agribot.lab.bench.faults import list_fault_names
from agribot.lab.sweep.plan import read_seeds

DEFAULT_SEEDS = "1-3"
BLOCK = "matrix"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--all", action="store_true",
        help="every fault in every state by every course on every seed, instead of a covering array"
        " of all pairs of them",
    )  # fmt: skip
    parser.add_argument(
        "--shard", metavar="K/N",
        help="only the K-th of N equal parts; in a common --out folder, or copy their `cells`",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Return 130 where the campaign was interrupted, else 0: its table is the result."""
    chosen = choose_cells(options)
    extras.require("sim", "agribot bench faults")
    page = None if options.markdown is None else read_page(options.markdown, BLOCK)
    folder = MatrixFolder((options.out or Path("runs") / "fault-matrix").resolve())
    lost = _drive(folder, chosen, options.workers)
    results = folder.read((*matrix.list_references(chosen), *chosen))
    verdicts = judge_all(results)
    result = summarise(verdicts, results, lost)
    write_result(folder.path / "matrix.csv", format_csv(verdicts))
    write_result(folder.path / "matrix.md", format_page(result, verdicts))
    write_result(folder.path / "matrix.json", json.dumps(result, indent=1) + "\n")
    sys.stdout.write(f"{format_red(verdicts)}\n{describe(result)}")
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    if len(verdicts) + len(lost) < len(chosen):
        sys.stderr.write("agribot: interrupted; finished cells are kept, the same command drives "
                         "the rest\n")  # fmt: skip
        return 130
    if page is not None:
        write_result(options.markdown.with_suffix(".csv"), format_csv(verdicts))
        write_result(options.markdown, rewrite_block(page, BLOCK, format_page(result, verdicts)))
    return 0


def choose_cells(options: argparse.Namespace) -> Sequence[Cell]:
    """Choose the cells that are driven.

    Raises: ConfigError: a fault, a seed or a shard is not valid.
    """
    names = parse_names("--faults", options.faults, list_fault_names())
    seeds = read_seeds(options.seeds or DEFAULT_SEEDS)
    faults = matrix.choose_faults(names)
    cells = matrix.list_singles(faults, seeds, is_all=options.all)
    if not options.faults:
        cells += matrix.list_pairs(seeds, is_all=options.all)
    number, count = _read_shard(options.shard)
    return cells[number - 1 :: count]


def _read_shard(text: str | None) -> tuple[int, int]:
    if text is None:
        return 1, 1
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    number, count = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= number <= count:
        raise ConfigError(
            f"--shard {text}: not a part; write its number and the count of parts, as in 2/4"
        )
    return number, count


def _drive(folder: MatrixFolder, cells: Sequence[Cell], workers: int) -> tuple[Cell, ...]:
    """Drive what is missing; return the cells whose state was never reached."""
    references = matrix.list_references(cells)
    progress = CountProgress(len(references) + len(cells), "drives")
    count = len(folder.read((*references, *cells)))

    def show(result: CellResult) -> None:
        nonlocal count
        count += 1
        progress(count, result.error and f"{result.cell.name}: {result.error}")

    with stop_on_signal() as stop:
        progress(count)
        folder.drive(references, {}, workers, lambda: bool(stop), show)
        onsets_s, lost = find_onsets_s(cells, folder.read(references))
        folder.drive(list(onsets_s), onsets_s, workers, lambda: bool(stop), show)
    progress.close()
    return lost
