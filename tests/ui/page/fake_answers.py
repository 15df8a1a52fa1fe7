"""What the fake server answers over HTTP."""

from __future__ import annotations

import io
import math
from typing import Any

from PIL import Image

from agribot.app.calibration.kinds import KINDS
from agribot.core import config
from agribot.ui.settings import described


def _check(name: str, state: str, value: Any, text: str, advice: str = "") -> dict[str, Any]:
    return {"name": name, "state": state, "value": value, "text": text, "advice": advice}


FIXED: dict[str, Any] = {
    "session": {
        "version": "0.1.0",
        "run": 1,
        "profile": "farm",
        "source": "sim",
        "role": "operator",
        "needs_login": False,
        "lan_url": None,
        "qr_svg": None,
        "camera": True,
        "screens": [],
    },
    "field": None,
    "robot": {
        "name": "agribot",
        "urdf_url": "/robot/robot.urdf",
        "max_speed_mps": 1.0,
        "max_yaw_rate_radps": 1.2,
        "footprint_body_m": [[0.45, 0.33], [0.45, -0.33], [-0.45, -0.33], [-0.45, 0.33]],
        "camera": {
            "width_px": 640,
            "height_px": 480,
            "body_from_camera": [
                0,
                -0.64,
                0.77,
                0.4,
                -1,
                0,
                0,
                0,
                0,
                -0.77,
                -0.64,
                0.6,
                0,
                0,
                0,
                1,
            ],
        },
        "wheel_joints": [
            f"base_link_to_{wheel}_joint"
            for wheel in ("left_wheel_F", "right_wheel_F", "left_wheel_R", "right_wheel_R")
        ],
    },
    "maps": [],
    "views": ["Whole farm"],
    "fields": ["home-field"],
    "panels": [],
    "topics": [],
    "weeds.geojson": {"type": "FeatureCollection", "features": []},
    "recordings": {
        "disk_free_bytes": 81_300_000_000,
        "current": "2026-05-04-101500-farm",
        "recordings": [
            {
                "name": "2026-05-04-101500-farm",
                "utc": "2026-05-04T10:15:00Z",
                "size_bytes": 184_000_000,
                "duration_s": 412.0,
                "profile": "farm",
                "ok": None,
                "reason": "",
                "files": ["run.mcap", "weeds.geojson"],
            },
            {
                "name": "2026-05-03-171200-farm",
                "utc": "2026-05-03T17:12:00Z",
                "size_bytes": 291_000_000,
                "duration_s": 701.2,
                "profile": "farm",
                "ok": True,
                "reason": "",
                "files": ["run.mcap", "report.json"],
            },
            {
                "name": "2026-05-02-093000-hills",
                "utc": "2026-05-02T09:30:00Z",
                "size_bytes": 91_000_000,
                "duration_s": 150.0,
                "profile": "hills",
                "ok": False,
                "reason": "No position for 5 s.",
                "files": ["run.mcap"],
            },
        ],
    },
    "calibrations": {
        "kinds": [
            {
                "name": kind.name,
                "title": kind.title,
                "about": kind.about,
                "ground": kind.ground,
                "duration_s": round(kind.duration_s),
            }
            for kind in KINDS.values()
        ],
        "now": None,
        "found": None,
        "file": "robots/agribot.toml",
        "settings": ["calibration.wheel_radius_m=0.08912", "calibration.yaw_multiplier=1.4135"],
        "broken": "",
        "can_undo": True,
    },
    "settings": {"groups": described(config.load("farm"))},
    "health": {
        "checks": [
            _check("GNSS", "ok", "RTK fixed, 1.4 cm", "Fresh and accurate."),
            _check(
                "Camera",
                "warn",
                "11.8 Hz",
                "Slower than the 15 Hz it should give.",
                "Close other programs that use the camera.",
            ),
            _check("Disk", "ok", "81 GB free", "Room for 7 days."),
            _check(
                "Motors",
                "fault",
                "rear left",
                "No answer for 1.2 s.",
                "Check the cable of the rear left motor, then release STOP.",
            ),
        ],
        "rates": [
            {"topic": "imu", "expected_hz": 100, "measured_hz": 99.8},
            {"topic": "camera", "expected_hz": 15, "measured_hz": 11.8},
            {"topic": "gnss", "expected_hz": 5, "measured_hz": 5.0},
        ],
        "cpu_ratio": 0.42,
        "memory_bytes": 412_000_000,
        "log": [],
    },
}


TILE_RGB = (30, 200, 220)
_file = io.BytesIO()
Image.new("RGB", (256, 256), TILE_RGB).save(_file, "PNG")
TILE = _file.getvalue()


def way(start: tuple[float, float], end: tuple[float, float]) -> dict[str, Any]:
    """Round a corner."""
    corner = (end[0], start[1])
    length_m = math.dist(start, corner) + math.dist(corner, end)
    return {"xy": [start, corner, end], "length_m": length_m, "time_s": length_m / 0.8}


def plan() -> dict[str, Any]:
    return {
        "ok": False,
        "length_m": 412.0,
        "area_m2": 5120.0,
        "time_s": 590.0,
        "reasons": [{"text": "Row 3 leaves the boundary by 0.4 m.", "at_map_m": [12.0, 4.5]}],
        "path": [[72.7870533933, 21.1613331649], [72.78728, 21.16134], [72.78728, 21.16138]],
    }
