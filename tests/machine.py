"""What a machine may lack, and the line that installs it: the words of every such skip.

`python -m tests.machine FOLDER` fills a folder with links to Python, make, git, a shell and the
programs of coreutils. As PATH it makes this machine a bare one.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

# Program -> the Debian packages that bring it, as in apt-packages.txt.
PACKAGES = {
    "avr-gcc": "gcc-avr binutils-avr avr-libc arduino-core-avr",
    "check_urdf": "liburdfdom-tools",
    "chromium-headless-shell": "chromium-headless-shell",
    "cmp": "diffutils",
    "gpsd": "gpsd",
    "gpsfake": "gpsd-clients",
    "g++": "g++ libfastrtps-dev",
    "grep": "grep",
    "ign": "ignition-tools libsdformat-dev",
    "ogr2ogr": "gdal-bin",
    "openssl": "openssl",
    "shellcheck": "shellcheck",
    "systemd-analyze": "systemd",
    "roscore": "python3-roslaunch python3-rostopic python3-rosbag",
    "roslaunch": "python3-roslaunch",
    "rosservice": "python3-rosservice python3-std-srvs python3-move-base-msgs python3-actionlib",
    "simavr": "gcc simavr libsimavr-dev",
    "str2str": "rtklib",
    "rviz": "rviz xvfb joint-state-publisher ros-robot-state-publisher",
}
# The whole browser does as well, and takes half as much again: it has a window of its own to draw.
OTHER_NAMES = {"chromium-headless-shell": ("chromium", "chromium-browser")}
HIDDEN = frozenset({*PACKAGES, *(name for names in OTHER_NAMES.values() for name in names)})
COREUTILS = """
    arch b2sum base32 base64 basename basenc cat chcon chgrp chmod chown chroot cksum comm cp csplit
    cut date dd df dir dircolors dirname du echo env expand expr factor false fmt fold groups head
    hostid id install join link ln logname ls md5sum mkdir mkfifo mknod mktemp mv nice nl nohup
    nproc numfmt od paste pathchk pinky pr printenv printf ptx pwd readlink realpath rm rmdir runcon
    seq sha1sum sha224sum sha256sum sha384sum sha512sum shred shuf sleep sort split stat stdbuf stty
    sum sync tac tail tee test timeout touch tr true truncate tsort tty uname unexpand uniq unlink
    uptime users vdir wc who whoami yes
"""
BARE = frozenset({"python3", "make", "git", "sh", "bash", *COREUTILS.split()})
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


def link_bare_programs(folder: Path) -> None:
    """Fill a folder with links to the programs of a bare machine."""
    for program in sorted(BARE):
        path = shutil.which(program)
        if program == "python3":
            path = str(Path(sys.executable).resolve())  # the PATH may have a wrapper of it
        if path:
            (folder / program).symlink_to(path)


if __name__ == "__main__":
    link_bare_programs(Path(sys.argv[1]))
