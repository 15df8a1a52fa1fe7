"""Weed maps of a million plants, out and in: CPU seconds, peak memory and size of each format.

python benchmarks/weed_maps.py --plants 1000000 --formats .geojson,.gpkg
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from agribot.autonomy.weeds.judge_plants import judge_plants
from agribot.autonomy.weeds.merge import merge_maps
from agribot.autonomy.weeds.plant_table import ROW, PlantTable, round_rows
from agribot.core.geo import Datum
from agribot.gis.weeds.files import FORMATS, read_map, write_map

PLANTS_PER_M2 = 10.0
DATUM = Datum(lat_deg=52.1, lon_deg=11.6)


def make_map(count: int, name: str, seed: int) -> PlantTable:
    """Map a field with errors of 2 cm; the same plants for every seed."""
    places_m = np.random.default_rng(0).uniform(0.0, math.sqrt(count / PLANTS_PER_M2), (count, 2))
    dice = np.random.default_rng(seed)
    rows = np.zeros(count, ROW)
    rows["id"], rows["group"] = np.arange(1, count + 1), np.arange(count)
    rows["plant"] = np.random.default_rng(1).random(count) < 0.2
    rows["x_map_m"], rows["y_map_m"] = (places_m + dice.normal(0.0, 0.02, (count, 2))).T
    rows["xx_m2"] = rows["yy_m2"] = 4e-4
    rows["area_m2"], rows["confidence"] = dice.uniform(1e-4, 1e-2, count), 0.95
    rows["sightings"], rows["last_seen_s"] = 12, dice.uniform(0, 1e5, count)
    rows["first_seen_s"] = rows["last_seen_s"] - 2.0
    is_treated = (rows["plant"] == 0) & (dice.random(count) < 0.9)
    rows["treated_s"] = np.where(is_treated, rows["last_seen_s"], np.nan)
    return judge_plants(round_rows(PlantTable(DATUM, (name,), rows)), 0.07)


def measure_step(step: str, path: Path, count: int) -> dict[str, Any]:
    """Measure one step in this process; making the map does not count."""
    table = make_map(count, "a", 2) if step != "read" else None
    other = make_map(count, "b", 3) if step == "merge" else None
    started_s = time.process_time()
    if step == "write" and table is not None:
        write_map(path, table)
    elif step == "read":
        table = read_map(path, "x")
    elif table is not None and other is not None:
        table = merge_maps([table, other])
    assert table is not None
    return {
        "cpu_s": round(time.process_time() - started_s, 1),
        "peak_mb": read_peak_mb(),
        "rows": len(table.rows),
    }


def read_peak_mb() -> int:
    """Read the most memory that this process held since it began, MiB.

    `getrusage` also counts what its parent held when it was forked.
    """
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) // 1024


def run_apart(step: str, path: Path, count: int) -> dict[str, Any]:
    """Measure a step in a process of its own, whose memory is only that of the step."""
    command = [sys.executable, __file__, "--step", step, "--file", str(path)]
    done = subprocess.run(
        [*command, "--plants", str(count)], check=True, capture_output=True, text=True
    )
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=1_000_000)
    parser.add_argument("--formats", default=",".join(FORMATS))
    parser.add_argument("--step", help=argparse.SUPPRESS)
    parser.add_argument("--file", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        told = measure_step(options.step, options.file, options.plants)
        sys.stdout.write(json.dumps(told) + "\n")
        return
    with tempfile.TemporaryDirectory() as folder:
        for suffix in options.formats.split(","):
            path = Path(folder) / f"map{suffix}"
            for step in ("write", "read"):
                told = run_apart(step, path, options.plants)
                size_mb = sum(p.stat().st_size for p in Path(folder).iterdir()) / 1e6
                sys.stdout.write(f"{suffix} {step}: {json.dumps(told)} {size_mb:.0f} MB\n")
                sys.stdout.flush()
            for part in Path(folder).iterdir():
                part.unlink()
    sys.stdout.write(f"merge of two: {json.dumps(run_apart('merge', Path(), options.plants))}\n")


if __name__ == "__main__":
    main()
