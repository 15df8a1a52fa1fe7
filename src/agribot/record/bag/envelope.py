"""What is no ROS message, carried through recordings that hold nothing else.

A tick of AGRIBOT is MessagePack and its settings are files inside the MCAP. In a ROS 1 bag or a
rosbag2 they travel as std_msgs/UInt8MultiArray whose first dimension is labelled with what they
are; on the way back to MCAP they become what they were.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from rosbags.typesys.store import Typestore

from agribot.record.bag.source import BagFile

ROS_TYPE = "std_msgs/msg/UInt8MultiArray"
FILES_TOPIC = "/agribot/files"
_MARK = "agribot:"


class Label(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Label of a message, its encoding and schema; of a file, its name and media type."""

    encoding: str = ""
    schema_name: str = ""
    schema_encoding: str = ""
    file_name: str = ""
    media_type: str = ""


def wrap(label: Label, data: bytes, store: Typestore) -> Any:
    text = _MARK + msgspec.json.encode(label).decode()
    dimension = store.types["std_msgs/msg/MultiArrayDimension"](text, len(data), len(data))
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([dimension], 0)
    return store.types[ROS_TYPE](layout, np.frombuffer(data, dtype=np.uint8))


def wrap_file(file: BagFile, store: Typestore) -> Any:
    label = Label(file_name=file.name, media_type=file.media_type)
    return wrap(label, file.data, store)


def unwrap(message: Any) -> tuple[Label, bytes] | None:
    """Take what an envelope holds out of it; None for an array that is no envelope."""
    dimensions = message.layout.dim
    if len(dimensions) != 1 or not dimensions[0].label.startswith(_MARK):
        return None
    try:
        label = msgspec.json.decode(dimensions[0].label[len(_MARK) :], type=Label)
    except msgspec.MsgspecError:
        return None
    return label, np.asarray(message.data, dtype=np.uint8).tobytes()
