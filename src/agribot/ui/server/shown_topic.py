"""One topic that displays look at: its newest messages, as JSON, not more often than they need."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from agribot.core.errors import BridgeError
from agribot.ros.messages.frame_tree import clean_name
from agribot.ros.messages.shown_messages import FramePlaces, ShownMessage, UnknownFrame
from agribot.ros.messages.shown_sets import TopicView, adds_up, make_view

Decode = Callable[[str, bytes], Any]

LEAST_PERIOD_S = 0.2  # least time between two that are made for the page
BYTES_PER_S = 1_000_000.0  # rate of one topic: a large message comes less often
# Time after which the same is made anew: its frame may have moved, a marker have ended.
AGAIN_S = 2.0
STALE_S = 3.0  # silence of a topic that came again and again
STALE_PERIODS = 5.0
MOST_WAITING = 300  # messages that add up, between two looks
_MOST_PERIOD_S = 60.0


class ShownTopic:
    """Take messages in any thread with `put`; `update` and the rest are one thread's.

    `seq` changes whenever `json` does. `now_s` is the clock of arrival.
    """

    def __init__(
        self, decode: Decode, places: FramePlaces, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._decode, self._places, self._now_s = decode, places, now_s
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=MOST_WAITING)
        self._view: TopicView | None = None
        self.ros_type = ""
        self.seq = 0
        self.json: msgspec.Raw | None = None
        self.note = ""  # the problem, or empty
        self.left_out = ""
        self.count = 0
        self._lost = 0
        self._arrived_s: float | None = None
        self._period_s: float | None = None
        self._next_show_s = 0.0
        self._is_changed = False

    def put(self, ros_type: str, data: bytes) -> None:
        """Keep a message until the next update; those that stand for themselves take its place."""
        now_s = self._now_s()
        if self._arrived_s is not None:
            passed_s = min(now_s - self._arrived_s, _MOST_PERIOD_S)
            before_s = self._period_s
            self._period_s = passed_s if before_s is None else 0.8 * before_s + 0.2 * passed_s
        self._arrived_s = now_s
        self.count += 1
        if not adds_up(ros_type):
            self._waiting.clear()
        elif len(self._waiting) == MOST_WAITING:
            self._lost += 1
        self._waiting.append((ros_type, data))

    @property
    def age_s(self) -> float | None:
        """For how long nothing has come; None before the first message."""
        return None if self._arrived_s is None else self._now_s() - self._arrived_s

    @property
    def rate_hz(self) -> float | None:
        return None if not self._period_s else 1.0 / self._period_s

    @property
    def is_silent(self) -> bool:
        """Whether one that came again and again has stopped."""
        age_s, period_s = self.age_s, self._period_s
        if age_s is None or period_s is None:
            return False
        return age_s > max(STALE_S, STALE_PERIODS * period_s)

    def update(self) -> None:
        """Decode what has come, and make JSON of it where it is time."""
        self.take_waiting()
        now_s = self._now_s()
        wait_s = 0.0 if self._is_changed else AGAIN_S
        if self._view is None or now_s < self._next_show_s + wait_s:
            return
        self._is_changed = False
        self._next_show_s = now_s + LEAST_PERIOD_S
        try:
            shown = self._view.show(self._places, now_s)
        except (UnknownFrame, BridgeError) as error:
            self.note = str(error)
            self._is_changed = True  # a transform may come soon
            return
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            self.note = f"a message that contradicts itself: {error}"
            return
        if shown is not None:
            self._keep(shown, now_s)

    def take_waiting(self) -> None:
        """Decode the messages that have come; the note names one that cannot be read."""
        while True:
            try:
                ros_type, data = self._waiting.popleft()
            except IndexError:  # another thread puts and clears meanwhile
                return
            if self._view is None or not self._fits(ros_type):
                self._view, self.ros_type = make_view(ros_type), ros_type
            self._is_changed = True
            try:
                self._view.take(self._decode(ros_type, data), self._now_s())
            except BridgeError as error:
                self.note = str(error)

    def _fits(self, ros_type: str) -> bool:
        return type(make_view(ros_type)) is type(self._view)

    def _keep(self, shown: ShownMessage, now_s: float) -> None:
        text = msgspec.json.encode(shown.value)
        lost = f"{self._lost} messages came too fast" if self._lost else ""
        self.left_out = "; ".join(part for part in (shown.left_out, lost) if part)
        self.note = shown.problem
        self._next_show_s = now_s + max(LEAST_PERIOD_S, len(text) / BYTES_PER_S)
        if self.json is None or text != bytes(self.json):
            self.json = msgspec.Raw(text)
            self.seq += 1


def show_frame(places: FramePlaces, frame: str) -> dict[str, Any]:
    """Show a frame itself as a TransformStamped.

    Raises: UnknownFrame: no transform leads to the map.
    """
    header = {"frame_id": clean_name(frame), **places(frame)}
    still = {"translation": dict.fromkeys("xyz", 0.0), "rotation": {**dict.fromkeys("xyz", 0.0)}}
    still["rotation"]["w"] = 1.0
    return {"header": header, "child_frame_id": clean_name(frame), "transform": still}
