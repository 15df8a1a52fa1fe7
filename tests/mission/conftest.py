"""Whole missions are dear: each kind runs once and many tests look at it.

Pictures are the dearest part of them, a tenth of a CPU second each. So `make test` drives with
two of ten that a profile has, which is harder, and `make nightly` with all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from agribot.core.config import RunConfig
from agribot.core.world import WorldSpec
from agribot.description.worlds_sdf import load_run_world
from agribot.record.report import Report

ShortRun = Callable[..., tuple[Path, Report]]
FEW_HZ, ALL_HZ = 2.0, 10.0  # pictures a second


class FarmDrive(NamedTuple):
    """What of the farm is driven, and with what."""

    seed: int
    pictures_hz: float = ALL_HZ
    rows: int = 6
    length_m: float = 10.0
    sensors: str = "rtk"


FarmRun = Callable[[FarmDrive], tuple[Path, Report]]


def see_at(pictures_hz: float) -> str:
    return f"perception.camera_rate_hz={pictures_hz}"


def start_before_a_row(patch: pytest.MonkeyPatch) -> list[str]:
    """Put the robot down where the way into the farm's first row begins; gives its settings."""

    def near(settings: RunConfig) -> WorldSpec:
        place = {"spawn_xy_map_m": (1.0, 0.4), "spawn_yaw_map_rad": math.pi / 2.0}
        return msgspec.structs.replace(load_run_world(settings), **place)

    patch.setattr("agribot.app.run_world.load_run_world", near)
    return ["field.start_map_m=[1.0,0.4]"]


def run_session(profile: str, settings: list[str], out_dir: str) -> Report:
    """Drive one session to its end in this process."""
    from agribot.app.simulated_run import simulate
    from agribot.core import config

    with simulate(config.load(profile, settings), Path(out_dir)) as session:
        for _ in session.ticks():
            pass
        return session.finish()


@pytest.fixture(scope="session")
def farm_run(tmp_path_factory: pytest.TempPathFactory) -> FarmRun:
    """`agribot run farm` with camera and network, driven once each."""
    root = tmp_path_factory.mktemp("farm")

    @cache
    def drive(wanted: FarmDrive) -> tuple[Path, Report]:
        out = root / "-".join(map(str, wanted))
        settings = [f"seed={wanted.seed}", f'sim.sensors="{wanted.sensors}"',
                    f"field.row_count={wanted.rows}", f"field.row_length_m={wanted.length_m}",
                    see_at(wanted.pictures_hz)]  # fmt: skip
        with pytest.MonkeyPatch.context() as patch:
            settings += start_before_a_row(patch) if wanted.rows == 1 else []
            return out, run_session("farm", settings, str(out))

    return drive


@pytest.fixture
def short_run(tmp_path: Path) -> ShortRun:
    """Run the first seconds of the farm mission with extra settings."""

    def run(name: str, *settings: str, seconds: float = 12.0) -> tuple[Path, Report]:
        out = tmp_path / name
        return out, run_session("farm", [f"duration_s={seconds}", *settings], str(out))

    return run
