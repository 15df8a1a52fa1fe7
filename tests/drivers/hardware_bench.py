"""A robot on a table: boards and receiver at the far ends of pseudo-terminals, in real time."""

from __future__ import annotations

import contextlib
import datetime as dt
import math
import os
import pty
import select
import threading
import time
import tty
from pathlib import Path

from agribot.core.config import FieldConfig
from agribot.core.geo import MapFrame
from agribot.description.loader import load_robot
from tests.drivers.board_emulator import TICK_S, BoardEmulator, turn_of
from tests.drivers.receiver_bytes import EPOCH, make_ubx_pvt

ROBOT = load_robot()
DRIVE = ROBOT.drive
COUNTS_PER_TURN = DRIVE.encoder_ticks_per_rev * DRIVE.gear_ratio
FIX_EVERY = 10  # ticks of the board
PATIENT_S = 3.0  # with a busy machine


class Plug:
    """A line with a device at the far end; `path` stays while it is pulled and put in."""

    def __init__(self, path: Path) -> None:
        self.path, self._far = path, -1
        self.put_in()

    def put_in(self) -> None:
        self._far, near = pty.openpty()
        for end in (self._far, near):
            tty.setraw(end)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(near))
        os.close(near)

    def pull(self) -> None:
        if self._far >= 0:
            os.close(self._far)
        self._far = -1

    def exchange(self, data: bytes) -> bytes:
        """Say `data`, and hear what waits; nothing where nobody has the other end open."""
        if self._far < 0:
            return b""
        with contextlib.suppress(OSError):  # nobody listens, or too slowly
            if data and select.select([], [self._far], [], 0.0)[1]:
                os.write(self._far, data)
            if select.select([self._far], [], [], 0.0)[0]:
                return os.read(self._far, 4096)
        return b""


class HardwareBench:
    """Lives in a thread: wheels turn as told, and the robot moves as they turn.

    `pose` is where it is in the map (x, y, yaw).
    """

    def __init__(self, folder: Path, pose: tuple[float, float, float], field: FieldConfig) -> None:
        self.board = BoardEmulator(timeout_s=PATIENT_S)
        self.base, self.gnss = Plug(folder / "ttyBASE"), Plug(folder / "ttyGNSS")
        self.pose = pose
        self._frame = MapFrame(field.datum)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._v_mps = 0.0

    def __enter__(self) -> HardwareBench:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.base.pull()
        self.gnss.pull()

    @property
    def sources(self) -> list[str]:
        return ["--source", f"base=serial:{self.base.path}?baud=115200",
                "--source", f"gnss=serial:{self.gnss.path}"]  # fmt: skip

    def _run(self) -> None:
        next_s, tick = time.monotonic(), 0
        while not self._ended.wait(max(next_s - time.monotonic(), 0.0)):
            next_s, tick = next_s + TICK_S, tick + 1
            self.board.feed(self.base.exchange(self.board.advance()))
            self._move()
            if tick % FIX_EVERY == 0:
                self.gnss.exchange(self._fix(tick))

    def _move(self) -> None:
        right, left, *_ = turn_of(self.board, COUNTS_PER_TURN)
        x_m, y_m, yaw_rad = self.pose
        radius_m = DRIVE.wheel_radius_m
        v_mps = (right + left) / 2.0 * radius_m
        rate = (right - left) * radius_m / DRIVE.effective_separation_m
        yaw_rad += rate * TICK_S
        self.pose = (x_m + v_mps * TICK_S * math.cos(yaw_rad),
                     y_m + v_mps * TICK_S * math.sin(yaw_rad), yaw_rad)  # fmt: skip
        self._v_mps = v_mps
        hum = 1e-3 * math.sin(1e3 * time.monotonic())  # no gyro says the same twice
        self.board.gyro_radps = (hum, 0.0, rate)
        north_t = 3e-5
        self.board.mag_t = (north_t * math.sin(yaw_rad), north_t * math.cos(yaw_rad), -3e-5)

    def _antenna(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float, float]:
        ahead_m, left_m, up_m = ROBOT.body_from_link(ROBOT.gnss.link)[:3, 3].tolist()
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return x_m + c * ahead_m - s * left_m, y_m + s * ahead_m + c * left_m, up_m

    def _fix(self, tick: int) -> bytes:
        x_m, y_m, yaw_rad = self.pose
        lat_deg, lon_deg, _ = self._frame.geodetic_from_map(*self._antenna(x_m, y_m, yaw_rad))
        velocity = (self._v_mps * math.cos(yaw_rad), self._v_mps * math.sin(yaw_rad), 0.0)
        return make_ubx_pvt(
            EPOCH + tick * dt.timedelta(seconds=TICK_S), lat_deg, lon_deg, carrier=2,
            h_acc_m=0.02, velocity_mps=velocity,
        )  # fmt: skip
