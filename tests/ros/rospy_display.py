"""A node of rospy that adds displays to a map as to mapviz, run by the system's own Python.

Its arguments are JSON lists: name, type, draw order, visible, properties. Writes each answer as
one line of JSON. The types are written by hand, since mapviz itself is not installed.
"""

from __future__ import annotations

import json
import struct
import sys
from typing import Any

import genpy
import rospy


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


class Request(genpy.Message):  # type: ignore[misc]
    _type = "mapviz/AddMapvizDisplayRequest"
    _md5sum = _full_text = ""
    _has_header = False
    __slots__ = ("draw_order", "name", "properties", "type", "visible")
    _slot_types = ("int32", "string", "string", "string", "bool")

    def serialize(self, buffer: Any) -> None:
        buffer.write(text(self.name) + text(self.type))
        buffer.write(struct.pack("<i?I", self.draw_order, self.visible, len(self.properties)))
        for pair in self.properties.items():
            buffer.write(b"".join(map(text, pair)))


class Response(genpy.Message):  # type: ignore[misc]
    _type = "mapviz/AddMapvizDisplayResponse"
    _md5sum = _full_text = ""
    _has_header = False
    __slots__ = ("message", "success")
    _slot_types = ("string", "bool")

    def deserialize(self, data: bytes) -> Response:
        self.success, size = struct.unpack_from("<?I", data)
        self.message = data[5 : 5 + size].decode()
        return self


class AddDisplay:
    _type = "mapviz/AddMapvizDisplay"
    _md5sum = "7bd51d7a9d8469fae51039cf79b96d10"  # that of mapviz 1.4
    _request_class, _response_class = Request, Response


if __name__ == "__main__":
    rospy.init_node("client", anonymous=True)
    rospy.wait_for_service("/add_mapviz_display", 60.0)
    call = rospy.ServiceProxy("/add_mapviz_display", AddDisplay)
    for argument in sys.argv[1:]:
        name, kind, draw_order, visible, properties = json.loads(argument)
        answer = call(
            name=name, type=kind, draw_order=draw_order, visible=visible, properties=properties
        )
        sys.stdout.write(json.dumps([answer.success, answer.message]) + "\n")
