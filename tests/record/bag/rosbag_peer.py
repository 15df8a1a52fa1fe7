"""Reads a bag with ROS 1's own rosbag, run by the system's Python: no AGRIBOT code.

Answers with a JSON list of [topic, type, time in nanoseconds, bytes in hexadecimal], and the
compression of its chunks.
"""

from __future__ import annotations

import json
import sys

import rosbag

with rosbag.Bag(sys.argv[1]) as bag:
    messages = [
        [topic, raw[0], stamp.to_nsec(), raw[1].hex()]
        for topic, raw, stamp in bag.read_messages(raw=True)
    ]
    compression = bag.get_compression_info().compression
json.dump({"messages": messages, "compression": compression}, sys.stdout)
