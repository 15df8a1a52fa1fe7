"""A user of the original sits at this robot, with the tools of a real ROS 1."""

from __future__ import annotations

import subprocess
from contextlib import closing
from pathlib import Path

from tests import machine
from tests.ros.live import ROOT
from tests.ros.ros1_system import Ros1

PATIENCE_S = 600.0
SCRIPT = ROOT / "tests" / "ros" / "original_user.py"


@machine.needs("roslaunch")
@machine.needs("rosservice")
def test_every_step_of_a_user_of_the_original_does_what_it_did_there(tmp_path: Path) -> None:
    with closing(Ros1(tmp_path)) as ros:
        ros.add_package()
        done = subprocess.run(
            ["/usr/bin/python3", str(SCRIPT)], env=ros.environment, cwd=tmp_path, text=True,
            capture_output=True, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
    steps = [line.partition("  ")[0] for line in done.stdout.splitlines()]
    assert steps == ["pass"] * 17, f"{done.stdout}\n{done.stderr}"
    assert done.returncode == 0
