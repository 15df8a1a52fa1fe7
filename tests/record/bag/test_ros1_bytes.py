"""The messages of the original's tools byte by byte as ROS 1 itself writes them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from agribot.core import topics
from agribot.record.bag.definitions import ros1_store
from tests import machine
from tests.record.bag.random_messages import Dice
from tests.record.bag.test_definitions import GPS, MARTI

PYTHON = "/usr/bin/python3"
HAS_GENPY = Path("/usr/lib/python3/dist-packages/genpy").is_dir()
TYPES = sorted(
    {name.replace("/", "/msg/") for name in (*MARTI, *GPS)}
    | {topic.seed_ros_type for topic in topics.TOPICS if topic.seed_ros_type}
)
STORE = ros1_store()


@pytest.mark.skipif(not HAS_GENPY, reason=machine.missing("roscore"))
def test_every_type_of_the_original_is_written_as_ros_1_writes_it() -> None:
    ours, asked = [], []
    for seed, ros_type in enumerate(TYPES):
        message, values = Dice(STORE, seed).message(ros_type)
        ours.append(bytes(STORE.serialize_ros1(message, ros_type)).hex())
        text, _ = STORE.generate_msgdef(ros_type, ros_version=1)
        asked.append([ros_type.replace("/msg/", "/"), text, values])
    peer = Path(__file__).parent / "genpy_peer.py"
    done = subprocess.run(
        [PYTHON, str(peer)], input=json.dumps(asked), capture_output=True, text=True,
        timeout=120, check=False, env={"LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(TYPES) >= 20
    for ros_type, mine, theirs in zip(TYPES, ours, json.loads(done.stdout), strict=True):
        assert mine == theirs, ros_type
