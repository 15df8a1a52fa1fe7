"""Help comes at once, for every command, and shows how it is used."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from agribot.cli.main import COMMANDS, main
from tests.cli.parser_tree import Words, every_parser

PARSERS = every_parser()
ROOT = Path(__file__).parents[2]
# What takes a tenth of a second or more to import, and what only an extra brings.
HEAVY = (
    "PIL", "albumentations", "anyio", "cv2", "cyclonedds", "foxglove", "matplotlib", "mcap",
    "mujoco", "numba", "onnx", "onnxruntime", "pmtiles", "pyproj", "rasterio", "ray", "rerun",
    "rosbags", "ruamel", "scipy", "segno", "shapefile", "shapely", "starlette", "torch", "uvicorn",
    "websockets", "xacro", "zenoh",
)  # fmt: skip


def test_no_help_imports_what_is_heavy() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.cli.helped", *HEAVY],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    loaded = json.loads(done.stdout)
    assert set(COMMANDS) <= set(loaded)
    assert {words: names for words, names in loaded.items() if names} == {}


def test_python_runs_the_package_as_the_program() -> None:
    def run(*words: str) -> tuple[int, str]:
        done = subprocess.run(
            [sys.executable, "-m", "agribot", *words],
            cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr

    status, said = run("world", "check", "no-such-world")
    assert status == 2
    assert said.startswith("agribot world: ")
    status, said = run("--help")
    assert status == 0
    assert said.startswith("usage: agribot ")


@pytest.mark.parametrize(("given", "threads"), [(None, "1"), ("3", "3")])
def test_numpy_gets_one_thread_unless_the_environment_gives_more(
    monkeypatch: pytest.MonkeyPatch, given: str | None, threads: str
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    with pytest.raises(SystemExit):
        main(["--version"])
    assert os.environ["OPENBLAS_NUM_THREADS"] == threads


@pytest.mark.parametrize("words", PARSERS, ids=" ".join)
def test_every_help_has_an_example_that_its_own_parser_takes(words: Words) -> None:
    parser = PARSERS[words]
    found = re.match(r"examples?:\s*([^;\n]*)", parser.epilog or "")
    assert found is not None
    example = shlex.split(found[1])
    assert example[: len(words) + 1] == ["agribot", *words]
    parser.parse_args(example[len(words) + 1 :])
