from __future__ import annotations

import asyncio
import contextlib
import io
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from PIL import Image

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.geo import MapFrame
from agribot.core.messages import ByteArray
from agribot.record.recorder import RunRecorder
from agribot.ui import wire
from agribot.ui.robot_side.feed import pack_pixels
from agribot.ui.server import guarded_connections
from agribot.ui.server import serve as server
from agribot.ui.server.camera import (
    LADDER,
    QUICK_TIMES,
    Camera,
    Picture,
    SizeLadder,
    encode,
    unpack_pixels,
)
from agribot.ui.server.channel import Channel
from agribot.ui.server.client import STATES_KEPT, Client
from agribot.ui.server.hub import Hub
from agribot.ui.server.pictures import Pictures
from agribot.ui.server.replay import Replay
from agribot.ui.server.window import LEAST_BYTES, MOST_BYTES, Window
from tests.record import record_samples as samples
from tests.ui.client import Browser, Page
from tests.ui.conftest import Robot
from tests.ui.messages import make_state, make_weed
from tests.waiting import PATIENCE_S


def follow(channel: Channel, window: Window | None = None) -> Client:
    client = Client(channel, window)
    channel.clients.add(client)
    return client


def take(client: Client) -> wire.ServerMessage:
    """What is sent next; fails where nothing may be."""
    text = client.take()
    assert text is not None
    return wire.read_server_message(text)


def take_all(client: Client) -> list[wire.ServerMessage]:
    return [wire.read_server_message(text) for text in iter(client.take, None)]


def grow(channel: Channel, points: int) -> None:
    for number in range(points):
        first = len(channel.trace_map_m)
        channel.publish_growth(wire.TracePiece(first=first, points_map_m=[(number, 0.0)]))


def put_together(
    messages: list[wire.ServerMessage],
) -> tuple[list[wire.Vec2], dict[int, wire.Weed]]:
    """The trace and the weeds as a page has them after these messages."""
    trace: list[wire.Vec2] = []
    weeds: dict[int, wire.Weed] = {}
    for message in messages:
        piece, changes = message, message
        if isinstance(message, wire.Snapshot):
            trace, weeds = [], {}
            piece, changes = message.trace, message.weeds
        if isinstance(piece, wire.TracePiece):
            assert piece.first == len(trace)
            trace += piece.points_map_m
        if isinstance(changes, wire.WeedChanges):
            weeds.update((weed.id, weed) for weed in changes.set)
            for id in changes.gone:
                weeds.pop(id, None)
    return trace, weeds


def size_bytes(message: wire.ServerMessage) -> int:
    return len(wire.encode(message))


def test_a_slow_page_loses_its_oldest_states_and_no_change() -> None:
    channel = Channel("sim")
    client = follow(channel)
    for number in range(100):
        channel.publish_state(make_state(number))
    grow(channel, 3)
    got = take_all(client)
    assert isinstance(got[0], wire.Snapshot)
    told = [message.tick for message in got if isinstance(message, wire.State)]
    assert told == list(range(100 - STATES_KEPT, 100))
    assert put_together(got)[0] == [(0, 0), (1, 0), (2, 0)]
    assert client.dropped == 100 - STATES_KEPT


def test_a_page_that_is_far_behind_gets_all_in_pieces_with_states_between_them() -> None:
    channel = Channel("sim")
    grow(channel, 1500)
    channel.publish_growth(wire.WeedChanges(set=[make_weed(id) for id in range(300)]))
    client = follow(channel)
    got = []
    for number in range(100):
        channel.publish_state(make_state(number))
        got += [take(client), take(client)]
        if number == 2:
            channel.publish_growth(wire.WeedChanges(gone=[7, 299]))
        if put_together(got)[0] == channel.trace_map_m and len(put_together(got)[1]) == 298:
            break
    assert [isinstance(m, wire.State) for m in got] == [False, True] * (len(got) // 2)
    trace, weeds = put_together(got)
    assert trace == channel.trace_map_m
    assert weeds == channel.weeds
    assert max(map(size_bytes, got)) < 10_000


def test_a_page_that_acknowledges_nothing_has_little_on_its_way_and_then_the_newest() -> None:
    channel, window = Channel("sim"), Window(is_acknowledged=True)
    client, sent = follow(channel, window), []

    def send_what_may_be_sent(now_s: float) -> None:
        while (text := client.take()) is not None:
            sent.append(wire.read_server_message(text))
            window.note_sent(len(text), now_s)

    for number in range(1000):
        channel.publish_state(make_state(number))
        send_what_may_be_sent(number / 30.0)
    assert sum(map(size_bytes, sent)) < LEAST_BYTES + 1000
    assert window.waiting_s(40.0) == pytest.approx(40.0)
    pong = wire.Pong(sent_ms=1.0, mono_ms=2.0, wall_ms=3.0)
    client.send(pong)
    assert take(client) == pong, "an answer does not wait"
    window.note_received(len(sent), 40.0)
    newest = take(client)
    assert isinstance(newest, wire.State)
    assert newest.tick >= 1000 - STATES_KEPT
    assert window.waiting_s(40.0) == 0.0


def test_the_window_opens_on_a_quick_line_and_closes_on_a_slow_one() -> None:
    window = Window(is_acknowledged=True)
    count, now_s = 0, 0.0

    def fill_and_receive_after(delay_s: float) -> None:
        nonlocal count, now_s
        while window.has_room:
            window.note_sent(1000, now_s)
            count += 1
        now_s += delay_s
        window.note_received(count, now_s)

    for _ in range(20):
        fill_and_receive_after(0.01)
    assert window.size_bytes == MOST_BYTES
    for _ in range(20):
        fill_and_receive_after(1.0)
    assert window.size_bytes == LEAST_BYTES
    window.note_received(10**9, now_s)  # a page that claims more than it was sent gains nothing
    assert window.has_room and window.waiting_s(now_s + 9.0) == 0.0


def test_who_is_shown_another_channel_gets_nothing_of_the_first_any_more() -> None:
    live, recorded = Channel("sim"), Channel("replay", "short")
    grow(live, 3)
    grow(recorded, 5)
    client = follow(live)

    async def switch_while_it_waits() -> wire.ServerMessage:
        """The sender is in the middle of its wait when the channel changes, as it mostly is."""
        while True:
            waiting = asyncio.create_task(client.next())
            await asyncio.sleep(0)
            if not waiting.done():
                break
        live.publish_state(make_state(1))
        live.clients.discard(client)
        recorded.clients.add(client)
        client.follow(recorded)
        return wire.read_server_message(await waiting)

    first = asyncio.run(switch_while_it_waits())
    assert isinstance(first, wire.Snapshot)
    assert (first.source, first.name) == ("replay", "short")
    assert first.trace.points_map_m == recorded.trace_map_m
    recorded.publish_state(make_state(2))
    state = take(client)
    assert isinstance(state, wire.State)
    assert first.epoch == state.epoch == recorded.epoch
    assert recorded.epoch != live.epoch


def test_a_recording_has_another_epoch_in_every_process_and_at_every_place() -> None:
    make = "from agribot.ui.server.channel import Channel; print(Channel('replay', 'short').epoch)"
    told = [subprocess.check_output([sys.executable, "-c", make], text=True) for _ in range(2)]
    channel = Channel("replay", "short")
    epochs = {*map(int, told), channel.epoch}
    channel.restart()
    assert len(epochs | {channel.epoch}) == 4


def test_a_page_that_comes_late_has_the_whole_trace_and_all_weeds(robot: Robot) -> None:
    robot.say(wire.TracePiece(first=0, points_map_m=[(0.0, 0.0), (0.1, 0.0)]))
    robot.say(wire.TracePiece(first=2, points_map_m=[(0.2, 0.0)]))
    robot.say(wire.WeedChanges(set=[make_weed(7), make_weed(8)]))
    robot.say(wire.WeedChanges(set=[make_weed(7, x_map_m=1.5)], gone=[8]))
    with Page(robot.port, tab="early") as early:
        weeds, got = {7: make_weed(7, x_map_m=1.5)}, [early.receive_any()]
        while put_together(got)[1] != weeds:  # what the robot said may still be on its way
            got.append(early.receive_any())
    with Page(robot.port, tab="late") as page:
        snapshot = page.receive(wire.Snapshot)
    assert snapshot.trace.points_map_m == [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0)]
    assert snapshot.weeds.set == [make_weed(7, x_map_m=1.5)]


def serve_patiently(*line: Any) -> None:
    """The server as a process of its own, for a test that may be slow."""
    guarded_connections.STUCK_S = PATIENCE_S
    server.main(*line)


@pytest.fixture
def patient_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    with monkeypatch.context() as patch:
        patch.setattr(server, "main", serve_patiently)
        robot = Robot(tmp_path)
        robot.start()
    yield robot
    robot.server.close()


def test_a_stalled_page_does_not_hold_up_another(patient_robot: Robot) -> None:
    robot = patient_robot
    with (
        Page(robot.port) as page,
        Page(robot.port, tab="stalled", max_queue=1) as stalled,
    ):
        stalled.receive(wire.Hello)
        padding = "x" * 20_000
        for number in range(600):
            robot.say(msgspec.structs.replace(make_state(number), reason=padding))
        while (number := page.receive(wire.State).tick) != 599:
            if number % 100 == 0:
                stalled.send(wire.Ping(sent_ms=number))  # it takes nothing, but it is there
        seen = [stalled.receive(wire.State).tick]
        while seen[-1] != 599:
            seen.append(stalled.receive(wire.State).tick)
        assert len(seen) < 500, "what was old is left out"


def picture(index: int = 3) -> tuple[ByteArray, ByteArray]:
    rng = np.random.default_rng(index)
    image = np.kron(rng.integers(0, 255, (30, 40, 3), dtype=np.uint8), np.ones((16, 16, 1)))
    mask = np.kron(rng.integers(0, 3, (30, 40), dtype=np.uint8), np.ones((16, 16)))
    return image.astype(np.uint8), mask.astype(np.uint8)


def test_pictures_cross_the_line_unchanged() -> None:
    for kind, pixels in enumerate(picture()):
        there = unpack_pixels(pack_pixels(kind, 7, 1.7e12 + 0.5, pixels))
        assert (there.kind, there.index, there.wall_ms) == (kind, 7, 1.7e12 + 0.5)
        assert np.array_equal(there.pixels, pixels)


def test_a_mask_keeps_its_classes_at_half_the_size() -> None:
    _, mask = picture()
    data = encode(Picture(kind=1, index=1, wall_ms=0.0, pixels=mask), 0)
    shown = Image.open(io.BytesIO(data[16:]))
    assert shown.mode == "P"
    assert np.array_equal(np.asarray(shown), mask[::2, ::2])


def test_each_step_of_the_ladder_is_smaller() -> None:
    noise = np.random.default_rng(1).integers(0, 40, (480, 640, 3))
    image = (noise + np.linspace(0, 200, 640)[None, :, None]).astype(np.uint8)
    there = Picture(kind=0, index=1, wall_ms=0.0, pixels=image)
    sizes = [len(encode(there, level)) for level in range(len(LADDER))]
    assert sizes == sorted(sizes, reverse=True)
    ladder = SizeLadder()
    for _ in range(10):
        ladder.note_drawing(0.3)
    assert ladder.level == len(LADDER) - 1
    for _ in range(QUICK_TIMES + 1):
        ladder.note_drawing(0.05)
    assert ladder.level == len(LADDER) - 2


def test_the_camera_runs_only_while_somebody_looks_and_waits_for_credits(robot: Robot) -> None:
    image, mask = picture()
    with Page(robot.port, path="/ws/cam/main?mask=1") as viewer:
        robot.wait_for(wire.WatchOrder, lambda order: order.camera and order.mask)

        def send(index: int) -> None:
            robot.server.camera_link.send_bytes(pack_pixels(1, index, 5.0, mask))
            robot.server.camera_link.send_bytes(pack_pixels(0, index, 5.0, image))

        def kind_and_index(timeout_s: float = PATIENCE_S) -> tuple[int, int]:
            data = viewer.line.recv(timeout=timeout_s)
            assert isinstance(data, bytes)
            kind, _, _, index, _ = struct.unpack(">BBHId", data[:16])
            return kind, index

        for index in (1, 2):  # two credits, two pictures
            send(index)
            assert [kind_and_index(), kind_and_index()] == [(0, index), (1, index)]
        send(3)
        with pytest.raises(TimeoutError):
            kind_and_index(timeout_s=0.5)
        viewer.line.send("a")
        assert kind_and_index() == (0, 3)
    robot.wait_for(wire.WatchOrder, lambda order: not order.camera)


def test_a_picture_is_encoded_once_for_all_who_want_it(monkeypatch: pytest.MonkeyPatch) -> None:
    image, _ = picture()
    there, calls = Picture(kind=0, index=1, wall_ms=0.0, pixels=image), []

    def counted(picture: Picture, level: int) -> bytes:
        calls.append(level)
        return encode(picture, level)

    async def many() -> list[bytes]:
        camera = Camera(cast(Hub, None))
        wanted = [camera.encode(there, level) for level in (0, 0, 0, 2, 2)]
        return await asyncio.gather(*wanted)

    monkeypatch.setattr("agribot.ui.server.camera.encode", counted)
    data = asyncio.run(many())
    assert sorted(calls) == [0, 2]
    assert data[0] == data[1] == data[2] != data[3] == data[4]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = config.load("farm", ["perception.enabled=false", "seed=1", "duration_s=8"])
    out = tmp_path_factory.mktemp("runs") / "short"
    with simulate(settings, out) as session:
        for _ in session.ticks():
            pass
        session.finish()
    return out / "run.mcap"


def put_run(robot: Robot, name: str, recording: Path) -> None:
    """Keep a recording among the runs of a robot."""
    folder = robot.home / "runs" / name
    folder.mkdir(parents=True)
    shutil.copyfile(recording, folder / "run.mcap")


def newest_of(replay: Replay) -> wire.State:
    assert replay.state is not None
    return replay.state


def test_a_replay_shows_the_same_places_and_goes_back_and_forth(recording: Path) -> None:
    replay = Replay.load(recording, "short")
    wall_s = 100.0
    for _ in range(60):
        replay.step(wall_s)
        wall_s += 0.1
    assert newest_of(replay).t_s == pytest.approx(5.9, abs=0.1)
    assert newest_of(replay).mode == "replay"
    trace = list(replay.trace_map_m)
    assert len(trace) > 10
    replay.seek(4.0)
    assert newest_of(replay).t_s == pytest.approx(4.0, abs=0.05)
    assert trace[: len(replay.trace_map_m)] == replay.trace_map_m
    assert len(replay.trace_map_m) < len(trace)
    replay.speed = 10.0
    for _ in range(20):
        replay.step(wall_s)
        wall_s += 0.1
    assert replay.progress.t_s == replay.progress.end_s
    assert trace == replay.trace_map_m[: len(trace)]


def test_a_page_sees_the_recording_and_then_the_robot_again_and_never_one_in_the_other(
    robot: Robot, recording: Path
) -> None:
    put_run(robot, "swap", recording)
    robot.say(wire.TracePiece(first=0, points_map_m=[(100.0, 100.0), (101.0, 100.0)]))
    robot.say(wire.WeedChanges(set=[make_weed(7001, 100.0, 101.0)]))
    browser = Browser(robot.port)
    with Page(robot.port, tab="swap", additional_headers={"Cookie": browser.cookie}) as page:
        epoch = page.receive(wire.Snapshot).epoch
        robot.say(make_state(1))
        page.receive(wire.State)  # the server has taken in all that was said before
        for name in ("swap", None, "swap", None):
            request = {"name": name, "speed": 0, "t_s": 6.0}
            assert browser.ask("POST", "/api/v1/replay", request)[0] == 200
            robot.say(make_state(2))
            while (snapshot := page.receive(wire.Snapshot)).name != (name or ""):
                pass
            is_live = name is None
            assert (snapshot.source == "replay") is not is_live
            assert ((100.0, 100.0) in snapshot.trace.points_map_m) is is_live
            assert (7001 in [weed.id for weed in snapshot.weeds.set]) is is_live
            assert (snapshot.epoch == epoch) is is_live
            while (shown := page.receive(wire.State)).epoch != snapshot.epoch:
                pass
            assert (shown.replay is not None) is not is_live
    assert browser.ask("GET", "/api/v1/field?recording=swap")[0] == 404


def test_the_field_in_a_replay_is_that_of_the_recording(robot: Robot, tmp_path: Path) -> None:
    settings = config.load("rows-10x12", ["perception.enabled=false", "duration_s=0.5"])
    run = robot.home / "runs" / "other"
    with simulate(settings, run) as session:
        for _ in session.ticks():
            pass
        session.finish()
    browser = Browser(robot.port)
    assert browser.ask("POST", "/api/v1/replay", {"name": "other", "speed": 0})[0] == 200
    status, recorded = browser.ask("GET", "/api/v1/field?recording=other")
    assert status == 200
    assert len(recorded["rows"]) == 10
    assert len(browser.ask("GET", "/api/v1/field")[1]["rows"]) == 6
    assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200


def test_weeds_of_a_recording_are_saved_where_they_grew(robot: Robot) -> None:
    settings = config.load("farm", ["field.datum.lat_deg=48.125", "field.datum.lon_deg=11.5"])
    run = robot.home / "runs" / "north"
    run.mkdir(parents=True)
    recorder = RunRecorder(
        run / "run.mcap", settings, samples.robot(), samples.URDF,
        weed_map=lambda: [samples.plant(0), samples.plant(1)],
    )  # fmt: skip
    for record in samples.ticks(150):
        recorder(record)
    recorder.close()
    browser = Browser(robot.port)
    replayed = {"name": "north", "speed": 0, "t_s": 100.0}
    assert browser.ask("POST", "/api/v1/replay", replayed)[0] == 200
    frame = MapFrame(settings.field.datum)
    features = browser.ask("GET", "/api/v1/weeds.geojson")[1]["features"]
    rows = browser.ask("GET", "/api/v1/weeds.csv")[1].decode().splitlines()
    assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200
    assert features and len(rows) == len(features) + 1
    for feature, row in zip(features, rows[1:], strict=True):
        lon_deg, lat_deg = feature["geometry"]["coordinates"]
        told = feature["properties"]
        place = pytest.approx((told["x_map_m"], told["y_map_m"]), abs=1e-3)
        assert frame.map_from_geodetic(lat_deg, lon_deg, 0.0)[:2] == place
        assert row.split(",")[-2:] == [str(lat_deg), str(lon_deg)]


def test_who_looks_at_a_recording_is_told_when_the_robot_stops(
    robot: Robot, recording: Path
) -> None:
    put_run(robot, "watched", recording)
    browser = Browser(robot.port)
    with Page(robot.port, tab="watch", additional_headers={"Cookie": browser.cookie}) as page:
        assert browser.ask("POST", "/api/v1/replay", {"name": "watched"})[0] == 200
        robot.say(make_state(3))
        while page.receive(wire.LiveState).stop:
            pass
        robot.say(make_state(4, "stopped", "stopped by a test"))
        while page.receive(wire.LiveState).stop != "stopped by a test":
            pass
        assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200


def test_nothing_can_be_commanded_in_a_replay_but_the_stop_reaches_the_robot(
    robot: Robot, recording: Path, page: Page
) -> None:
    (robot.home / "runs").mkdir(exist_ok=True)
    shutil.copytree(recording.parent, robot.home / "runs" / "short")
    browser = Browser(robot.port)
    with Page(robot.port, tab="r", additional_headers={"Cookie": browser.cookie}) as viewer:
        viewer.take_seat()
        status, answer = browser.ask("POST", "/api/v1/replay", {"name": "short", "speed": 2})
        assert status == 200, answer
        while viewer.receive(wire.State).mode != "replay":
            pass
        viewer.send(wire.DriveByHand(v_mps=0.3, yaw_rate_radps=0.0))
        refusal = viewer.ask(wire.ControlMission(action="resume"))
        assert "recording" in refusal.reason
        assert not [order for order in robot.of_kind(wire.DriveOrder) if order.v_mps]
        viewer.send(wire.PressStop())
        robot.wait_for_request("stop")
        assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200
        robot.say(make_state(1000))
        while viewer.receive(wire.State).tick != 1000:
            pass
    for wrong in ({"name": "../x"}, {"speed": 99}, {"t_s": "x"}, {"t_s": 10**400}):
        request = {"name": "short", **wrong}
        assert browser.ask("POST", "/api/v1/replay", request)[0] in {400, 404}


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with a picture each second, and circles around what was found in it."""
    path = tmp_path_factory.mktemp("filmed") / "run.mcap"
    recorder = RunRecorder(path, config.load("farm"), samples.robot(), samples.URDF)
    for record in samples.ticks(150, with_camera=True):
        recorder(record)
    recorder.close()
    return path


def test_a_recording_has_its_pictures_by_time_with_and_without_what_was_found(
    filmed: Path,
) -> None:
    pictures = Pictures.load(filmed)
    assert pictures.at(-1.0) is None
    first, late = pictures.at(0.5), pictures.at(2.9)
    assert first is not None and late is not None
    assert (first[0], late[0]) == (0, 2)
    width, height = Image.open(io.BytesIO(first[1].image)).size
    assert (height, width, 3) == samples.frame(0, 0.0).image_rgb.shape
    assert first[1].found and first[1].found != first[1].image


def test_a_replay_shows_the_camera_and_live_pictures_come_back_after_it(
    robot: Robot, filmed: Path
) -> None:
    put_run(robot, "filmed", filmed)
    browser = Browser(robot.port)
    cookie: dict[str, Any] = {"additional_headers": {"Cookie": browser.cookie}}
    with (
        Page(robot.port, tab="film", **cookie) as page,
        Page(robot.port, path="/ws/cam/main?mask=0", **cookie) as viewer,
    ):
        start = {"name": "filmed", "speed": 0, "t_s": 2.5}
        assert browser.ask("POST", "/api/v1/replay", start)[0] == 200
        while page.receive(wire.State).mode != "replay":
            pass
        shown = Pictures.load(filmed).at(2.5)
        assert shown is not None
        while (data := received(viewer, PATIENCE_S))[16:] != shown[1].image:
            pass  # a picture of the robot that was under way
        assert struct.unpack(">BBHId", data[:16])[3] == shown[0]
        assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200
        image, _ = picture()
        end_s, number = time.monotonic() + PATIENCE_S, 0
        while number != 77:
            assert time.monotonic() < end_s, "the robot's pictures did not come back"
            robot.server.camera_link.send_bytes(pack_pixels(0, 77, 5.0, image))
            with contextlib.suppress(TimeoutError):
                number = struct.unpack(">BBHId", received(viewer, 0.2)[:16])[3]


def received(viewer: Page, timeout_s: float) -> bytes:
    """The next picture, which is drawn at once."""
    data = viewer.line.recv(timeout=timeout_s)
    assert isinstance(data, bytes)
    viewer.line.send("a")
    return data
