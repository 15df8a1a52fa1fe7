"""Services of a node of ROS 2, whatever carries their requests: rmw_zenoh's wire, or DDS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from rosbags.typesys.store import Typestore

from agribot.core.topics import Topic

Reply = Callable[..., None]  # with the fields of the response; may be called later, once
Answer = Callable[[Any, Reply], None]  # gets the request


class ServingNode(Protocol):
    """A node with topics and services; `source` names its peers.

    If it `distinguishes_forms`, one service may be served in several forms of its type.
    """

    source: str
    distinguishes_forms: bool

    def create_publisher(
        self, topic: Topic, types: Typestore | None = None
    ) -> Callable[[bytes], None]: ...

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None: ...

    def serve(
        self,
        types: Typestore,
        name: str,
        ros_type: str,
        answer: Answer,
        to_garbage: tuple[Any, ...] = (),
    ) -> None:
        """Serve the service `name`; a thread of the network calls `answer` with each request.

        `to_garbage` are the fields of the answer to bytes that are no request; none: no answer.
        """
        ...


class ServedType(NamedTuple):
    """A service with its type in `types`."""

    types: Typestore
    name: str
    ros_type: str
    answer: Answer
    to_garbage: tuple[Any, ...] = ()

    def take(self, data: bytes, send: Callable[[bytes], None]) -> str:
        """Take a request in CDR, whose response goes to `send`; return what is wrong with it."""

        def reply(*fields: Any) -> None:
            response_type = f"{self.ros_type}_Response"
            response = self.types.types[response_type](*fields)
            send(bytes(self.types.serialize_cdr(response, response_type)))

        try:
            request = self.types.deserialize_cdr(data, f"{self.ros_type}_Request")
        except Exception:  # noqa: BLE001  the generated code of rosbags raises any error
            if self.to_garbage:
                reply(*self.to_garbage)
            return f"{self.name}: {len(data)} bytes are no request of {self.ros_type}"
        self.answer(request, reply)
        return ""
