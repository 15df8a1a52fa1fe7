"""Weed maps of whole farms: memory grows by the plants of a piece, not by those of the file."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests import nightly

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "weed_maps.py"
FEW, MANY = 10_000, 70_000
MOST_MB = 1000.0  # for a million


def measure(step: str, path: Path, count: int) -> dict[str, Any]:
    command = [sys.executable, str(BENCHMARK), "--step", step, "--file", str(path)]
    done = subprocess.run(
        [*command, "--plants", str(count)], check=True, capture_output=True, text=True
    )
    told: dict[str, Any] = json.loads(done.stdout)
    return told


@nightly.one_by_one("suffix", (".geojson", ".gpkg"), in_suite=1)
def test_a_million_plants_go_out_and_in_within_a_gigabyte(tmp_path: Path, suffix: str) -> None:
    for step in ("write", "read"):
        peak_mb = {}
        for count in (FEW, MANY):
            told = measure(step, tmp_path / f"{count}{suffix}", count)
            assert told["rows"] == count
            peak_mb[count] = told["peak_mb"]
        per_plant_mb = (peak_mb[MANY] - peak_mb[FEW]) / (MANY - FEW)
        assert peak_mb[FEW] + per_plant_mb * 1_000_000 < MOST_MB
