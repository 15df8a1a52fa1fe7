"""How fast the simulator, the network and the whole robot run here, in CPU time.

Each figure is the median of several repeats of process CPU time (all threads), because wall time
says more about what else the machine is doing.
"""

from __future__ import annotations

import math
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core import config
from agribot.core.geo import transform
from agribot.core.messages import DriveCommand, RobotCommand
from agribot.description.worlds_sdf import load_world
from agribot.lab.bench.dense_field import ACROSS, FORWARD, NADIR, CameraLoop, DenseView

REPEATS = 5
MISSION_S = 40.0


class Figure(NamedTuple):
    title: str
    measure: Callable[[], float | None]


def measure(
    names: Sequence[str] = (), show_line: Callable[[str], None] = lambda line: None
) -> dict[str, Any]:
    """Measure the named figures, or all, one after the other; `show_line` gets a line for each.

    Missions stand beside physics alone of the same run: a machine has another speed every hour.
    """
    wanted = [*names] or [*FIGURES]
    if MISSIONS.intersection(wanted) and "physics_rtf" not in wanted:
        wanted.insert(0, "physics_rtf")
    measured: dict[str, float | None] = {}
    for name in wanted:
        measured[name] = FIGURES[name].measure()
        show_line(_describe(name, measured))
    return {"cpus": os.cpu_count(), "machine": platform.machine(), **_nest(measured)}


def _describe(name: str, measured: dict[str, float | None]) -> str:
    value, physics = measured[name], measured.get("physics_rtf")
    text = f"{FIGURES[name].title:64} " + ("       -" if value is None else f"{value:8.1f}")
    if name in MISSIONS and value is not None and physics:
        text += f"  {100.0 * value / physics:.1f} % of physics alone"
    return text


def _nest(measured: dict[str, float | None]) -> dict[str, Any]:
    """Put figures of one kind together: `mission_rtf_cpu.camera` is `camera` of the kind."""
    nested: dict[str, Any] = {}
    for name, value in measured.items():
        kind, _, which = name.partition(".")
        if which:
            nested.setdefault(kind, {})[which] = value
        else:
            nested[name] = value
    return nested


def measure_cpu_s(work: Callable[[], object]) -> float:
    """Measure the median CPU seconds of one call, after one that is not counted."""
    work()
    spent = []
    for _ in range(REPEATS):
        started_s = time.process_time()
        work()
        spent.append(time.process_time() - started_s)
    return statistics.median(spent)


def measure_physics_rtf(world: str = "empty") -> float:
    from agribot.description.loader import load_robot
    from agribot.sim.physics import Physics

    physics = Physics(load_robot(), load_world(world), 2_000_000)
    physics.command(DriveCommand(v_mps=0.4, yaw_rate_radps=0.2))
    return 1.0 / measure_cpu_s(lambda: physics.advance(500))


def measure_sensors_rtf() -> float:
    from agribot.description.loader import load_robot
    from agribot.sim.platform import SimPlatform

    settings = config.load("farm", ["perception.enabled=false"])
    robot_platform = SimPlatform(settings, load_robot(), load_world("Farm"))

    def one_second() -> None:
        for _ in range(50):
            robot_platform.read()
            command = DriveCommand(v_mps=0.2, yaw_rate_radps=0.3)
            robot_platform.write(RobotCommand(t_s=0.0, drive=command))

    return 1.0 / measure_cpu_s(one_second)


def measure_render_ms() -> float:
    from agribot.description.loader import load_robot
    from agribot.sim.camera import CameraRenderer

    robot, renderer = load_robot(), CameraRenderer(load_world("Farm"))
    camera = robot.camera
    assert camera is not None  # the packaged robot has a camera
    pose = transform((1.0, 5.0, 0.0), (0.0, 0.0, math.pi / 2)) @ robot.body_from_camera()
    return 1e3 * measure_cpu_s(lambda: renderer.render(pose, camera, noise_seed=0))


def measure_dense_render_ms(
    view: tuple[float, float], *, is_hilly: bool = False, is_rough: bool = False
) -> float:
    dense = DenseView(*view, is_hilly=is_hilly, is_rough=is_rough)
    return 1e3 * measure_cpu_s(dense.render)


def measure_camera_loop_rtf() -> float:
    loop = CameraLoop()
    return 1.0 / measure_cpu_s(lambda: loop.advance(1.0))


def measure_network_ms() -> float:
    segmenter = Segmenter("agribot-sim")
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    return 1e3 * measure_cpu_s(lambda: segmenter.segment(image))


def measure_mission_rtf(*settings: str) -> float | None:
    """Measure simulated seconds per CPU second of the whole robot, start-up not counted."""
    from agribot.app.simulated_run import simulate

    with TemporaryDirectory() as folder:
        chosen = config.load("farm", ["seed=1", f"duration_s={MISSION_S}", *settings])
        with simulate(chosen, Path(folder)) as session:
            for _ in session.ticks():
                pass
            return session.finish().time.rtf_cpu


def measure_import_ms() -> float:
    """Measure the wall time of `import agribot` over a bare interpreter's, least of several."""

    def least(code: str) -> float:
        spent = []
        for _ in range(REPEATS):
            started_s = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True)
            spent.append(time.perf_counter() - started_s)
        return min(spent)

    modules = "agribot, agribot.core.messages, agribot.core.config"
    return 1e3 * (least(f"import {modules}") - least("pass"))


NO_CAMERA, NO_RECORDING = "perception.enabled=false", "record.enabled=false"
FIGURES = {
    "import_ms": Figure("import of agribot and its messages (ms)", measure_import_ms),
    "physics_rtf": Figure("physics alone, 2 ms steps (x real time)", measure_physics_rtf),
    "sensors_rtf": Figure(
        "physics and all sensors but the camera (x real time)", measure_sensors_rtf
    ),
    "physics_hills_rtf": Figure(
        "physics alone on hills, 2 ms steps (x real time)", lambda: measure_physics_rtf("hills")
    ),
    "render_ms": Figure("one 640x480 frame with labels (CPU ms)", measure_render_ms),
    "render_nadir_ms": Figure(
        "the same over 10,816 plants, straight down (CPU ms)",
        lambda: measure_dense_render_ms(NADIR),
    ),
    "render_45_ms": Figure(
        "the same, 45 degrees down (CPU ms)", lambda: measure_dense_render_ms(ACROSS)
    ),
    "render_forward_ms": Figure(
        "the same, level and 28 cm over the soil (CPU ms)", lambda: measure_dense_render_ms(FORWARD)
    ),
    "render_hills_ms": Figure(
        "the same on hills, 45 degrees down (CPU ms)",
        lambda: measure_dense_render_ms(ACROSS, is_hilly=True),
    ),
    "render_relief_nadir_ms": Figure(
        "the same on rough ground, straight down (CPU ms)",
        lambda: measure_dense_render_ms(NADIR, is_rough=True),
    ),
    "render_relief_45_ms": Figure(
        "the same on rough ground, 45 degrees down (CPU ms)",
        lambda: measure_dense_render_ms(ACROSS, is_rough=True),
    ),
    "render_relief_forward_ms": Figure(
        "the same on rough ground, level (CPU ms)",
        lambda: measure_dense_render_ms(FORWARD, is_rough=True),
    ),
    "camera_loop_rtf": Figure(
        "physics, all sensors and the camera at 30 Hz there (x real time)", measure_camera_loop_rtf
    ),
    "network_ms": Figure("network on one frame (CPU ms)", measure_network_ms),
    "mission_rtf_cpu.no_camera": Figure(
        "whole robot, no camera, no recording (x real time)",
        lambda: measure_mission_rtf(NO_CAMERA, NO_RECORDING),
    ),
    "mission_rtf_cpu.no_camera_recorded": Figure(
        "whole robot, no camera, recording (x real time)", lambda: measure_mission_rtf(NO_CAMERA)
    ),
    "mission_rtf_cpu.camera": Figure(
        "whole robot, 10 Hz camera and network, recording (x real time)", measure_mission_rtf
    ),
}
MISSIONS = {name for name in FIGURES if name.startswith("mission_rtf_cpu.")}
