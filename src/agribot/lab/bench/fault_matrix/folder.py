"""The results of the matrix on disk, one file for each cell: what is there is not driven again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from agribot.app.workers import Stop, results
from agribot.core.errors import MAKE_ROOM, OTHER_OUT, ConfigError, RecordingError, explain_os_error
from agribot.core.version import __version__
from agribot.core.whole_file import write_at_once
from agribot.description.field_generator import PACKAGED, generate_field
from agribot.description.field_settings import read_field_settings
from agribot.description.package import ROOT
from agribot.description.sdf_export import write_world
from agribot.lab.bench.fault_matrix.cells import PROFILE, ROW_M, SOWN_ROWS, Cell
from agribot.lab.bench.fault_matrix.driving import CellResult, CellTask, drive_cell

WORLD = "field.world"
VERSION = "version"


class MatrixFolder:
    """Holds the results and the world of all cells. Several shards may share it."""

    def __init__(self, path: Path) -> None:
        """Open the folder, or make it.

        Raises: ConfigError: it holds results of another version. RecordingError: it cannot be made.
        """
        self.path = path
        with explain_os_error(f"cannot write into {path}", OTHER_OUT):
            (path / "cells").mkdir(parents=True, exist_ok=True)
            version = path / VERSION
            if not version.exists():
                write_at_once(version, __version__.encode())
            if version.read_text(encoding="utf-8") != __version__:
                raise ConfigError(f"{path} holds results of another version; choose another --out")
            self.world = _write_world(path / WORLD)

    def read(self, cells: Sequence[Cell]) -> dict[Cell, CellResult]:
        """Read the results of these cells that are finished."""
        found = {}
        for cell in cells:
            path = self._find_file(cell)
            if path.is_file():
                found[cell] = _read(path)
        return found

    def keep(self, result: CellResult) -> None:
        """Keep a result.

        Raises: RecordingError: the disk takes no file.
        """
        with explain_os_error(f"cannot write into {self.path}", MAKE_ROOM):
            write_at_once(self._find_file(result.cell), msgspec.json.encode(result) + b"\n")

    def drive(
        self,
        cells: Sequence[Cell],
        onsets_s: dict[Cell, float],
        workers: int,
        stop: Stop,
        show: Callable[[CellResult], None],
    ) -> None:
        """Drive the cells that have no result yet."""
        done = self.read(cells)
        tasks = [
            CellTask(
                cell=cell, onset_s=onsets_s.get(cell, 0.0), world=self.world,
                out_dir=self.path / "runs" / cell.name,
            )
            for cell in cells
            if cell not in done
        ]  # fmt: skip
        for result in results(drive_cell, tasks, workers, stop):
            if result is not None:
                self.keep(result)
                show(result)

    def _find_file(self, cell: Cell) -> Path:
        return self.path / "cells" / f"{cell.name}.json"


def find_onsets_s(
    cells: Sequence[Cell], references: dict[Cell, CellResult]
) -> tuple[dict[Cell, float], tuple[Cell, ...]]:
    """Find when each cell's fault begins, and the cells whose state was never reached."""
    onsets_s, lost = {}, []
    for cell in cells:
        reference = references.get(cell.reference)
        if reference is None:
            continue
        if cell.state in reference.onsets_s:
            onsets_s[cell] = reference.onsets_s[cell.state]
        else:
            lost.append(cell)
    return onsets_s, tuple(lost)


def _read(path: Path) -> CellResult:
    try:
        return msgspec.json.decode(path.read_bytes(), type=CellResult)
    except (OSError, msgspec.MsgspecError) as error:
        raise RecordingError(
            f"{path} is no result of this version ({error}); delete it to run it again"
        ) from error


def _write_world(path: Path) -> Path:
    """Write the packaged field with shorter rows, where it is not there yet."""
    if not path.exists():
        plan = read_field_settings(ROOT / "fields" / f"{PROFILE}.toml")
        rows = msgspec.structs.replace(plan.rows, count=SOWN_ROWS, length_m=ROW_M)
        world = generate_field(msgspec.structs.replace(plan, rows=rows), PACKAGED[PROFILE])
        part = path.with_suffix(".part.world")
        write_world(world, part)
        part.replace(path)
    return path
