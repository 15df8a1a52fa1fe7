"""What `pip install .` alone brings: every command works, or names its extra in one line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.app.simulated_run import simulate
from agribot.core import config
from tests.cli.parser_tree import every_command

ROOT = Path(__file__).parents[2]
FIELD = str(ROOT / "examples" / "field.geojson")
# Command -> arguments and the extra that it needs; empty: it does its work without any.
# {run} is the folder of a short run, {pairs} pictures with masks, {out} a place to write.
COMMANDS = {
    "run": ("--out {out}/run", "sim"),
    "sim": ("--for 1 --out {out}/sim", "sim"),
    "report": ("{run}/run.mcap -o {out}/report", "report"),
    "localize": ("{run} --out {out}/poses", "report"),
    "replay": ("{run}/run.mcap --check", ""),
    "bag info": ("{run}/run.mcap", ""),
    "bag convert": ("{run}/run.mcap {out}/run.bag", ""),
    "bag track": ("{run}/run.mcap -o {out}/track.gpx", ""),
    "bag csv": ("{run}/run.mcap /agribot/fix -o {out}/fix.csv", ""),
    "record recover": ("{run}/run.mcap -o {out}/saved.mcap", ""),
    "record info": ("{run}/run.mcap", ""),
    "record start": ("--url ws://127.0.0.1:9/ws --token T", "ui"),
    "record stop": ("--url ws://127.0.0.1:9/ws --token T", "ui"),
    "record mark": ("stone --url ws://127.0.0.1:9/ws --token T", "ui"),
    "ros2": ("--out {out}/run", "sim"),
    "ros1": ("--out {out}/run", "sim"),
    "foxglove": ("--out {out}/run", "sim"),
    "view": ("qgis {run} -o {out}/qgis", ""),
    "node": ("gps-converter --ros2 --for 1", "ros"),
    "describe": ("--check", ""),
    "world list": ("", ""),
    "world check": ("Farm", ""),
    "world map": ("Farm -o {out}/farm.yaml", ""),
    "world generate": ("{out}/field.toml -o {out}/field.world", ""),
    "world render": ("Farm -o {out}/farm.png", "sim"),
    "world gallery": ("-o {out}/gallery.png", "sim"),
    "plan": (f"--field {FIELD} --implement-width 1 --out {{out}}/plan.geojson", ""),
    "calibrate drive": ("", "sim"),
    "calibrate magnetometer": ("", "sim"),
    "calibrate antenna": ("", "sim"),
    "calibrate camera": ("", "sim"),
    "calibrate row-view": ("", "sim"),
    "calibrate motors": ("--counts-per-turn 2048 --full-speed-rpm 80", ""),
    "ui": ("{run}/run.mcap", "ui"),
    "teleop": ("keyboard --url ws://127.0.0.1:9/ws --token T", "ui"),
    "map import": ("{out}/map.tif", "maps"),
    "map list": ("", ""),
    "weeds export": ("{run} -o {out}/weeds.gpkg", ""),
    "weeds import": ("{run}/weeds.geojson -o {out}/weeds.csv", ""),
    "weeds merge": ("{run} other={run} -o {out}/merged.geojson", ""),
    "weeds report": ("{run} -o {out}/weeds.html", "report"),
    "board show": ("serial:/dev/ttyACM0 --for 1", "hardware"),
    "gnss show": ("serial:/dev/ttyACM0 --for 1", "hardware"),
    "gnss configure": ("serial:/dev/ttyACM0", "hardware"),
    "sweep": ("--seeds 1 --out {out}/sweep", "sim"),
    "bench sim": ("--only physics_rtf", "sim"),
    "bench missions": ("--profiles farm --seeds 1 --out {out}/missions", "sim"),
    "bench long": ("--km 0.05 --out {out}/long", "sim"),
    "bench ground": ("--soil firm", "sim"),
    "bench faults": ("--seeds 1 --out {out}/faults", "sim"),
    "bench encounters": ("--seeds 1 --out {out}/encounters", "sim"),
    "bench perception": ("--frames 1", "train"),
    "bench closed-loop": ("--seconds 1", "sim"),
    "bench in-row": ("--seconds 1", "sim"),
    "bench plants": ("--frames 1", "sim"),
    "bench ui": ("--seconds 1", "sim"),
    "dataset generate": ("--images 1 --out {out}/drawn", "sim"),
    "dataset check": ("{pairs}", ""),
    "dataset import": (
        "{out}/0.txt --images {pairs}/images --classes crop=0 --out {out}/imported",
        "",
    ),
    "dataset label-by-rows": ("{run} --out {out}/taught", "sim"),
    "dataset split": ("{pairs} --by image --ratios 50,25,25 -o {out}/split.json", ""),
    "adapt": ("{pairs} -o {out}/field.onnx", "train"),
    "train": ("--images 1 --minutes 1 --out {out}/training", "train"),
    "eval": ("{pairs}", ""),
    "predict": ("{pairs}/images/0.png -o {out}/seen", ""),
    "label": ("{pairs}", "ui"),
    "live": ("sim --seconds 1", "sim"),
    "export": ("agribot-sim --size 128x96 -o {out}/small.onnx", "train"),
    "models": ("agribot-sim", ""),
    "plugins": ("", ""),
    "graph": ("robot", ""),
}
ELSEWHERE = {
    "board flash": "needs avrdude and a board: test_board.py",
    "doctor": "says of every package whether it is there: test_doctor.py",
    "map remove": "deletes what map import brings",
    "bench nav": "drives a model without the simulator, for minutes",
    "bench all": "names for each benchmark what it needs: test_bench.py",
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    folder = tmp_path_factory.mktemp("base")
    short = ["duration_s=0.4", "perception.enabled=false"]
    with simulate(config.load("farm", short), folder / "run") as session:
        for _ in session.ticks():
            pass
        session.finish()
    (folder / "field.toml").write_text("[rows]\ncount = 2\nlength_m = 3.0\n")
    (folder / "map.tif").write_bytes(b"")
    (folder / "0.txt").write_text("0 0.1 0.1 0.5 0.1 0.5 0.5")
    pairs = folder / "pairs"
    for name in ("images", "masks"):
        (pairs / name).mkdir(parents=True)
    for number in range(4):
        pixels = np.full((48, 64, 3), 40 * number, np.uint8)
        Image.fromarray(pixels).save(pairs / "images" / f"{number}.png")
        Image.fromarray(np.full((48, 64), 2, np.uint8)).save(pairs / "masks" / f"{number}.png")
    places = {"run": folder / "run", "out": folder, "pairs": pairs}
    lines = [
        [*words.split(), *(word.format(**places) for word in arguments.split())]
        for words, (arguments, _) in COMMANDS.items()
    ]
    return dict(zip(COMMANDS, _run(lines, folder), strict=True))


def _run(lines: Sequence[Sequence[str]], home: Path) -> list[tuple[int, str]]:
    done = subprocess.run(
        [sys.executable, "-m", "tests.cli.base_install"],
        input=json.dumps(lines), cwd=ROOT, capture_output=True, text=True, check=True, timeout=120,
        env={"PATH": "/usr/bin:/bin", "HOME": str(home), "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    return [(status, said) for status, said in json.loads(done.stdout)]


def test_every_command_of_the_program_is_tried() -> None:
    assert {" ".join(words) for words in every_command()} == COMMANDS.keys() | ELSEWHERE.keys()


@pytest.mark.parametrize("words", COMMANDS)
def test_without_extras_a_command_works_or_names_what_it_needs(
    words: str, answers: dict[str, tuple[int, str]]
) -> None:
    status, said = answers[words]
    extra = COMMANDS[words][1]
    assert "Traceback" not in said
    if extra:
        assert (status, f"[{extra}]'" in said.splitlines()[-1]) == (2, True), said
    else:
        assert status == 0, said


def test_the_page_is_refused_before_anything_is_compiled(tmp_path: Path) -> None:
    code = (
        "import importlib.util, sys; sys.modules['starlette'] = None\n"
        "from agribot.cli.main import main; status = main(['run', '--ui'])\n"
        "assert 'numba' not in sys.modules; sys.exit(status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert re.search(r"pip install .*\[ui\]'", done.stderr)
