"""What a machine may lack, and the line that installs it: the words of every such skip."""

from __future__ import annotations

import shutil

import pytest

# Program -> the Debian packages that bring it, as in apt-packages.txt.
PACKAGES = {
    "check_urdf": "liburdfdom-tools",
    "chromium": "chromium",
    "g++": "g++ libfastrtps-dev",
    "ign": "ignition-tools libsdformat-dev",
    "openssl": "openssl",
    "roscore": "python3-roslaunch python3-rostopic python3-rosbag",
    "roslaunch": "python3-roslaunch",
    "rviz": "rviz xvfb joint-state-publisher ros-robot-state-publisher",
}
OTHER_NAMES = {"chromium": ("chromium-browser",)}


def find(program: str) -> str | None:
    """Where the program is, under any name that it has."""
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
