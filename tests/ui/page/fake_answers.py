"""What the fake server answers over HTTP."""

from __future__ import annotations

import io
import math
from typing import Any

from PIL import Image

from agribot.app.calibration.kinds import KINDS
from agribot.core import config
from agribot.ui import wire
from agribot.ui.settings import show_settings


def _check(
    name: str, state: wire.CheckState, value: str, text: str, advice: str = ""
) -> wire.HealthCheck:
    return wire.HealthCheck(name=name, state=state, value=value, text=text, advice=advice)


def _recording(
    name: str, utc: str, size_bytes: int, duration_s: float, ok: bool | None, files: list[str],
    reason: str = "",
) -> wire.RecordingInfo:  # fmt: skip
    return wire.RecordingInfo(
        name=name, utc=utc, size_bytes=size_bytes, duration_s=duration_s,
        profile=name.rpartition("-")[2], ok=ok, reason=reason, files=files,
    )  # fmt: skip


UNWORKED = "38.1 m2 between the passes stay unworked"
SESSION = wire.SessionInfo(
    version="0.1.0", run=1, profile="farm", source="sim", role="operator", lan_url=None,
    qr_svg=None, camera=True,
)  # fmt: skip
ROBOT = wire.Robot(
    name="agribot",
    urdf_url="/robot/robot.urdf",
    max_speed_mps=1.0,
    max_yaw_rate_radps=1.2,
    footprint_body_m=[(0.45, 0.33), (0.45, -0.33), (-0.45, -0.33), (-0.45, 0.33)],
    camera=wire.CameraInfo(
        width_px=640,
        height_px=480,
        hfov_rad=1.4,
        body_from_camera=[0, -0.64, 0.77, 0.4, -1, 0, 0, 0, 0, -0.77, -0.64, 0.6, 0, 0, 0, 1],
    ),
    tool_width_m=1.08,
    wheel_joints=[
        f"base_link_to_{wheel}_joint"
        for wheel in ("left_wheel_F", "right_wheel_F", "left_wheel_R", "right_wheel_R")
    ],
)
RECORDINGS = wire.Recordings(
    disk_free_bytes=81_300_000_000,
    current="2026-05-04-101500-farm",
    recordings=[
        _recording(
            "2026-05-04-101500-farm", "2026-05-04T10:15:00Z", 184_000_000, 412.0, None,
            ["run.mcap", "weeds.geojson"],
        ),
        _recording(
            "2026-05-03-171200-farm", "2026-05-03T17:12:00Z", 291_000_000, 701.2, True,
            ["run.mcap", "report.json"],
        ),
        _recording(
            "2026-05-02-093000-hills", "2026-05-02T09:30:00Z", 91_000_000, 150.0, False,
            ["run.mcap"], "No position for 5 s.",
        ),
    ],
)  # fmt: skip
CALIBRATIONS = wire.Calibrations(
    kinds=[
        wire.CalibrationKind(
            name=kind.name, title=kind.title, about=kind.about, ground=kind.ground,
            duration_s=round(kind.duration_s),
        )
        for kind in KINDS.values()
    ],
    now=None,
    found=None,
    file="robots/agribot.toml",
    settings=["calibration.wheel_radius_m=0.08912", "calibration.yaw_multiplier=1.4135"],
    broken="",
    can_undo=True,
)  # fmt: skip
HEALTH = wire.Health(
    checks=[
        _check("GNSS", "ok", "RTK fixed, 1.4 cm", "Fresh and accurate."),
        _check(
            "Camera", "warn", "11.8 Hz", "Slower than the 15 Hz it should give.",
            "Close other programs that use the camera.",
        ),
        _check("Disk", "ok", "81 GB free", "Room for 7 days."),
        _check(
            "Motors", "fault", "rear left", "No answer for 1.2 s.",
            "Check the cable of the rear left motor, then release STOP.",
        ),
    ],
    rates=[
        wire.SensorRate(topic="imu", expected_hz=100.0, measured_hz=99.8),
        wire.SensorRate(topic="camera", expected_hz=15.0, measured_hz=11.8),
        wire.SensorRate(topic="gnss", expected_hz=5.0, measured_hz=5.0),
    ],
    cpu_ratio=0.42,
    memory_bytes=412_000_000,
    server=wire.ServerCost(cpu_s=1.0, memory_bytes=90_000_000),
    log=[],
)  # fmt: skip
FIXED: dict[str, Any] = {
    "session": SESSION,
    "field": None,
    "robot": ROBOT,
    "maps": [],
    "views": ["Whole farm"],
    "fields": ["home-field"],
    "panels": [],
    "topics": [],
    "weeds.geojson": {"type": "FeatureCollection", "features": []},
    "recordings": RECORDINGS,
    "calibrations": CALIBRATIONS,
    "settings": wire.SettingGroups(groups=show_settings(config.load("farm"))),
    "health": HEALTH,
}


TILE_RGB = (30, 200, 220)
_file = io.BytesIO()
Image.new("RGB", (256, 256), TILE_RGB).save(_file, "PNG")
TILE = _file.getvalue()


def way(start: wire.Vec2, end: wire.Vec2) -> wire.GoalPreview:
    """Round a corner."""
    corner = (end[0], start[1])
    length_m = math.dist(start, corner) + math.dist(corner, end)
    return wire.GoalPreview(
        points_map_m=[start, corner, end], length_m=length_m, time_s=length_m / 0.8
    )


def plan() -> wire.PlanReply:
    reason = wire.FieldReason(text="Row 3 leaves the boundary by 0.4 m.", at_map_m=(12.0, 4.5))
    return wire.PlanReply(
        ok=False,
        reasons=[reason],
        length_m=412.0,
        area_m2=5120.0,
        time_s=590.0,
        warnings=[UNWORKED],
        path=[(72.7870533933, 21.1613331649), (72.78728, 21.16134), (72.78728, 21.16138)],
    )
