from __future__ import annotations

import asyncio
import contextlib
import io
import json
import shutil
import struct
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image

from agribot import config
from agribot.messages import ByteArray
from agribot.record.recorder import RunRecorder
from agribot.session import Session
from agribot.ui.camera import LADDER, QUICK_TIMES, Camera, Ladder, Picture, encode, unpacked
from agribot.ui.channel import CHANGES_KEPT, STATES_KEPT, Channel, Client, signal_table
from agribot.ui.feed import packed
from agribot.ui.hub import Hub
from agribot.ui.pictures import Pictures
from agribot.ui.replay import Replay
from tests.record import record_samples as samples
from tests.ui.client import Browser, Page
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S


def state(number: int) -> dict[str, object]:
    return {"k": "s", "n": number, "wall_ms": time.time() * 1e3, "t": float(number)}


def test_a_slow_page_loses_its_oldest_states_and_no_change() -> None:
    channel, client = Channel("sim", signal_table()), Client()
    channel.clients.add(client)
    for number in range(100):
        channel.publish_state(json.dumps(state(number)))
    for number in range(3):
        channel.publish_change(json.dumps({"k": "traj", "first": number, "xy": [[number, 0]]}))
    got = [json.loads(asyncio.run(client.next(channel))) for _ in range(3 + STATES_KEPT)]
    assert [m["first"] for m in got[:3]] == [0, 1, 2]
    assert [m["n"] for m in got[3:]] == list(range(100 - STATES_KEPT, 100))
    assert client.dropped == 100 - STATES_KEPT


def test_a_page_that_is_too_far_behind_gets_everything_afresh() -> None:
    channel, client = Channel("sim", signal_table()), Client()
    channel.clients.add(client)
    for number in range(CHANGES_KEPT + 50):
        channel.publish_change(json.dumps({"k": "traj", "first": number, "xy": [[number, 0]]}))
    snapshot = json.loads(asyncio.run(client.next(channel)))
    assert snapshot["k"] == "snap"
    assert len(snapshot["traj"]["xy"]) == CHANGES_KEPT + 50


def test_a_page_that_comes_late_has_the_whole_trace_and_all_weeds(robot: Robot) -> None:
    robot.say({"k": "traj", "first": 0, "xy": [[0.0, 0.0], [0.1, 0.0]]})
    robot.say({"k": "traj", "first": 2, "xy": [[0.2, 0.0]]})
    weed = [7, 0, 1.0, 2.0, 0.02, 0.9, 0.001, 4, 1.0, 2.0, None]
    robot.say({"k": "weeds", "rev": 1, "set": [weed, [8, *weed[1:]]], "gone": []})
    robot.say({"k": "weeds", "rev": 2, "set": [[7, 0, 1.5, *weed[3:]]], "gone": [8]})
    with Page(robot.port, tab="early") as early:
        early.receive("snap")
    with Page(robot.port, tab="late") as page:
        snapshot = page.receive("snap")
    assert snapshot["traj"]["xy"] == [[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]]
    assert [row[:3] for row in snapshot["weeds"]["all"]] == [[7, 0, 1.5]]


def test_a_stalled_page_does_not_hold_up_another(robot: Robot, page: Page) -> None:
    with Page(robot.port, tab="stalled", max_queue=1) as stalled:
        stalled.receive("hello")
        padding = "x" * 20_000
        for number in range(600):
            robot.say({**state(number), "reason": padding})
        while page.receive("s")["n"] != 599:
            pass
        seen = [stalled.receive("s")["n"]]
        while seen[-1] != 599:
            seen.append(stalled.receive("s")["n"])
        assert len(seen) < 500, "what was old is left out"


def picture(index: int = 3) -> tuple[ByteArray, ByteArray]:
    rng = np.random.default_rng(index)
    image = np.kron(rng.integers(0, 255, (30, 40, 3), dtype=np.uint8), np.ones((16, 16, 1)))
    mask = np.kron(rng.integers(0, 3, (30, 40), dtype=np.uint8), np.ones((16, 16)))
    return image.astype(np.uint8), mask.astype(np.uint8)


def test_pictures_cross_the_line_unchanged() -> None:
    for kind, pixels in enumerate(picture()):
        there = unpacked(packed(kind, 7, 1.7e12 + 0.5, pixels))
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
    ladder = Ladder()
    for _ in range(10):
        ladder.drawn(0.3)
    assert ladder.level == len(LADDER) - 1
    for _ in range(QUICK_TIMES + 1):
        ladder.drawn(0.05)
    assert ladder.level == len(LADDER) - 2


def test_the_camera_runs_only_while_somebody_looks_and_waits_for_credits(robot: Robot) -> None:
    image, mask = picture()
    with Page(robot.port, path="/ws/cam/main?mask=1") as viewer:
        robot.wait_for(lambda order: order["c"] == "watch" and order["camera"] and order["mask"])

        def send(index: int) -> None:
            robot.server.camera_link.send_bytes(packed(1, index, 5.0, mask))
            robot.server.camera_link.send_bytes(packed(0, index, 5.0, image))

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
    robot.wait_for(lambda order: order["c"] == "watch" and not order["camera"])


def test_a_picture_is_encoded_once_for_all_who_want_it(monkeypatch: pytest.MonkeyPatch) -> None:
    image, _ = picture()
    there, calls = Picture(kind=0, index=1, wall_ms=0.0, pixels=image), []

    def counted(picture: Picture, level: int) -> bytes:
        calls.append(level)
        return encode(picture, level)

    async def many() -> list[bytes]:
        camera = Camera(cast(Hub, None))
        wanted = [camera.encoded(there, level) for level in (0, 0, 0, 2, 2)]
        return await asyncio.gather(*wanted)

    monkeypatch.setattr("agribot.ui.camera.encode", counted)
    data = asyncio.run(many())
    assert sorted(calls) == [0, 2]
    assert data[0] == data[1] == data[2] != data[3] == data[4]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = config.load("farm", ["perception.enabled=false", "seed=1", "duration_s=8"])
    out = tmp_path_factory.mktemp("runs") / "short"
    with Session(settings, out) as session:
        for _ in session.ticks():
            pass
        session.finish()
    return out / "run.mcap"


def test_a_replay_shows_the_same_places_and_goes_back_and_forth(recording: Path) -> None:
    replay, client = Replay.load(recording, "short"), Client()
    replay.clients.add(client)
    wall_s = 100.0
    for _ in range(60):
        replay.step(wall_s)
        wall_s += 0.1
    assert replay.newest()["t"] == pytest.approx(5.9, abs=0.1)
    assert replay.newest()["mode"] == "replay"
    trace = list(replay.trace_map_m)
    assert len(trace) > 10
    replay.seek(4.0)
    assert replay.newest()["t"] == pytest.approx(4.0, abs=0.05)
    assert trace[: len(replay.trace_map_m)] == replay.trace_map_m
    assert len(replay.trace_map_m) < len(trace)
    replay.speed = 10.0
    for _ in range(20):
        replay.step(wall_s)
        wall_s += 0.1
    assert replay.described()["t_s"] == replay.described()["end_s"]
    assert trace == replay.trace_map_m[: len(trace)]


def test_nothing_can_be_commanded_in_a_replay_but_the_stop_reaches_the_robot(
    robot: Robot, recording: Path, page: Page
) -> None:
    (robot.home / "runs").mkdir()
    own = recording.parent.rename(robot.home / "runs" / "short") / "run.mcap"
    assert own.is_file()
    browser = Browser(robot.port)
    with Page(robot.port, tab="r", additional_headers={"Cookie": browser.cookie}) as viewer:
        viewer.take_seat()
        status, answer = browser.ask("POST", "/api/v1/replay", {"name": "short", "speed": 2})
        assert status == 200, answer
        while viewer.receive("s").get("mode") != "replay":
            pass
        viewer.send(k="drive", seq=1, v=0.3, w=0.0)
        refusal = viewer.ask(k="mission", id=1, action="resume")
        assert "recording" in refusal["reason"]
        assert not [order for order in robot.of_kind("drive") if order["v"]]
        viewer.send(k="stop")
        robot.wait_for(lambda order: order.get("action") == "stop")
        assert browser.ask("POST", "/api/v1/replay", {"name": None})[0] == 200
        robot.say(state(1000))
        while viewer.receive("s")["n"] != 1000:
            pass
    for wrong in ({"name": "../x"}, {"name": "short", "speed": 99}, {"name": "short", "t_s": "x"}):
        assert browser.ask("POST", "/api/v1/replay", wrong)[0] in {400, 404}


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
    (robot.home / "runs" / "filmed").mkdir(parents=True)
    shutil.copyfile(filmed, robot.home / "runs" / "filmed" / "run.mcap")
    browser = Browser(robot.port)
    cookie: dict[str, Any] = {"additional_headers": {"Cookie": browser.cookie}}
    with (
        Page(robot.port, tab="film", **cookie) as page,
        Page(robot.port, path="/ws/cam/main?mask=0", **cookie) as viewer,
    ):
        start = {"name": "filmed", "speed": 0, "t_s": 2.5}
        assert browser.ask("POST", "/api/v1/replay", start)[0] == 200
        while page.receive("s").get("mode") != "replay":
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
            robot.server.camera_link.send_bytes(packed(0, 77, 5.0, image))
            with contextlib.suppress(TimeoutError):
                number = struct.unpack(">BBHId", received(viewer, 0.2)[:16])[3]


def received(viewer: Page, timeout_s: float) -> bytes:
    """The next picture, which is drawn at once."""
    data = viewer.line.recv(timeout=timeout_s)
    assert isinstance(data, bytes)
    viewer.line.send("a")
    return data
