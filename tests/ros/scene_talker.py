"""The scene of the map's displays, published by a node of rospy."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable
from pathlib import Path

from tests.ros.publications import Publication, list_scene, write_for_ros1
from tests.ros.ros1_system import Ros1

SCRIPT = Path(__file__).with_name("rospy_talker.py")


def start_talker(
    ros: Ros1, publications: Iterable[Publication] | None = None
) -> subprocess.Popen[str]:
    """Start the node; all its topics are advertised when this returns."""
    scene = ros.folder / "scene.jsonl"
    write_for_ros1(scene, list_scene() if publications is None else publications)
    talker = ros.start("/usr/bin/python3", str(SCRIPT), str(scene))
    assert talker.stdout is not None
    assert talker.stdout.readline() == "ready\n"
    return talker
