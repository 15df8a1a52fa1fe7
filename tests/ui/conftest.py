"""A real server process, with the test in the robot's place or a robot in the simulator."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from agribot.autonomy.plan.rows import lay_rows
from agribot.core import config
from agribot.description.loader import export_urdf, load_robot
from agribot.ui.about import about_run
from agribot.ui.address import Address
from agribot.ui.ground import field_of
from agribot.ui.hub import About
from agribot.ui.server_process import ServerProcess
from tests.ui.client import Page
from tests.waiting import PATIENCE_S


class Robot:
    """The robot's end of the line: sends what it is told to, keeps every order it gets."""

    def __init__(self, home: Path, address: Address | None = None) -> None:
        self.home = home
        self.address = address or Address(port=0)
        self.server = ServerProcess(self.address, self._about)
        self.orders: list[dict[str, Any]] = []
        self.answers: dict[str, Any] = {}  # to what the server asks, by its name
        self._news = threading.Condition()

    def start(self) -> None:
        self.server.start()
        self.server.listen(self._hear, lambda: None, 0.2)
        self.wait_for(lambda order: order["c"] == "ready")

    @property
    def port(self) -> int:
        return self.server.port

    def say(self, message: dict[str, Any]) -> None:
        self.server.link.send_bytes(msgspec.json.encode(message))

    def wait_for(self, is_it: Any, timeout_s: float = PATIENCE_S) -> dict[str, Any]:
        """The first order for which `is_it` holds; fails when none comes."""
        with self._news:
            found = self._news.wait_for(
                lambda: next((o for o in self.orders if is_it(o)), None), timeout_s
            )
        assert found is not None, f"no such order among {self.orders}"
        return found

    def of_kind(self, kind: str) -> list[dict[str, Any]]:
        return [order for order in self.orders if order["c"] == kind]

    def _hear(self, data: bytes) -> None:
        with self._news:
            self.orders.append(order := json.loads(data))
            self._news.notify_all()
        if order["c"] == "ask" and order["name"] in self.answers:
            value = self.answers[order["name"]]
            self.say({"k": "reply", "number": order["number"], "value": value})

    def _about(self, port: int) -> About:
        settings, robot = config.load("farm"), load_robot("agribot")
        field = field_of(settings, lay_rows(settings.field))
        urdf, run = export_urdf("agribot"), self.home / "runs" / "now"
        return about_run(self.address, port, settings, robot, urdf, field, run)


@pytest.fixture(autouse=True, scope="session")
def _own_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AGRIBOT_HOME", str(tmp_path_factory.mktemp("agribot-home")))
        yield


@pytest.fixture(scope="module")
def shared_robot(tmp_path_factory: pytest.TempPathFactory, _own_home: None) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp("robot"))
    robot.start()
    yield robot
    robot.server.close()


@pytest.fixture(scope="module")
def lan_robot(tmp_path_factory: pytest.TempPathFactory, _own_home: None) -> Iterator[Robot]:
    """Served at an address that is not one of this machine alone, so that a token is needed."""
    robot = Robot(tmp_path_factory.mktemp("lan"), Address(host="0.0.0.0", port=0))
    robot.start()
    yield robot
    robot.server.close()


@pytest.fixture
def robot(shared_robot: Robot) -> Robot:
    """The module's server, with the orders of earlier tests forgotten."""
    shared_robot.orders.clear()
    return shared_robot


@pytest.fixture
def page(robot: Robot) -> Iterator[Page]:
    with Page(robot.port) as page:
        yield page
        page.send(k="release")
