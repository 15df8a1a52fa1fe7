"""The page beside a running session: starts the server's process, feeds it, obeys it."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from multiprocessing.connection import Connection
from typing import Any, Self

import msgspec

from agribot.app.calibration.robot_file import RobotFile
from agribot.app.calibration.wizard import Wizard
from agribot.app.run import Run
from agribot.autonomy.weeds.track import Track
from agribot.core.errors import ConfigError, MissionError, RecordingError
from agribot.core.facts import NoFrameSeen, NoTickYet, PausedByLoss
from agribot.core.messages import (
    AddNote,
    AskerKind,
    ByteArray,
    ChangeSetting,
    PauseFor,
    TickRecord,
    Who,
)
from agribot.core.messages import Path as PlannedPath
from agribot.core.plugins import PANELS, bind_settings, iterate_plugins
from agribot.core.refusal import find_fact
from agribot.record.events import Event
from agribot.ui import wire
from agribot.ui.about import About, RosPlaces
from agribot.ui.address import Address
from agribot.ui.ground import field_of
from agribot.ui.panels import Panels
from agribot.ui.robot_side.about_run import about_run
from agribot.ui.robot_side.feed import CameraFeed, Feed
from agribot.ui.robot_side.goal_preview import preview_goal
from agribot.ui.robot_side.plant_pictures import PlantPictures
from agribot.ui.robot_side.recent_frames import RecentFrames
from agribot.ui.robot_side.saved_frames import SavedFrames
from agribot.ui.robot_side.server_process import READY_TIMEOUT_S, ServerProcess, report
from agribot.ui.robot_side.verdicts import Verdicts
from agribot.ui.settings import show_changes
from agribot.ui.view import RunView

SERVER = Who("the page's server", AskerKind.PROGRAM)
SILENT_PAGE = Who("page, silent", AskerKind.PROGRAM)
SERVER_SILENT_S = (
    3.0  # silence of a server that hangs and does not report that its operator is lost
)


class OperatorPage:
    """Use it as a context around `session.ticks()`; add it to the taps by entering it.

    `pace_limit` is 1 while somebody drives by hand, else infinite: a simulation that runs ahead
    of the clock cannot be driven.
    Raises: ConfigError: the address cannot be used, or the packages of the page are missing.
    """

    def __init__(
        self,
        session: Run,
        address: Address | None = None,
        panels: Panels | None = None,
        ros: RosPlaces | None = None,
    ) -> None:
        self._session = session
        self._inbox = session.inbox
        self._timeout_s = session.config.safety.hand_timeout_s
        self._pauses_when_lost = session.config.safety.on_operator_lost == "pause"
        self._panels = panels or Panels()
        for name, add_panels in iterate_plugins(PANELS):
            settings = bind_settings(add_panels, session.config.plugins, name)
            add_panels(self._panels, session, **settings)
        self._ros = ros or RosPlaces()
        self._verdicts = Verdicts(self._inbox)
        self.address = address or Address()
        self.server = ServerProcess(self.address, self._about, self._server_lost)
        self._lock = threading.Lock()
        self._view = RunView(session.config, session.robot.implement)
        file = RobotFile(self.address.home, session.config.robot)
        self._wizard = Wizard(self._inbox, session.robot, session.config, file)
        self._source = SessionSource(session, self._wizard)
        self._feed: Feed | None = None  # those of the server of the moment
        self._camera: CameraFeed | None = None
        self._changed: dict[str, float] = {}  # settings, under way
        self._frames = RecentFrames()
        reach_m = session.config.weeds.merge_radius_m
        self._plants = PlantPictures(session.robot, self._frames, reach_m)
        self._saved_frames = SavedFrames(session.config, session.out_dir)
        self._ready = threading.Event()
        self._hand_wall_s = -math.inf
        self._is_hand_moving = False
        self._is_server_silent = False

    @property
    def url(self) -> str:
        return self.server.url

    def __enter__(self) -> Self:
        self.server.start()
        self.server.listen(self._hear, self._look, self._timeout_s / 3.0)
        if not self._ready.wait(READY_TIMEOUT_S):
            self.close()
            raise ConfigError(
                f"the page's server did not start within {READY_TIMEOUT_S:g} s; "
                "run without --ui, or look at the messages above"
            )
        self._session.unattended.is_attended = True
        self._session.add_tap(self)
        self._session.add_mask_tap(self._mask)
        self._session.add_mask_tap(self._frames.mask)
        self._plants.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, record: TickRecord) -> None:
        self._wizard(record)
        feed, camera = self._feed, self._camera
        if feed is not None:
            feed(record)
        if camera is not None:
            camera(record)
        self._frames(record)
        self._plants(record)
        self._verdicts(record)

    @property
    def pace_limit(self) -> float:
        is_driving = time.monotonic() - self._hand_wall_s < 2.0 * self._timeout_s
        return 1.0 if is_driving else math.inf

    def close(self) -> None:
        """Send `End` to the pages and end the server. Safe to call twice."""
        self._plants.close()
        takes_nothing = not self._close_feeds()  # any more, not even a goodbye
        self.server.close(at_once=takes_nothing)

    def _start_feeds(self) -> None:
        """Start the feeds of a server that is ready: everything from the beginning."""
        link = self.server.link
        self._feed = Feed(self._view, self._source, lambda data: self._send(link, data))
        self._camera = CameraFeed(self.server.camera_link)
        self._feed.start()
        self._camera.start()

    def _close_feeds(self) -> bool:
        """Close the feeds; False when the server does not take what is left."""
        feeds = [feed for feed in (self._feed, self._camera) if feed is not None]
        return all([feed.close() for feed in feeds])

    def _mask(self, frame_index: int, class_id: ByteArray) -> None:
        if self._camera is not None:
            self._camera.mask(frame_index, class_id)

    def _send(self, link: Connection, data: bytes) -> None:
        with self._lock:
            link.send_bytes(data)

    def _hear(self, data: bytes) -> None:
        self._obey(wire.read_robot_order(data))

    def _look(self) -> None:
        """Let go for a hand that fell silent, by wall clock: a simulation may be slow."""
        is_old = time.monotonic() - self._hand_wall_s > self._timeout_s
        if self._is_hand_moving and is_old:
            self._hand(0.0, 0.0, SILENT_PAGE)
        is_silent = self.server.silent_s > SERVER_SILENT_S
        if is_silent and not self._is_server_silent:
            self._operator_lost(SERVER)
        self._is_server_silent = is_silent

    def _server_lost(self, reason: str) -> None:
        """Take the end of the line for the loss of all operators, until one takes the seat."""
        if not self._is_server_silent:
            self._operator_lost(SERVER)
        self._note(f"{reason}; it is started again")
        self._close_feeds()

    def _note(self, text: str) -> None:
        self._inbox.post(AddNote(text=text), SERVER)

    def _obey(self, order: wire.RobotOrder) -> None:
        if isinstance(order, wire.DriveOrder):
            self._hand(order.v_mps, order.yaw_rate_radps, order.who)
        elif isinstance(order, wire.RequestOrder):
            self._note_change(order)
            self._inbox.post(order.request, order.who)
        elif isinstance(order, wire.WatchOrder):
            if self._camera is not None:
                self._camera.is_watched = order.camera
                self._camera.is_mask_watched = order.mask
        elif isinstance(order, wire.OperatorLost):
            self._operator_lost(order.who)
        elif isinstance(order, wire.Ask):
            asked = (order, self.server.link)
            threading.Thread(target=self._answer, args=asked, daemon=True).start()
        elif isinstance(order, wire.Ready):
            self._start_feeds()
            if self._ready.is_set():
                report(f"page: served again at {self.url}")
                self._note("serves again")
            self._ready.set()

    def _note_change(self, order: wire.RequestOrder) -> None:
        if isinstance(order.request, ChangeSetting):
            self._changed[order.request.setting] = order.request.value

    def _hand(self, v_mps: float, yaw_rate_radps: float, who: Who) -> None:
        self._wizard.interrupt(f"{who.name} took the robot")
        self._inbox.drive(v_mps, yaw_rate_radps, who)
        self._is_hand_moving = bool(v_mps or yaw_rate_radps)
        if self._is_hand_moving:
            self._hand_wall_s = time.monotonic()

    def _operator_lost(self, who: Who) -> None:
        self._wizard.interrupt(f"{who.name} is not heard any more")
        self._hand(0.0, 0.0, who)
        if self._pauses_when_lost:
            self._inbox.post(PauseFor(cause=PausedByLoss(who.name)), who)
        self._inbox.post(AddNote(text="operator lost"), who)

    def _answer(self, asked: wire.Ask, link: Connection) -> None:
        """Answer what the server asks of mission and panels; their errors become answers."""
        try:
            data = wire.encode(self._find_answer(asked.id, asked.question))
        except Exception as error:  # noqa: BLE001  (somebody else's code; its page shows the text)
            text = f"{type(error).__name__}: {error}"
            data = wire.encode(wire.Answer(id=asked.id, error=text))
        with contextlib.suppress(OSError):
            self._send(link, data)

    def _find_answer(self, id: int, question: wire.Question) -> wire.Answer:
        if isinstance(question, wire.RequestOrder):
            self._note_change(question)
            return wire.Answer(id=id, refusal=self._verdicts.ask(question.request, question.who))
        if isinstance(question, wire.Calibrate):
            wanted = {"do": question.action, "kind": question.name, "by": question.by}
            found = self._wizard.answer(wanted)
            return wire.Answer(id=id, value=found, refusal=found.pop("refusal"))
        try:
            if isinstance(question, wire.PreviewGoal):
                return wire.Answer(id=id, value=self._preview_goal(question.goal))
            if isinstance(question, wire.SaveFrame):
                return wire.Answer(id=id, value=self._save_frame())
        except (MissionError, RecordingError) as error:
            return wire.Answer(id=id, refusal=find_fact(error))
        return wire.Answer(id=id, value=self._find(question))

    def _find(self, question: wire.Question) -> Any:
        if isinstance(question, wire.FindPlantPicture):
            picture = self._plants.near(question.x_map_m, question.y_map_m)
            if picture is None:
                return wire.PlantPictureFile()
            return wire.PlantPictureFile(jpeg=picture.jpeg, t_s=picture.t_s)
        if isinstance(question, wire.ReadPanel):
            return self._panels.read(question.panel)
        if isinstance(question, wire.SubmitPanel):
            return self._panels.submit(question.panel, question.values)
        return self._panels.infos()

    def _preview_goal(self, goal: wire.GoTo) -> wire.GoalPreview:
        record = self._view.record
        if record is None:
            raise MissionError(NoTickYet())
        mission = self._session.stack.mission
        config = msgspec.structs.replace(self._session.config.mission, speed_mps=mission.speed_mps)
        return preview_goal(mission.task, record.estimate, config, goal)

    def _save_frame(self) -> wire.KeptFrame:
        shot = self._frames.newest()
        if shot is None:
            raise MissionError(NoFrameSeen())
        return self._saved_frames.save(shot)

    def _about(self, port: int) -> About:
        run = self._session
        area = run.task.work.area if run.task.work else None
        field = field_of(run.config, run.rows, run.goals_map_m, area)
        about = about_run(self.address, port, run.config, run.robot, run.urdf, field, run.out_dir)
        show_changes(about.settings, self._changed)
        return msgspec.structs.replace(about, ros=self._ros)


class SessionSource:
    """The parts of a session that the feed looks at from its own thread."""

    def __init__(self, session: Run, wizard: Wizard) -> None:
        self._session, self._wizard = session, wizard

    def path(self) -> PlannedPath | None:
        return self._session.stack.mission.path

    def weeds(self) -> list[Track]:
        return self._session.weed_map.list_mapped()

    def events_since(self, index: int) -> list[Event]:
        return self._session.event_log.list_since(index)

    def recording(self) -> str:
        return self._session.recording.name

    def calibration(self) -> wire.CalibrationProgress | None:
        return msgspec.convert(self._wizard.describe_progress(), wire.CalibrationProgress | None)
