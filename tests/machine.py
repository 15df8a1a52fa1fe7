"""What a machine may lack, and the line that installs it: the words of every such skip.

`python -m tests.machine FOLDER` fills a folder that, as PATH, makes this machine a bare one.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

# Program -> the Debian packages that bring it, as in apt-packages.txt.
PACKAGES = {
    "avr-gcc": "gcc-avr binutils-avr avr-libc arduino-core-avr",
    "check_urdf": "liburdfdom-tools",
    "chromium-headless-shell": "chromium-headless-shell",
    "gpsd": "gpsd",
    "gpsfake": "gpsd-clients",
    "g++": "g++ libfastrtps-dev",
    "ign": "ignition-tools libsdformat-dev",
    "ogr2ogr": "gdal-bin",
    "openssl": "openssl",
    "shellcheck": "shellcheck",
    "systemd-analyze": "systemd",
    "roscore": "python3-roslaunch python3-rostopic python3-rosbag",
    "roslaunch": "python3-roslaunch",
    "simavr": "gcc simavr libsimavr-dev",
    "str2str": "rtklib",
    "rviz": "rviz xvfb joint-state-publisher ros-robot-state-publisher",
}
# The whole browser does as well, and takes half as much again: it has a window of its own to draw.
OTHER_NAMES = {"chromium-headless-shell": ("chromium", "chromium-browser")}
HIDDEN = frozenset({*PACKAGES, *(name for names in OTHER_NAMES.values() for name in names)})
ASKED = "tests.machine.find"  # the audit event of somebody asking for a program


def find(program: str) -> str | None:
    """Where the program is, under any name that it has."""
    sys.audit(ASKED, program)
    names = (program, *OTHER_NAMES.get(program, ()))
    return next((path for name in names if (path := shutil.which(name))), None)


def missing(program: str) -> str:
    """Why a test is skipped, and how it would not be."""
    return f"{program} is missing (apt-get install {PACKAGES[program]})"


def require(program: str) -> str:
    """Its path; skips the test where the machine has no such program."""
    path = find(program)
    if path is None:
        pytest.skip(missing(program))
    return path


def needs(program: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(find(program) is None, reason=missing(program))


def link_what_every_machine_has(folder: Path) -> None:
    """Fill a folder with links to the programs of PATH, but for those that a test asks for."""
    for place in os.get_exec_path():
        for program in sorted(Path(place).glob("*")):
            link = folder / program.name
            if program.name not in HIDDEN and not link.is_symlink():
                link.symlink_to(program)


if __name__ == "__main__":
    link_what_every_machine_has(Path(sys.argv[1]))
