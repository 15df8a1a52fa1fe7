"""Convert a recording to another format; every message that cannot be converted is counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from agribot.core.errors import RecordingError
from agribot.record.bag import envelope
from agribot.record.bag.definitions import (
    collect_definitions,
    make_transcoder,
    name_in_ros1,
    name_in_ros2,
    serialize,
)
from agribot.record.bag.opening import open_bag
from agribot.record.bag.sinks import Compression, Sink, Storage, open_sink
from agribot.record.bag.source import Bag, BagFile, BagMessage, BagTopic, UndecodableMessage
from agribot.record.bag.stamps import UNHOLDABLE, make_stamp_check
from agribot.ros.messages import fixes, utm

NS_A_YEAR = 365.2425 * 86400e9


class ConvertOptions(msgspec.Struct, frozen=True, kw_only=True):
    """`topics` empty: all. `fixes_as` rewrites NavSatFix to GPSFix or the other way round.

    `utm_of` are topics with a NavSatFix or GPSFix; each gets odometry on the UTM grid beside it,
    called <topic>/utm. `fix_of` are topics with such odometry; each gets a NavSatFix <topic>/fix.
    """

    topics: tuple[str, ...] = ()
    fixes_as: str = ""
    utm_of: tuple[str, ...] = ()
    fix_of: tuple[str, ...] = ()
    zone: utm.UtmZone | None = None
    compression: Compression = "none"
    storage: Storage = "sqlite3"


class ConvertResult(msgspec.Struct, frozen=True, kw_only=True):
    """`skipped` are messages that could not go along, by topic, `reasons` why.

    `damage` is what could not be read of the source, in words.
    """

    messages_in: int
    messages_out: int
    topics: dict[str, str]
    skipped: dict[str, int]
    reasons: dict[str, str]
    notes: tuple[str, ...]
    damage: tuple[str, ...]


class _Route(NamedTuple):
    """Target of one source topic's messages; `data` gives None for one that is skipped."""

    number: int
    data: Callable[[BagMessage], bytes | None]


def convert(
    source: Path,
    target: Path,
    options: ConvertOptions | None = None,
    on_message: Callable[[int, int], None] = lambda done, total: None,
) -> ConvertResult:
    """Convert any readable recording to .bag, .mcap, .db3 or a rosbag2 folder.

    Raises: RecordingError: the source cannot be read, the target exists or cannot be written.
    """
    options = options or ConvertOptions()
    with open_bag(source) as bag:
        for name in (*options.topics, *options.utm_of, *options.fix_of):
            bag.find(name)
        with open_sink(target, options.compression, options.storage) as sink:
            conversion = _Conversion(bag, sink, options)
            conversion.copy_files()
            for done, message in enumerate(bag.messages(conversion.wanted), start=1):
                conversion(message)
                on_message(done, bag.count)
            return conversion.make_result()


class _Conversion:
    def __init__(self, bag: Bag, sink: Sink, options: ConvertOptions) -> None:
        self._bag, self._sink, self._options = bag, sink, options
        self._store = sink.store
        self._names: dict[str, str] = {}
        self._skipped: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._enveloped: dict[tuple[str, str], int] = {}
        self._files_number: int | None = None
        self._count_in = self._count_out = 0
        self.wanted = frozenset(options.topics) or None
        chosen = [t for t in bag.topics if self.wanted is None or t.name in self.wanted]
        self._routes = {topic.id: list(self._make_routes(topic)) for topic in chosen}

    def __call__(self, message: BagMessage) -> None:
        self._count_in += 1
        if not 0 <= message.log_ns <= self._sink.last_ns:
            self._skip(message.topic, self._explain_time(message.log_ns))
            return
        for route in self._routes[message.topic.id]:
            try:
                data = route.data(message)
            except UndecodableMessage as error:
                self._skip(message.topic, str(error))
                continue
            except RecordingError:
                raise
            except Exception as error:  # noqa: BLE001  generated code, bytes of any kind
                self._skip(message.topic, f"bytes that are no {message.topic.ros_type}: {error}")
                continue
            if data is not None:
                self._sink.write(route.number, message.log_ns, message.publish_ns, data)
                self._count_out += 1

    def copy_files(self) -> None:
        """Files inside the source: as such in an MCAP, else as messages at its first moment.

        An MCAP keeps a note of each gap, too.
        """
        for damage in self._bag.damage if self._sink.holds_anything else ():
            if damage.is_gap:
                self._sink.note_lost(damage)
        if self.wanted is not None:
            return
        t_ns = self._bag.times_ns[0] if self._bag.times_ns else 0
        for file in self._bag.files():
            if self._sink.holds_anything:
                self._sink.attach(file)
                continue
            if self._files_number is None:
                self._files_number = self._add(envelope.FILES_TOPIC, envelope.ROS_TYPE, True)
            data = self._serialize(envelope.wrap_file(file, self._store), envelope.ROS_TYPE)
            self._sink.write(self._files_number, t_ns, t_ns, data)

    def make_result(self) -> ConvertResult:
        return ConvertResult(
            messages_in=self._count_in,
            messages_out=self._count_out,
            topics=self._names,
            skipped=dict(self._skipped),
            reasons=self._reasons,
            notes=tuple(self._bag.notes),
            damage=tuple(damage.describe() for damage in self._bag.damage),
        )

    def _make_routes(self, topic: BagTopic) -> Iterator[_Route]:
        if not topic.is_ros:
            yield self._route_wrapped(topic)
        elif not self._bag.knows(topic):
            reason = f"no definition of {topic.ros_type} in the recording and none known here"
            yield self._route_nowhere(topic, reason)
        elif topic.ros_type == envelope.ROS_TYPE and self._sink.holds_anything:
            yield self._route_unwrapped(topic)
        else:
            yield self._route_fix(topic) or self._route_as_it_is(topic)
            yield from self._route_utm(topic)

    def _route_as_it_is(self, topic: BagTopic) -> _Route:
        name = name_in_ros2 if self._sink.is_ros2 else name_in_ros1
        ros_type = name(topic.ros_type)
        if ros_type not in self._store.fielddefs:
            parts = collect_definitions(self._bag.store().fielddefs, topic.ros_type)
            new = {part: text for part, text in parts.items() if part not in self._store.fielddefs}
            self._store.register(new)
        recode = make_transcoder(
            self._bag.store(), topic.ros_type, topic.encoding == "cdr",
            self._store, ros_type, self._sink.is_ros2,
        )  # fmt: skip
        number = self._add(topic.name, ros_type, topic.is_latched, topic.qos_yaml)
        can_hold = self._make_stamp_check(topic)

        def data(message: BagMessage) -> bytes | None:
            if can_hold is not None and not can_hold(message.data):
                self._skip(topic, UNHOLDABLE)
                return None
            return recode(message.data)

        return _Route(number, data)

    def _make_stamp_check(self, topic: BagTopic) -> Callable[[bytes], bool] | None:
        from_ros2 = topic.encoding == "cdr"
        if from_ros2 == self._sink.is_ros2:
            return None
        return make_stamp_check(self._bag.store().fielddefs, topic.ros_type, from_ros2)

    def _route_fix(self, topic: BagTopic) -> _Route | None:
        is_ros2, store = self._sink.is_ros2, self._store
        if self._options.fixes_as == "gpsfix" and topic.ros_type == fixes.NAVSATFIX:
            kind = fixes.gpsfix_type(is_ros2)
            return self._route_values(
                topic,
                topic.name,
                kind,
                lambda fix: fixes.gpsfix_from_navsatfix(fix, store, is_ros2),
            )
        if self._options.fixes_as == "navsatfix" and topic.ros_type in fixes.GPSFIXES:
            return self._route_values(
                topic,
                topic.name,
                fixes.NAVSATFIX,
                lambda fix: fixes.navsatfix_from_gpsfix(fix, store),
            )
        return None

    def _route_utm(self, topic: BagTopic) -> Iterator[_Route]:
        zone, store = self._options.zone, self._store
        if topic.name in self._options.utm_of:
            _require(topic, (fixes.NAVSATFIX, *fixes.GPSFIXES))
            yield self._route_values(
                topic, f"{topic.name}/utm", utm.ODOMETRY,
                lambda fix: utm.odometry_from_fix(fix, store, zone, append_zone=True),
            )  # fmt: skip
        if topic.name in self._options.fix_of:
            _require(topic, (utm.ODOMETRY,))
            yield self._route_values(
                topic, f"{topic.name}/fix", fixes.NAVSATFIX,
                lambda odometry: utm.fix_from_odometry(odometry, store, zone),
            )  # fmt: skip

    def _route_values(
        self, topic: BagTopic, name: str, ros_type: str, make: Callable[[Any], Any]
    ) -> _Route:
        number = self._add(name, ros_type, topic.is_latched, topic.qos_yaml)

        def data(message: BagMessage) -> bytes | None:
            made = make(self._bag.value(message))
            return None if made is None else self._serialize(made, ros_type)

        return _Route(number, data)

    def _route_wrapped(self, topic: BagTopic) -> _Route:
        if self._sink.holds_anything:
            self._names[topic.name] = topic.schema_name or topic.encoding
            return _Route(self._sink.add(topic), lambda message: message.data)
        if topic.definition:
            reason = f"{topic.encoding} messages of {topic.schema_name} fit only into an .mcap"
            return self._route_nowhere(topic, reason)
        label = envelope.Label(
            encoding=topic.encoding,
            schema_name=topic.schema_name,
            schema_encoding=topic.schema_encoding,
        )
        number = self._add(topic.name, envelope.ROS_TYPE, topic.is_latched)

        def data(message: BagMessage) -> bytes:
            wrapped = envelope.wrap(label, message.data, self._store)
            return self._serialize(wrapped, envelope.ROS_TYPE)

        return _Route(number, data)

    def _route_nowhere(self, topic: BagTopic, reason: str) -> _Route:
        def data(_: BagMessage) -> bytes | None:
            self._skip(topic, reason)
            return None

        return _Route(-1, data)

    def _route_unwrapped(self, topic: BagTopic) -> _Route:
        """Turn arrays that are envelopes into what they hold; others stay as they are."""
        plain: list[_Route] = []

        def data(message: BagMessage) -> bytes | None:
            found = envelope.unwrap(self._bag.value(message))
            if found is None:
                if not plain:
                    plain.append(self._route_as_it_is(topic))
                number, content = plain[0].number, plain[0].data(message) or b""
            else:
                label, content = found
                if label.file_name:
                    self._sink.attach(BagFile(label.file_name, label.media_type, content))
                    self._count_in -= 1  # it was no message before either
                    return None
                number = self._find_number(topic, label)
            self._sink.write(number, message.log_ns, message.publish_ns, content)
            self._count_out += 1
            return None

        return _Route(-1, data)

    def _find_number(self, topic: BagTopic, label: envelope.Label) -> int:
        key = (topic.name, label.schema_name)
        if key not in self._enveloped:
            opened = BagTopic(
                id=0, name=topic.name, ros_type="", encoding=label.encoding,
                schema_name=label.schema_name, schema_encoding=label.schema_encoding,
            )  # fmt: skip
            self._names[topic.name] = label.schema_name or label.encoding
            self._enveloped[key] = self._sink.add(opened)
        return self._enveloped[key]

    def _add(self, name: str, ros_type: str, is_latched: bool, qos: str = "") -> int:
        self._names[name] = ros_type
        added = BagTopic(
            id=0, name=name, ros_type=ros_type, encoding="cdr", is_latched=is_latched, qos_yaml=qos
        )
        return self._sink.add(added)

    def _serialize(self, message: Any, ros_type: str) -> bytes:
        return serialize(self._store, ros_type, self._sink.is_ros2, message)

    def _explain_time(self, log_ns: int) -> str:
        year, last = (1970 + t_ns / NS_A_YEAR for t_ns in (log_ns, self._sink.last_ns))
        return (
            f"recorded in the year {year:.0f}, and this format holds 1970 to {last:.0f}; check the "
            "clock of the recorder, or convert to an .mcap"
        )

    def _skip(self, topic: BagTopic, reason: str) -> None:
        self._skipped[topic.name] += 1
        self._reasons.setdefault(topic.name, reason)


def _require(topic: BagTopic, kinds: tuple[str, ...]) -> None:
    if topic.ros_type not in kinds:
        raise RecordingError(
            f"{topic.name} is {topic.ros_type or topic.encoding}; this needs {' or '.join(kinds)}"
        )
