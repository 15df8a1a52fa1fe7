"""How much room a robot's disk needs, from what the packages installed here say they consist of."""

from __future__ import annotations

import importlib.metadata
import re
from pathlib import Path

from packaging.requirements import Requirement

SOURCE = Path(__file__).parents[1] / "src" / "agribot"
# A quarter of a gibibyte less 24 MiB: pip, setuptools and the compiled code of what a robot loads.
MOST_MIB = 256 - 24
BLOCK_BYTES = 512  # of st_blocks


def list_installed(*extras: str) -> set[str]:
    """List the names of all packages that `pip install .[extras]` brings, itself too."""
    found: set[tuple[str, frozenset[str]]] = set()
    waiting = [("agribot", frozenset(extras))]
    while waiting:
        package = waiting.pop()
        if package in found:
            continue
        found.add(package)
        name, wanted = package
        for line in importlib.metadata.requires(name) or ():
            needed = Requirement(line)
            marker = needed.marker
            if marker is None or any(marker.evaluate({"extra": one}) for one in wanted or {""}):
                key = re.sub(r"[-_.]+", "-", needed.name).lower()
                waiting.append((key, frozenset(needed.extras)))
    return {name for name, _ in found}


def measure_mib(names: set[str]) -> float:
    """Measure what the files take on disk, without compiled code."""
    files = [file.locate() for name in names for file in importlib.metadata.files(name) or ()]
    paths = {Path(str(file)) for file in files} | set(SOURCE.rglob("*"))
    whole = [path for path in paths if "__pycache__" not in path.parts and path.is_file()]
    return sum(path.stat().st_blocks for path in whole) * BLOCK_BYTES / 2**20


def test_a_robot_fits_into_a_quarter_of_a_gibibyte() -> None:
    assert measure_mib(list_installed()) <= MOST_MIB


def test_drivers_and_page_add_little_to_it() -> None:
    assert measure_mib(list_installed("hardware", "ui")) <= MOST_MIB + 8


def test_what_only_figures_training_and_simulation_need_is_not_on_a_robot() -> None:
    heavy = {"scipy", "matplotlib", "numba", "llvmlite", "mujoco-core", "torch"}
    assert not heavy & list_installed("hardware", "ui")
    assert {"matplotlib", "scipy"} <= list_installed("sim")
