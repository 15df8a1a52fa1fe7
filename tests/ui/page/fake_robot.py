"""A robot for the tests of the page: drives rows, finds weeds, obeys; no physics, no clock."""

from __future__ import annotations

import io
import math
import struct
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

DATUM = {"lat_deg": 21.1613331649, "lon_deg": 72.7870533933}
ROWS = 6
ROW_LENGTH_M = 24.0
ROW_SPACING_M = 1.5
SPEED_MPS = 0.8
EPOCH = 1
Message = dict[str, Any]
MISSION_STATES = {
    "mission": "running",
    "paused": "paused",
    "stopped": "paused",
    "teleop": "paused",
    "waiting": "waiting",
    "done": "done",
}


def field() -> Message:
    rows = [
        {
            "index": i,
            "start_map_m": [0.0, i * ROW_SPACING_M],
            "end_map_m": [ROW_LENGTH_M, i * ROW_SPACING_M],
            "points_map_m": [[0.0, i * ROW_SPACING_M], [ROW_LENGTH_M, i * ROW_SPACING_M]],
        }
        for i in range(ROWS)
    ]
    top = (ROWS - 1) * ROW_SPACING_M
    return {
        "name": "farm",
        "datum": DATUM,
        "datum_source": "home",
        "rows": rows,
        "boundary_map_m": [
            [-3, -3],
            [ROW_LENGTH_M + 3, -3],
            [ROW_LENGTH_M + 3, top + 3],
            [-3, top + 3],
        ],
        "obstacles_map_m": [[[-1.6, 1.8], [-1.2, 1.8], [-1.2, 2.2], [-1.6, 2.2]]],
        "waypoints_map_m": [
            point for row in rows for point in (row["start_map_m"], row["end_map_m"])
        ],
        "start_map_m": [-2.0, 0.0],
    }


def path() -> list[list[float]]:
    points = [[-2.0, 0.0]]
    for i in range(ROWS):
        ends = [[0.0, i * ROW_SPACING_M], [ROW_LENGTH_M, i * ROW_SPACING_M]]
        points += ends if i % 2 == 0 else ends[::-1]
    return points


class FakeRobot:
    """Where the robot is at a time, what it was told, and every command it was sent."""

    def __init__(self, weeds: int = 400) -> None:
        self.random = np.random.default_rng(7)
        self.n = 0
        self.t_s = 0.0
        self.s_m = 0.0
        self.mode = "mission"
        self.stop = ""
        self.leg = "row 3"
        self.replay: Message | None = None
        self.trajectory: list[list[float]] = []
        self.commands: list[Message] = []
        self.path = path()
        legs = np.diff(np.array(self.path), axis=0)
        self.leg_m = np.hypot(legs[:, 0], legs[:, 1])
        self.length_m = float(self.leg_m.sum())
        self.weeds = [self._weed(i) for i in range(weeds)]

    def _weed(self, index: int) -> list[Any]:
        crop = int(index % 5 == 0)
        row = int(self.random.integers(ROWS))
        x, dy = self.random.uniform(0, ROW_LENGTH_M), self.random.normal(0, 0.05 if crop else 0.35)
        confidence = float(self.random.uniform(0.5, 1))
        seen = float(index)
        treated = seen + 2.0 if index % 3 == 0 and not crop else None
        size = float(self.random.uniform(4e-4, 4e-3))
        return [
            index + 1,
            crop,
            round(x, 3),
            round(row * ROW_SPACING_M + dy, 3),
            0.03,
            confidence,
            size,
            5,
            seen,
            seen + 1,
            treated,
        ]

    def pose(self) -> tuple[float, float, float]:
        left_m = self.s_m % self.length_m
        for start, end, leg_m in zip(self.path, self.path[1:], self.leg_m, strict=False):
            if left_m <= leg_m:
                share = left_m / leg_m
                dx, dy = end[0] - start[0], end[1] - start[1]
                return start[0] + share * dx, start[1] + share * dy, math.atan2(dy, dx)
            left_m -= leg_m
        return self.path[-1][0], self.path[-1][1], 0.0

    def step(self, dt_s: float) -> list[list[float]]:
        """One tick; the trajectory points it added."""
        self.n += 1
        self.t_s += dt_s
        if self.mode == "mission":
            self.s_m += SPEED_MPS * dt_s
        x, y, _ = self.pose()
        last = self.trajectory[-1] if self.trajectory else None
        if last and math.dist(last, (x, y)) < 0.05:
            return []
        self.trajectory.append([round(x, 3), round(y, 3)])
        return self.trajectory[-1:]

    def obey(self, message: Message) -> Message | None:
        """Note and carry out a command; the answer for those that get one."""
        self.commands.append(message)
        kind = message["k"]
        if kind == "stop":
            self.mode, self.stop = "stopped", "pressed on the page"
        elif kind == "drive" and not self.stop:
            self.mode = "teleop" if message["v"] or message["w"] else "paused"
        elif kind == "clear_stop":
            self.mode, self.stop = "paused", ""
        elif kind == "mission":
            modes = {
                "pause": "paused",
                "resume": "mission",
                "start": "mission",
                "cancel": "done",
            }
            self.mode = modes.get(message["action"], self.mode)
        return (
            {"k": "ack", "id": message["id"], "ok": True, "reason": ""} if "id" in message else None
        )

    def state(self, mono_ms: float, wall_ms: float = 0.0) -> Message:
        x, y, yaw = self.pose()
        speed = SPEED_MPS if self.mode == "mission" else 0.0
        row = min(ROWS - 1, int(y / ROW_SPACING_M + 0.5))
        signals = [self.t_s, speed, 0.04 * math.sin(self.t_s), 0.02 * math.cos(2 * self.t_s), 24.6]
        return {
            "k": "s",
            "n": self.n,
            "t": self.t_s,
            "e": EPOCH,
            "mono_ms": mono_ms,
            "wall_ms": wall_ms,
            "pose": [x, y, yaw],
            "std": [0.018, 0.01],
            "vel": [speed, 0.0],
            "cmd": [speed, 0.0],
            "joints": [self.s_m / 0.15] * 4,
            "att": [0.02, -0.03],
            "gnss": {"lat": DATUM["lat_deg"], "lon": DATUM["lon_deg"], "q": 4, "std": 0.014},
            "mission": {
                "state": MISSION_STATES[self.mode],
                "reason": "",
                "row": row,
                "rows_total": ROWS,
                "rows_done": list(range(row)),
                "s_m": self.s_m,
                "length_m": self.length_m,
                "eta_s": (self.length_m - self.s_m) / SPEED_MPS,
                "wp_total": 2 * ROWS,
                "wp_reached": 2 * row,
                "leg": self.leg,
                "refusal": "",
            },
            "mode": self.mode,
            "stop": self.stop,
            "reason": "",
            "battery": {"v": 25.1, "pct": 87},
            "weeds": len(self.weeds),
            "rtf": 1.0,
            "xte_m": 0.021,
            "implement": [["Nozzles", "○●○"]],
            "recording": "2026-05-03-171500-farm",
            "sig": [signals],
            **({"replay": self.replay} if self.replay else {}),
        }

    def snapshot(self) -> Message:
        return {
            "k": "snap",
            "e": EPOCH,
            "source": "sim",
            "name": "",
            "traj": {"first": 0, "xy": self.trajectory},
            "weeds": {"rev": 1, "all": self.weeds},
            "path": {"first": 0, "xy": self.path, "row": [0] * len(self.path)},
            "events": [
                {"t": 0.0, "level": "info", "source": "mission", "text": "Mission farm started."},
                {
                    "t": 3.2,
                    "level": "warn",
                    "source": "gnss",
                    "text": "Fix fell back to float for 0.8 s.",
                },
            ],
            "signals": {
                "names": ["speed", "cross_track", "heading_error", "battery"],
                "units": ["m/s", "m", "rad", "V"],
            },
        }


def camera_packets(frame: int, wall_ms: float) -> tuple[bytes, bytes]:
    """A picture of soil, crop and weeds moving down, and its class mask."""
    image = Image.new("RGB", (640, 480), (94, 72, 54))
    mask = Image.new("P", (320, 240), 2)
    mask.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 0])
    pen, mask_pen = ImageDraw.Draw(image), ImageDraw.Draw(mask)
    rng = np.random.default_rng(3)
    for i in range(26):
        weed = i % 3 == 0
        x = float(rng.uniform(60, 580)) if weed else 320 + float(rng.normal(0, 14))
        y = (float(rng.uniform(0, 480)) + 4 * frame) % 520 - 20
        size = float(rng.uniform(9, 24))
        pen.ellipse(
            (x - size, y - size * 0.7, x + size, y + size * 0.7),
            fill=(96, 140, 60) if weed else (52, 112, 44),
        )
        mask_pen.ellipse(
            ((x - size) / 2, (y - size * 0.7) / 2, (x + size) / 2, (y + size * 0.7) / 2),
            fill=0 if weed else 1,
        )
    return _packet(0, frame, wall_ms, image, "JPEG"), _packet(1, frame, wall_ms, mask, "PNG")


def _packet(kind: int, frame: int, wall_ms: float, picture: Image.Image, file_format: str) -> bytes:
    file = io.BytesIO()
    picture.save(file, file_format)
    return struct.pack(">BBxxId", kind, 0, frame, wall_ms) + file.getvalue()
