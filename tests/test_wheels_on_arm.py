"""A robot's computer finds wheels for everything: asked of the package index, for 64-bit ARM."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import nightly

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# glibc 2.31 is older than that of Raspberry Pi OS 12 (2.36), Ubuntu 22.04 and JetPack 6 (2.35).
MACHINE = "aarch64-manylinux_2_31"
NO_NETWORK = ("error sending request", "dns error", "failed to fetch", "connection refused")
TIMEOUT_S = 120


def ask_pip(name: str) -> str:
    """Ask pip for one of its settings; empty where it has none."""
    done = subprocess.run(
        [sys.executable, "-m", "pip", "config", "get", name],
        capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
    )  # fmt: skip
    return done.stdout.strip()


@pytest.fixture(scope="module")
def index() -> dict[str, str]:
    """The package index that pip uses here, as settings of uv."""
    url = os.environ.get("PIP_INDEX_URL") or ask_pip("global.index-url")
    return {"UV_PYTHON_DOWNLOADS": "never", **({"UV_DEFAULT_INDEX": url} if url else {})}


def resolve(python: str, requirement: Path, index: dict[str, str]) -> tuple[int, str]:
    """Resolve with wheels only; returns the exit status and what uv said."""
    done = subprocess.run(
        [
            Path(sys.executable).with_name("uv"), "pip", "compile", requirement,
            "--extra", "hardware", "--extra", "can", "--extra", "ui", "--only-binary", ":all:",
            "--no-header", "--constraint", "constraints.txt", "--no-emit-index-url",
            "--no-emit-find-links", "--python-version", python, "--python-platform", MACHINE,
        ],
        cwd=ROOT, env={**os.environ, **index}, capture_output=True, text=True, check=False,
        timeout=TIMEOUT_S,
    )  # fmt: skip
    said = done.stderr.lower()
    if done.returncode and any(words in said for words in NO_NETWORK):
        pytest.skip("no package index can be reached from here")
    return done.returncode, done.stdout + done.stderr


@nightly.one_by_one("python", PYTHONS, in_suite=1)
def test_a_robot_with_drivers_and_page_installs_from_wheels_on_64_bit_arm(
    python: str, index: dict[str, str]
) -> None:
    status, said = resolve(python, ROOT / "pyproject.toml", index)
    assert status == 0, said
    assert "pyserial==" in said
    assert "python-can==" in said
    assert "onnxruntime==" in said


def test_a_package_without_a_wheel_for_it_would_be_found(
    tmp_path: Path, index: dict[str, str]
) -> None:
    project = tmp_path / "pyproject.toml"
    needs = '[project]\nname = "x"\nversion = "1"\ndependencies = ["cyclonedds"]\n'
    project.write_text(
        needs + "[project.optional-dependencies]\nhardware = []\ncan = []\nui = []\n"
    )
    status, said = resolve("3.14", project, index)
    assert status != 0
    assert "cyclonedds" in said
