"""Bags that are written here, read by the rosbag of ROS 1 itself."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from rosbags import rosbag1

from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.bag.sinks import Compression
from tests import machine, nightly
from tests.record.bag import bag_samples as samples

PYTHON = "/usr/bin/python3"
HAS_ROSBAG = Path("/usr/lib/python3/dist-packages/rosbag").is_dir()
PEER = Path(__file__).parent / "rosbag_peer.py"


@pytest.mark.skipif(not HAS_ROSBAG, reason=machine.missing("roscore"))
@nightly.one_by_one("compression", ("lz4", "none", "bz2"), in_suite=1)
def test_ros_1_reads_every_message_of_a_bag_of_ours(
    tmp_path: Path, compression: Compression
) -> None:
    samples.write_run(tmp_path / "run.mcap")
    convert(tmp_path / "run.mcap", tmp_path / "run.bag", ConvertOptions(compression=compression))
    done = subprocess.run(
        [PYTHON, str(PEER), str(tmp_path / "run.bag")], capture_output=True, text=True,
        timeout=120, check=False, env={"LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    with rosbag1.Reader(tmp_path / "run.bag") as reader:
        ours = [
            [c.topic, c.msgtype.replace("/msg/", "/"), t_ns, bytes(data).hex()]
            for c, t_ns, data in reader.messages()
        ]
    assert answer["compression"] == compression
    assert len(ours) > 500 and sorted(answer["messages"]) == sorted(ours)
