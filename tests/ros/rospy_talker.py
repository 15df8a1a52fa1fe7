"""A node of rospy that publishes messages of any type, run by the system's own Python.

Its only argument is a file of JSON lines: topic, type, definition, messages in ROS 1's bytes
(hexadecimal), rate in Hz (0 is the first alone, latched). Says "ready" when all are advertised.
"""

from __future__ import annotations

import itertools
import json
import sys
import threading
from pathlib import Path

import rospy
from genpy.dynamic import generate_dynamic


def talk(line: str) -> None:
    topic, ros_type, definition, data, rate_hz = json.loads(line)
    kind = generate_dynamic(ros_type, definition)[ros_type]
    messages = [kind().deserialize(bytes.fromhex(each)) for each in data]
    publisher = rospy.Publisher(topic, kind, queue_size=2, latch=not rate_hz)
    if not rate_hz:
        publisher.publish(messages[0])
        return

    def run() -> None:
        rate = rospy.Rate(rate_hz)
        for message in itertools.cycle(messages):
            if rospy.is_shutdown():
                return
            publisher.publish(message)
            rate.sleep()

    threading.Thread(target=run, daemon=True).start()


if __name__ == "__main__":
    rospy.init_node("talker", anonymous=True, disable_signals=False)
    for each in Path(sys.argv[1]).read_text(encoding="utf-8").splitlines():
        talk(each)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    rospy.spin()
