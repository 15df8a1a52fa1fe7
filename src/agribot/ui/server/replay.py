"""A recording in the same page: states as they were, at any speed, from any time."""

from __future__ import annotations

import bisect
import math
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from agribot.core import topics
from agribot.core.errors import DescriptionError, RecordingError
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import MappedPlant, TickRecord
from agribot.description.loader import parse_robot
from agribot.record.events import Event, EventSieve
from agribot.record.mcap_file import read_messages
from agribot.record.replay import (
    read_config,
    read_gaps,
    read_ticks,
    read_urdf,
    read_weed_map,
)
from agribot.ros.messages.rosmsg import load_types
from agribot.ui import wire
from agribot.ui.ground import read_field_or_datum
from agribot.ui.server.channel import Channel
from agribot.ui.server.pictures import EncodedPicture, Pictures
from agribot.ui.view import RunView, shown_event, shown_plant

MIN_SPEED, MAX_SPEED = 0.1, 10.0
MAX_STATES = 40_000  # some 30 MB
STATE_EVERY = 2  # ticks; a long recording is thinned further
STATE_HZ = 30.0
RECEIVER_S = 1.0  # time between two states of the GNSS receiver, of the recording and on the wall


class Moment(msgspec.Struct, frozen=True, kw_only=True):
    """One state of the recording and of its receiver, encoded, and how long the trace was."""

    t_s: float
    state: bytes
    traced: int
    receiver: bytes = b""


class Replay(Channel):
    """Follow it like the live robot; `step` moves it on. Nothing can be commanded in it."""

    def __init__(
        self,
        name: str,
        moments: list[Moment],
        trace_map_m: list[wire.Vec2],
        plants: tuple[MappedPlant, ...],
        events: list[Event],
        path: wire.PathPiece | None,
        pictures: Pictures,
        field: wire.Field,
    ) -> None:
        super().__init__("replay", name)
        self.speed = 1.0
        self.field = field
        self._moments, self._whole_trace = moments, trace_map_m
        self._times = [moment.t_s for moment in moments]
        self._plants, self.recorded_events = plants, events
        self._whole_path = path
        self._pictures = pictures
        self.file = Path()  # set where it was read from one
        self._index = -1
        self._now_s = moments[0].t_s
        self._wall_s: float | None = None
        self._receiver_at_s = 0.0
        self._shown_weeds: dict[int, wire.Weed] = {}
        self._shown_receiver = b""
        self._next_event = 0
        self.seek(moments[0].t_s)

    @classmethod
    def load(cls, path: Path, name: str) -> Replay:
        """Read a recording; one that was cut off is read up to its last whole message.

        Raises: RecordingError: no recording, or nothing in it.
        """
        view = RunView(read_config(path), _read_implement(path))
        sieve, events = EventSieve(), list[Event]()

        def look(record: TickRecord) -> None:
            view(record)
            events.extend(sieve(record))

        moments = _moments(path, view, look)
        events = sorted((*events, *read_gaps(path)), key=lambda event: event.t_s)
        if not moments:
            raise RecordingError(f"{path} holds no ticks; the run ended before it began")
        try:
            plants = read_weed_map(path)
        except RecordingError:
            plants = ()  # a run that was cut off has none
        pictures = Pictures.load(path)
        field = read_field_or_datum(path)
        replay = cls(name, moments, view.trace_map_m, plants, events, _path(path), pictures, field)
        replay.file = path
        return replay

    @property
    def progress(self) -> wire.ReplayProgress:
        return wire.ReplayProgress(
            name=self.name,
            t_s=self._now_s,
            start_s=self._times[0],
            end_s=self._times[-1],
            speed=self.speed,
        )

    @property
    def now_s(self) -> float:
        """The time of the recording that is shown."""
        return self._now_s

    def picture(self) -> tuple[int, EncodedPicture] | None:
        """Find what the camera saw last, and its number; None before its first picture."""
        return self._pictures.at(self._now_s)

    def seek(self, t_s: float) -> None:
        """Go to a time; pages get everything up to it afresh."""
        self._now_s = min(max(t_s, self._times[0]), self._times[-1])
        self._index = max(bisect.bisect_right(self._times, self._now_s) - 1, 0)
        self.restart()
        self._shown_weeds, self._next_event = {}, 0
        self._shown_receiver = b""
        moment = self._moments[self._index]
        self.trace_map_m = self._whole_trace[: moment.traced]
        self.path = self._whole_path or self.path
        self.path_revision += 1
        self._publish_weeds()
        self._publish_events()
        self._publish_receiver()
        self._publish_state(_read_state(moment).signals)

    def step(self, wall_s: float) -> None:
        """Move on to where the recording is by now, on the clock on the wall."""
        passed_s = 0.0 if self._wall_s is None else min(wall_s - self._wall_s, 0.5)
        self._wall_s = wall_s
        self._now_s = min(self._now_s + passed_s * self.speed, self._times[-1])
        index = bisect.bisect_right(self._times, self._now_s) - 1
        if index <= self._index:
            self._publish_state([])
            return
        before = self._moments[self._index].traced
        passed = self._moments[self._index + 1 : index + 1]
        self._index = index
        new = self._whole_trace[before : self._moments[index].traced]
        if new:
            self.publish_growth(wire.TracePiece(first=before, points_map_m=new))
        self._publish_weeds()
        self._publish_events()
        if wall_s - self._receiver_at_s >= RECEIVER_S:
            self._receiver_at_s = wall_s
            self._publish_receiver()
        self._publish_state([sample for moment in passed for sample in _read_state(moment).signals])

    def _publish_state(self, signals: list[wire.Sample]) -> None:
        self.publish_state(
            msgspec.structs.replace(
                _read_state(self._moments[self._index]),
                signals=signals,
                mono_ms=round(time.monotonic() * 1e3, 1),
                replay=self.progress,
            )
        )

    def _publish_weeds(self) -> None:
        changed = [
            weed
            for weed in (_weed_known(plant, self._now_s) for plant in self._plants)
            if weed is not None and self._shown_weeds.get(weed.id) != weed
        ]
        if changed:
            self._shown_weeds.update((weed.id, weed) for weed in changed)
            self.publish_growth(wire.WeedChanges(set=changed))

    def _publish_events(self) -> None:
        events = []
        while self._next_event < len(self.recorded_events):
            event = self.recorded_events[self._next_event]
            if event.t_s > self._now_s:
                break
            self._next_event += 1
            events.append(shown_event(event))
        if events:
            self.publish_growth(wire.NewEvents(events=events))

    def _publish_receiver(self) -> None:
        receiver = self._moments[self._index].receiver
        if receiver != self._shown_receiver:
            self._shown_receiver = receiver
            self.publish_growth(msgspec.json.decode(receiver, type=wire.ReceiverState))


def _read_implement(path: Path) -> ImplementSpec | None:
    """Read the recorded robot; None where its description is lost or of an unknown kind."""
    try:
        return parse_robot(read_urdf(path), path.name).implement
    except (RecordingError, DescriptionError):
        return None


def _moments(path: Path, view: RunView, look: Callable[[TickRecord], None]) -> list[Moment]:
    moments: list[Moment] = []
    every = STATE_EVERY
    receiver, receiver_s = b"", -math.inf
    for number, record in enumerate(read_ticks(path)):
        look(record)
        if record.batch.t_s - receiver_s >= RECEIVER_S:
            receiver_s = record.batch.t_s
            receiver = wire.encode(view.receiver.show())
        if number % every:
            continue
        moments.append(_moment(view, receiver))
        if len(moments) >= MAX_STATES:
            moments, every = moments[::2], every * 2
    return moments


def _moment(view: RunView, receiver: bytes) -> Moment:
    state = view.state()
    assert state is not None  # it has just seen a tick
    shown = msgspec.structs.replace(state, mode="replay")
    return Moment(
        t_s=state.t_s,
        state=wire.encode(shown),
        traced=len(view.trace_map_m),
        receiver=receiver,
    )


def _read_state(moment: Moment) -> wire.State:
    return msgspec.json.decode(moment.state, type=wire.State)


def _weed_known(plant: MappedPlant, t_s: float) -> wire.Weed | None:
    """As far as it was known at `t_s`; a recording keeps the map of its end alone."""
    if plant.first_seen_s > t_s or plant.sightings < 2:
        return None
    treated_s = plant.treated_s if plant.treated_s is not None and plant.treated_s <= t_s else None
    return shown_plant(plant, treated_s, plant.left)


def _path(path: Path) -> wire.PathPiece | None:
    """Read the last plan of the recording."""
    found: wire.PathPiece | None = None
    for message in read_messages(path, topics.PATH):
        planned = load_types().deserialize_cdr(message.data, topics.PATH.ros_type)
        poses = planned.poses  # type: ignore[attr-defined]
        points = [(round(p.pose.position.x, 4), round(p.pose.position.y, 4)) for p in poses]
        found = wire.PathPiece(points_map_m=points, rows=[-1] * len(points))
    return found
