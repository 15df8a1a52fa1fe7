"""The form of the page for the noise of simulated sensors, by the request that it sends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.core import config
from agribot.sim.sensors.tuning import check_tuning
from agribot.ui.address import Address
from agribot.ui.noise_panel import add_noise_panel
from agribot.ui.panels import Panels
from agribot.ui.robot_side.operator_page import OperatorPage
from tests.ui.client import Browser, Page

WHERE = "/api/v1/panels/form-sensor-noise"


def gyro_std(session: SimulatedRun) -> float:
    samples = [s.gyro_radps for _ in range(50) for s in session.simulator.read().imu]
    return float(np.std(samples))


def test_the_noise_changes_by_a_post_and_a_limit_is_named(tmp_path: Path) -> None:
    settings = config.load(
        "farm", ["perception.enabled=false", "record.enabled=false", "sim.sensors='ideal'"]
    )
    panels = Panels()
    with simulate(settings, tmp_path / "run") as session:
        add_noise_panel(panels, check_tuning, session.simulator.tune)
        with OperatorPage(session, Address(port=0), panels) as page:
            browser = Browser(page.server.port)
            cookie = {"Cookie": browser.cookie}
            with Page(page.server.port, tab="n", additional_headers=cookie) as operator:
                operator.take_seat()
                assert gyro_std(session) < 1e-4
                change = {"sensor": "gyro", "gaussian_noise": 0.05}
                assert browser.ask("POST", WHERE, change)[0] == 200
                assert gyro_std(session) == pytest.approx(0.05, rel=0.1)
                status, answer = browser.ask(
                    "POST", WHERE, {"sensor": "gyro", "offset": 0.5, "drift": 99.0}
                )
                assert (status, "give 0 to 10 rad/s" in answer["error"]) == (422, True)
                assert browser.ask("POST", WHERE, {"sensor": "sonar"})[0] == 422
                assert gyro_std(session) == pytest.approx(0.05, rel=0.1)
