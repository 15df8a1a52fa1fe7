"""What a node is to the program that runs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from agribot.core.topics import Topic


class Said(NamedTuple):
    """One message to publish, as a ROS 2 message object of the topic's type."""

    topic: Topic
    message: Any


class Stage(Protocol):
    """Called from one thread. `t_s` is the runner's clock, which never goes back.

    `reason` says in words why the node is quiet or the robot stands; empty when all is well.
    `is_done` ends the program with `ok` as its verdict.
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

    def hear(self, topic: Topic, message: Any, t_s: float) -> Sequence[Said]: ...
    def tick(self, t_s: float) -> Sequence[Said]:
        """Ten times a second, whatever is heard."""
        ...

    def last_words(self) -> Sequence[Said]:
        """When the program ends."""
        ...


class Endless:
    """Of nodes that run until somebody stops them."""

    reason = ""
    is_done = False
    ok = True

    def tick(self, t_s: float) -> Sequence[Said]:
        return ()

    def last_words(self) -> Sequence[Said]:
        return ()
