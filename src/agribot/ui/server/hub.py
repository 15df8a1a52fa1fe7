"""What all connections of the server share: channels, seat, access, the robot's line."""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict, deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, NoAnswer, RobotEnded, Said, StoppedAgainBy
from agribot.core.messages import (
    AddNote,
    AnyRequest,
    AskerKind,
    DrawShape,
    PointOut,
    PressStop,
    StopFor,
    Who,
)
from agribot.ros.display_requests import DisplayRequest
from agribot.ros.messages.shown_types import SHOWN_DISPLAYS
from agribot.ui import wire
from agribot.ui.about import About
from agribot.ui.server.access import Access, Role
from agribot.ui.server.channel import Channel
from agribot.ui.server.mapviz_layers import make_layer
from agribot.ui.server.outside_layers import BadLayer, OutsideLayers
from agribot.ui.server.replay import Replay
from agribot.ui.server.replays import MAX_REPLAYS, Replays
from agribot.ui.server.seat import Seat
from agribot.ui.server.stops import Stops
from agribot.ui.server.topic_sources import TITLES, TopicSources

T = TypeVar("T")
NoteKind = Literal["operator", "viewer", "refusal"]
ToRobot = Callable[[wire.RobotOrder], None]
NOTES_PER_MINUTE = 60  # notes of each kind
SEAT_DELAY_S = 0.05
ANSWER_S = 10.0  # time for an answer of the robot's program
GAVE_WAY = (
    f"your recording gave way to that of another browser, {MAX_REPLAYS} can be shown at a time; "
    "this page shows the robot again"
)


class NotWanted(Exception):
    """The robot's program does not do what was asked of it, for a fact."""

    def __init__(self, fact: AnyFact) -> None:
        super().__init__(render(fact))
        self.fact = fact


class Hub:
    def __init__(self, about: About, to_robot: ToRobot) -> None:
        self.about = about
        self.live = Channel(about.source, epoch=about.run_id)
        self.seat = Seat()
        self.is_robot_gone = False
        self.counts: deque[wire.TickCounts] = deque(maxlen=8)
        self.sockets: set[Any] = set()
        self.replays = Replays()
        self.layers = OutsideLayers(SHOWN_DISPLAYS.__contains__)
        self.topics: TopicSources | None = None  # topics from the first request for them on
        self.choices: dict[str, object] = {}  # the last of each browser that waits for it
        self.refusals = 0
        self.visits = 0
        self._asked = 0
        self._answers: dict[int, asyncio.Future[wire.Answer]] = {}
        self.started_s = time.monotonic()
        is_local = about.host in {"127.0.0.1", "localhost", "::1"}
        self.access = Access(
            about.names, about.port, about.operator_token, about.viewer_token, about.session_key,
            is_local=is_local, is_encrypted=bool(about.tls_cert),
        )  # fmt: skip
        self._to_robot = to_robot
        self.stops = Stops(self._stop)
        self._seat_timer: asyncio.TimerHandle | None = None
        self._noted_s: defaultdict[NoteKind, deque[float]] = defaultdict(
            lambda: deque(maxlen=NOTES_PER_MINUTE)
        )

    @property
    def has_robot(self) -> bool:
        """Whether a robot is served, not a recording or a description alone."""
        return self.live.source not in ("replay", "description")

    def channel_of(self, session: str) -> Channel:
        """Find the stream that a page looks at: live, unless its browser replays a recording."""
        return self.replays.find(_browser_of(session)) or self.live

    def start_replay(self, browser: str, replay: Replay, role: Role | None) -> None:
        """Show a recording to one browser; a browser that loses its place for it gets a message.

        Raises: NoRoom: see `Replays.start`.
        """
        victim = self.replays.start(browser, replay, role)
        self._follow()
        for socket in self.sockets:
            if victim is not None and _browser_of(socket.session) == victim:
                socket.send(wire.Verdict(id="", ok=False, reason=GAVE_WAY))

    def end_replay(self, browser: str) -> None:
        self.replays.end(browser)
        self._follow()

    def cut_gone_pages(self, now_s: float) -> None:
        for socket in self.sockets:
            socket.cut_if_gone(now_s)

    def publish_live(self) -> None:
        """Send what the robot itself does to the pages that show a recording."""
        watching = [socket for socket in self.sockets if socket.channel is not self.live]
        state = self.live.state if watching and self.has_robot else None
        if state is not None:
            for socket in watching:
                socket.send(
                    wire.LiveState(mode=state.mode, stop=state.stop, stop_fact=state.stop_fact)
                )

    def _follow(self) -> None:
        for socket in self.sockets:
            channel = self.channel_of(socket.session)
            if channel is not socket.channel:
                socket.follow(channel)

    def announce_seat(self) -> None:
        """Announce the seat soon, once for all changes: a flood would push out answers."""
        if self._seat_timer is None:
            loop = asyncio.get_running_loop()
            self._seat_timer = loop.call_later(SEAT_DELAY_S, self._announce_seat)

    def _announce_seat(self) -> None:
        self._seat_timer = None
        for socket in self.sockets:
            socket.send_seat()

    @property
    def home(self) -> Path:
        return Path(self.about.home_dir)

    def order(self, message: wire.RobotOrder) -> None:
        """Send a request to the robot; one that is gone hears nothing."""
        if not self.is_robot_gone:
            self._to_robot(message)

    async def ask(self, question: wire.Question, type: type[T], timeout_s: float = ANSWER_S) -> T:
        """Let the robot's program work something out.

        Raises: TimeoutError: it did not answer. LookupError: it could not, the text says why.
            NotWanted: it does not want to.
        """
        answer = await self._ask(question, timeout_s)
        if answer.refusal:
            raise NotWanted(answer.refusal)
        return msgspec.convert(answer.value, type)

    async def _ask(self, question: wire.Question, timeout_s: float) -> wire.Answer:
        if self.is_robot_gone:
            raise LookupError(render(RobotEnded()))
        self._asked += 1
        id = self._asked
        waiting: asyncio.Future[wire.Answer] = asyncio.get_running_loop().create_future()
        self._answers[id] = waiting
        try:
            self.order(wire.Ask(id=id, question=question))
            answer = await asyncio.wait_for(waiting, timeout_s)
        finally:
            del self._answers[id]
        if answer.error:
            raise LookupError(answer.error)
        return answer

    def hear_answer(self, answer: wire.Answer) -> None:
        waiting = self._answers.get(answer.id)
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)

    def send(self, request: AnyRequest, who: Who) -> None:
        """Send a request without waiting for its answer."""
        self.order(_make_order(request, who))

    def _stop(self, who: Who, times: int) -> None:
        self.send(
            PressStop() if times == 1 else StopFor(cause=StoppedAgainBy(who.name, times)), who
        )

    async def request(self, request: AnyRequest, who: Who) -> AnyFact | None:
        """Ask for what the mission may refuse: why it does, or None where it was taken."""
        try:
            return (await self._ask(_make_order(request, who), ANSWER_S)).refusal
        except TimeoutError:
            return NoAnswer(ANSWER_S)
        except LookupError as error:
            return self.explain(error)

    def explain(self, error: LookupError) -> AnyFact:
        """Explain why the robot's program could not work something out."""
        return RobotEnded() if self.is_robot_gone else Said(str(error))

    def find_topics(self) -> TopicSources:
        """Find the sources of topics, which are made when somebody asks first."""
        if self.topics is None:
            self.topics = TopicSources(self.about)
        return self.topics

    def take_layer(self, network: str, text: str) -> None:
        """Do what a program of ROS asks for; the recording keeps what became of it."""
        who = Who(TITLES[network], AskerKind.ROS)
        try:
            self.note(who, self.layers.obey(text))
        except BadLayer as error:
            self.note(who, f"layer refused: {error}", "refusal")

    def take_display(self, network: str, request: DisplayRequest) -> tuple[bool, str]:
        """Add a display as mapviz does; return whether it is there, and what became of it."""
        who = Who(TITLES[network], AskerKind.ROS)
        try:
            layer, odd = make_layer(network, request, self.layers.find_order(request.name))
            self.layers.set(layer)
        except BadLayer as error:
            self.note(who, f"display refused: {error}", "refusal")
            return False, str(error)
        text = f"display '{layer.name}' set{odd}"
        self.note(who, text)
        return True, text

    def send_to_all(self, message: wire.ServerMessage) -> None:
        for socket in self.sockets:
            socket.send(message)

    def note(self, who: Who, text: str, kind: NoteKind = "operator") -> None:
        """Put who did what into the recording; a flood of one kind is cut, and no other kind."""
        if self._has_room(kind):
            self.send(AddNote(text=text), who)

    def draw(self, drawn: PointOut | DrawShape, who: Who) -> None:
        """Publish what an operator showed on the map; a flood is cut like that of notes."""
        if self._has_room("operator"):
            self.send(drawn, who)

    def _has_room(self, kind: NoteKind) -> bool:
        now_s, noted_s = time.monotonic(), self._noted_s[kind]
        if len(noted_s) == NOTES_PER_MINUTE and now_s - noted_s[0] < 60.0:
            return False
        noted_s.append(now_s)
        return True

    def refuse(self, who: Who, reason: str) -> None:
        """Somebody was turned away at the door."""
        self.refusals += 1
        self.note(who, f"refused: {reason}", "refusal")


def _make_order(request: AnyRequest, who: Who) -> wire.RequestOrder:
    """Leave the page's own id out: the robot's ids are those of its program."""
    return wire.RequestOrder(who=who, request=msgspec.structs.replace(request, id=""))


def _browser_of(session: str) -> str:
    return session.partition("/")[0]
