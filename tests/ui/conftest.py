"""A real server process, with the test in the robot's place or a robot in the simulator."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest

from agribot.core.facts import Said

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.description.loader import export_urdf, load_robot
from agribot.ui import wire
from agribot.ui.about import About
from agribot.ui.address import Address
from agribot.ui.ground import field_of
from agribot.ui.robot_side.about_run import about_run
from agribot.ui.robot_side.server_process import ServerProcess
from tests.ui.client import Page
from tests.waiting import PATIENCE_S

M = TypeVar("M", bound=wire.Message)


class Robot:
    """The robot's end of the line: sends what a test passes to it, keeps every order it gets."""

    def __init__(self, home: Path, address: Address | None = None) -> None:
        self.home = home
        self.address = address or Address(port=0)
        self.server = ServerProcess(self.address, self._about)
        self.orders: list[wire.RobotOrder] = []
        self.answers: dict[type[wire.Message], Any] = {}  # to what the server asks
        self.refusals: dict[type[wire.Message], str] = {}
        self._news = threading.Condition()

    def start(self) -> None:
        self.server.start()
        self.server.listen(self._hear, lambda: None, 0.2)
        self.wait_for(wire.Ready)

    @property
    def port(self) -> int:
        return self.server.port

    def say(self, message: wire.RobotMessage) -> None:
        self.server.link.send_bytes(wire.encode(message))

    def wait_for(
        self,
        kind: type[M],
        is_it: Callable[[M], bool] = lambda _: True,
        timeout_s: float = PATIENCE_S,
    ) -> M:
        """The first order of this kind for which `is_it` holds; fails when none comes."""
        with self._news:
            found = self._news.wait_for(
                lambda: next((order for order in self.of_kind(kind) if is_it(order)), None),
                timeout_s,
            )
        assert found is not None, f"no such order among {self.orders}"
        return found

    def wait_for_request(
        self, word: str, is_it: Callable[[Any], bool] = lambda _: True
    ) -> wire.RequestOrder:
        """The first order with a request of this word for which `is_it` holds."""
        return self.wait_for(
            wire.RequestOrder, lambda o: o.request.word == word and is_it(o.request)
        )

    def wait_for_question(self, kind: type[M]) -> tuple[int, M]:
        """The first question of this kind, and the id that its answer has to carry."""
        asked = self.wait_for(wire.Ask, lambda ask: isinstance(ask.question, kind))
        assert isinstance(asked.question, kind)
        return asked.id, asked.question

    def of_kind(self, kind: type[M]) -> list[M]:
        return [order for order in self.orders if isinstance(order, kind)]

    def _hear(self, data: bytes) -> None:
        with self._news:
            self.orders.append(order := wire.read_robot_order(data))
            self._news.notify_all()
        if isinstance(order, wire.Ask):
            self._answer(order.id, type(order.question))

    def _answer(self, id: int, kind: type[wire.Message]) -> None:
        if kind in self.refusals:
            self.say(wire.Answer(id=id, refusal=Said(self.refusals[kind])))
        elif kind in self.answers:
            self.say(wire.Answer(id=id, value=self.answers[kind]))

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
        page.send(wire.LeaveSeat())
