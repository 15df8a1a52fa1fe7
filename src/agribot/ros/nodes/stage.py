"""The interface of a node to the program that runs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from agribot.core.topics import Topic


class OutgoingMessage(NamedTuple):
    """One message to publish, as a ROS 2 message object of the topic's type."""

    topic: Topic
    message: Any


class NodeStage(Protocol):
    """One stage of the stack as a node, called from one thread.

    `t_s` is the runner's clock, which never goes back. `reason` says why the node publishes
    nothing or the robot stands; empty when all is well. `is_done` ends the program, `ok` says
    whether it succeeded.
    """

    @property
    def inputs(self) -> Sequence[Topic]: ...
    @property
    def outputs(self) -> Sequence[Topic]: ...
    @property
    def reason(self) -> str: ...
    @property
    def is_done(self) -> bool: ...
    @property
    def ok(self) -> bool: ...

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]: ...
    def tick(self, t_s: float) -> Sequence[OutgoingMessage]:
        """Return the messages of a step, ten times a second."""
        ...

    def finish(self) -> Sequence[OutgoingMessage]:
        """Return the messages to publish when the program ends."""
        ...


class EndlessStage:
    """A node that runs until it is stopped."""

    reason = ""
    is_done = False
    ok = True

    def tick(self, t_s: float) -> Sequence[OutgoingMessage]:
        return ()

    def finish(self) -> Sequence[OutgoingMessage]:
        return ()
