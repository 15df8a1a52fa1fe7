"""What lies in firmware/ is what its sources and the table of the messages make."""

from __future__ import annotations

import runpy
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from firmware import build
from tests import machine

GENERATOR = runpy.run_path(str(build.FIRMWARE.parent / "scripts" / "generate_board_wire.py"))
# Another compiler makes other bytes of the same sources.
COMPILER = "5.4.0"


def test_the_header_of_the_boards_is_that_of_the_table() -> None:
    written = (build.FIRMWARE / "wire.h").read_text("utf-8")
    assert written == GENERATOR["write_header"](), (
        "run scripts/generate_board_wire.py and firmware/build.py"
    )


@pytest.mark.parametrize("build_board", [build.build_motor_board, build.build_imu_board])
def test_the_prebuilt_firmware_is_what_its_sources_make(
    build_board: Callable[[Path], Path], tmp_path: Path
) -> None:
    compiler = machine.require("avr-gcc")
    built = build_board(tmp_path)
    assert built.stat().st_size > 10_000
    version = subprocess.run([compiler, "-dumpversion"], capture_output=True, text=True, check=True)
    if version.stdout.strip() == COMPILER:
        assert built.read_text() == (build.PREBUILT / built.name).read_text()
