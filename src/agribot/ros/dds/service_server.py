"""Services of a ROS 2 node on DDS, as rmw_cyclonedds carries them.

A service is two topics. Request and response begin with sixteen bytes by which a client knows the
response to its request. Fast DDS carries them beside the message, so its clients get no response.
Source: rmw_cyclonedds_cpp of Humble to Rolling, rmw_node.cpp and serdata.cpp.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.dds.discovery import read_user_data
from agribot.ros.dds.node import DdsNode, SampleOrigin, write
from agribot.ros.ros2.serving import Answer, ServedType
from agribot.ros.send_queue import SendQueue

_ENCAPSULATION = 4  # bytes before CDR that say its byte order
_HEADER = 16  # bytes: the client's number, and that of its request
_FAST_DDS = bytes([0x01, 0x0F])  # first bytes of the ids of all that is made by eProsima
_MATCH_S = 1.0  # time within which a client must have been found that asks already
_LOOK_S = 0.005
_MOST_WAITING = 1000  # messages that wait to be answered, and responses to be sent


class _Response(NamedTuple):
    """A response; `client` is who waits for it, at the `origin` of the request."""

    writer: Any
    client: str
    origin: SampleOrigin
    data: bytes

    def is_awaited(self) -> bool:
        """Whether the client's reader is known here, so that the response arrives there."""
        handles = self.writer.get_matched_subscriptions()
        readers = map(self.writer.get_matched_subscription_data, handles)
        return any(one is not None and _name_client(one) == self.client for one in readers)


class DdsServiceServer:
    """A node that serves, too; `refuse` is called with what is no request.

    What comes is answered in one thread, as those of DDS may not write; responses leave in another,
    as soon as the client's reader is found.
    """

    source = "DDS"
    distinguishes_forms = False  # clients of Jazzy and before send only the name of a type

    def __init__(self, node: DdsNode, refuse: Callable[[str], None]) -> None:
        self._node, self._refuse = node, refuse
        self._numbers = itertools.count(1)
        self._responses: SendQueue[_Response] = SendQueue(self._send, _MOST_WAITING)
        self._tasks: SendQueue[Callable[[], None]] = SendQueue(lambda do: do(), _MOST_WAITING)

    def create_publisher(
        self, topic: Topic, types: Typestore | None = None
    ) -> Callable[[bytes], None]:
        return self._node.create_publisher(topic, types)

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        self._node.subscribe(topic, lambda data: self._tasks.put(lambda: on_message(data)))

    def serve(
        self,
        types: Typestore,
        name: str,
        ros_type: str,
        answer: Answer,
        to_garbage: tuple[Any, ...] = (),
    ) -> None:
        """Serve the service `name`; call the node's `announce` after the last one."""
        service = ServedType(types, name, ros_type, answer, to_garbage)
        request, response = (
            Topic(name=name, ros_type=f"{ros_type}_{part}") for part in ("Request", "Response")
        )
        # A client compares this id to find both topics of one service.
        user = f"serviceid={self._node.participant.guid.hex}{next(self._numbers):08x};"
        writer = self._node.open_writer(response, f"rr{name}Reply", types, user)

        def on_request(data: bytes, origin: SampleOrigin) -> None:
            self._tasks.put(lambda: self._take(service, writer, data, origin))

        def on_client(origin: SampleOrigin) -> None:
            self._tasks.put(lambda: self._check_client(name, origin))

        self._node.open_reader(request, f"rq{name}Request", on_request, types, user, on_client)

    def close(self) -> None:
        self._tasks.close()
        self._responses.close()

    def _check_client(self, name: str, origin: SampleOrigin) -> None:
        """Report a client that waits in vain, as soon as it is found."""
        client = origin.find_writer()
        if client is not None and client.key.bytes.startswith(_FAST_DDS):
            self._refuse(
                f"DDS: a client of {name} is on Fast DDS, which carries requests otherwise, and "
                "gets no answer; set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp there"
            )

    def _take(self, service: ServedType, writer: Any, data: bytes, origin: SampleOrigin) -> None:
        asker = origin.find_writer()
        if asker is None or asker.key.bytes.startswith(_FAST_DDS):
            return
        client, (header, request) = _name_client(asker), split_header(data)

        def send(response: bytes) -> None:
            self._responses.put(_Response(writer, client, origin, join_header(header, response)))

        if wrong := service.take(request, send):
            self._refuse(f"DDS: {wrong}")

    def _send(self, response: _Response) -> None:
        until_s = time.monotonic() + _MATCH_S
        while not response.is_awaited():
            if time.monotonic() > until_s or response.origin.find_writer() is None:
                return  # the client is gone
            time.sleep(_LOOK_S)
        try:
            write(response.writer, response.data)
        except BridgeError as error:
            self._refuse(str(error))


def split_header(data: bytes) -> tuple[bytes, bytes]:
    """Split the client's sixteen bytes from a request in CDR, which Cyclone gives in our order."""
    end = _ENCAPSULATION + _HEADER
    return data[_ENCAPSULATION:end], data[:_ENCAPSULATION] + data[end:]


def join_header(header: bytes, data: bytes) -> bytes:
    """Put the client's sixteen bytes in front of a response in CDR."""
    return data[:_ENCAPSULATION] + header + data[_ENCAPSULATION:]


def _name_client(endpoint: Any) -> str:
    """Name the client of an endpoint; one that gives itself no name is its whole program."""
    return read_user_data(endpoint.qos, "clientid") or endpoint.participant_key.hex
