"""The scene of the map's displays, published by a node of rospy."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from agribot.record.bag.definitions import ros1_store
from tests.ros.messages.shown_scene import make_scene, to_ros1
from tests.ros.ros1_system import Ros1

SCRIPT = Path(__file__).with_name("rospy_talker.py")


def start_talker(ros: Ros1) -> subprocess.Popen[str]:
    """Start the node; all its topics are advertised when this returns."""
    lines = []
    for said in make_scene():
        ros_type = said.message.__msgtype__
        text, _ = ros1_store().generate_msgdef(ros_type, ros_version=1)
        data = to_ros1(said.message).hex()
        name = ros_type.replace("/msg/", "/")
        lines.append(json.dumps([said.topic, name, text, data, said.rate_hz]))
    scene = ros.folder / "scene.jsonl"
    scene.write_text("\n".join(lines), encoding="utf-8")
    talker = ros.start("/usr/bin/python3", str(SCRIPT), str(scene))
    assert talker.stdout is not None
    assert talker.stdout.readline() == "ready\n"
    return talker
