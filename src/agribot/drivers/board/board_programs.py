"""The programs of the boards, built, and how they get there."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from agribot.core.errors import ConfigError
from agribot.drivers.board.board_protocol import BoardKind
from agribot.drivers.line.line_holders import find_holders

PACKAGED = Path(__file__).parents[2] / "programs"  # folder of an installed agribot
SOURCES = Path(__file__).parents[4] / "firmware" / "prebuilt"
FLASH_BAUD = 115_200  # speed of a Mega's bootloader
FLASH_S = 120.0


def find_program(kind: BoardKind) -> Path:
    """Find the Intel hex file of a board.

    Raises: ConfigError: this installation has none.
    """
    name = f"{kind.name.lower()}_board.hex"
    for folder in (PACKAGED, SOURCES):
        if (folder / name).is_file():
            return folder / name
    raise ConfigError(f"{name} is not in this installation; install agribot again")


def flash(kind: BoardKind, port: str) -> None:
    """Write a board's program into the Mega at a serial line, through its bootloader.

    Raises: ConfigError: avrdude is missing, another program has the line, or avrdude could not do
        it; its own last words say why.
    """
    avrdude = shutil.which("avrdude")
    if avrdude is None:
        raise ConfigError("flashing needs the program avrdude; sudo apt install avrdude")
    if holders := find_holders(port):
        names = " and ".join(sorted(map(str, holders)))
        raise ConfigError(
            f"{port}: {names} has the line; end it first, for flashing stops the board's program"
        )
    words = [
        avrdude, "-p", "atmega2560", "-c", "wiring", "-P", port, "-b", str(FLASH_BAUD), "-D",
        "-U", f"flash:w:{find_program(kind)}:i",
    ]  # fmt: skip
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, errors="replace", check=False, timeout=FLASH_S
        )
    except subprocess.TimeoutExpired as error:
        raise ConfigError(
            f"{port}: avrdude has not ended after {FLASH_S:g} s; plug the board in anew"
        ) from error
    if done.returncode:
        said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise ConfigError(
            f"{port}: avrdude could not write the program: {'; '.join(said[-3:]) or 'no word'}; "
            "check that it is a Mega 2560 and that no other program has the line"
        )
