"""A camera's node of ROS 1, on the system's own rospy: no AGRIBOT code.

Arguments: topic, encoding or "jpeg", file of raw RGB pixels or of a JPEG, width, height.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rospy
from sensor_msgs.msg import CompressedImage, Image  # type: ignore[import-not-found]


def main() -> None:
    topic, encoding, file, width, height = sys.argv[1:]
    rospy.init_node("usb_cam", disable_signals=True)
    data = Path(file).read_bytes()
    if encoding == "jpeg":
        message = CompressedImage(format="jpeg", data=data)
    else:
        message = Image(height=int(height), width=int(width), encoding=encoding, data=data)
        message.step = len(data) // int(height)
    publisher = rospy.Publisher(topic, type(message), queue_size=2)
    while True:
        message.header.stamp = rospy.Time.now()
        publisher.publish(message)
        rospy.sleep(0.1)


if __name__ == "__main__":
    main()
