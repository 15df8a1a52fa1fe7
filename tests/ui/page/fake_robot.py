"""A robot for the tests of the page: drives rows, finds weeds, obeys; no physics, no clock."""

from __future__ import annotations

import io
import itertools
import math
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from agribot.core.messages import GateState, MissionState, PlantClass
from agribot.ui import wire

DATUM = wire.DatumPlace(lat_deg=21.1613331649, lon_deg=72.7870533933)
GNSS = wire.GnssState(lat_deg=DATUM.lat_deg, lon_deg=DATUM.lon_deg, quality=4, std_m=0.014)
ROWS = 6
ROW_LENGTH_M = 24.0
ROW_SPACING_M = 1.5
SPEED_MPS = 0.8
EPOCH = 1
SATELLITES = 32
MISSION_STATES: dict[wire.Mode, MissionState] = {
    "mission": "running",
    "paused": "paused",
    "stopped": "paused",
    "teleop": "paused",
    "waiting": "waiting",
    "done": "done",
}
GATE_STATES: dict[wire.Mode, GateState] = {
    "mission": "driving", "stopped": "stopped", "teleop": "by hand",
}  # fmt: skip
CHECKS = (
    "clock", "wheels and IMU", "battery", "motors", "bumper", "upright", "position", "heading",
    "field", "tool", "camera",
)  # fmt: skip
MODES_AFTER: dict[wire.MissionAction, wire.Mode] = {
    "pause": "paused",
    "resume": "mission",
    "start": "mission",
    "cancel": "done",
}


def make_receiver(**changed: Any) -> wire.ReceiverState:
    """A receiver with a sky of its own and corrections, on a serial line."""
    random = np.random.default_rng(11)
    satellites = [
        wire.SeenSatellite(
            system=("GP", "GL", "GA", "GB")[index % 4],
            number=index + 1,
            elevation_deg=int(5.0 + 80.0 * random.random() ** 1.5),
            azimuth_deg=int(random.integers(0, 360)),
            snr_db=int(random.integers(24, 50)) if index % 9 else 0,
            is_used=index % 3 > 0 and index % 9 > 0,
        )
        for index in range(SATELLITES)
    ]
    told: dict[str, Any] = {
        "epoch": EPOCH, "device": "serial:/dev/ttyACM0", "fix_age_s": 0.1, "quality": 4,
        "std_m": 0.014, "rate_hz": 10.0, "status_age_s": 1, "satellites": satellites,
        "used_count": sum(each.is_used for each in satellites), "in_view_count": SATELLITES,
        "hdop": 0.7, "pdop": 1.3, "vdop": 1.1, "correction_age_s": 0.8, "correction_hz": 5.0,
        "caster": "ntrip://caster.example:2101/NEAR", "caster_state": "connected",
    }  # fmt: skip
    return wire.ReceiverState(**(told | changed))


def field() -> wire.Field:
    ends = [((0.0, i * ROW_SPACING_M), (ROW_LENGTH_M, i * ROW_SPACING_M)) for i in range(ROWS)]
    top_m = (ROWS - 1) * ROW_SPACING_M
    return wire.Field(
        name="farm",
        datum=DATUM,
        datum_source="home",
        declination_deg=0.0,
        rows=[
            wire.FieldRow(
                index=i,
                start_map_m=start,
                end_map_m=end,
                curvature_radpm=0.0,
                points_map_m=[start, end],
            )
            for i, (start, end) in enumerate(ends)
        ],
        crop_map_m=[[start, end] for start, end in ends],
        boundary_map_m=[
            (-3.0, -3.0),
            (ROW_LENGTH_M + 3.0, -3.0),
            (ROW_LENGTH_M + 3.0, top_m + 3.0),
            (-3.0, top_m + 3.0),
        ],
        obstacles_map_m=[[(-1.6, 1.8), (-1.2, 1.8), (-1.2, 2.2), (-1.6, 2.2)]],
        waypoints_map_m=[point for pair in ends for point in pair],
        start_map_m=(-2.0, 0.0),
    )


def path() -> list[wire.Vec2]:
    points = [(-2.0, 0.0)]
    for i in range(ROWS):
        ends = [(0.0, i * ROW_SPACING_M), (ROW_LENGTH_M, i * ROW_SPACING_M)]
        points += ends if i % 2 == 0 else ends[::-1]
    return points


class FakeRobot:
    """Where the robot is at a time, its requests, and every command it was sent."""

    def __init__(self, weeds: int = 400) -> None:
        self.random = np.random.default_rng(7)
        self.n = 0
        self.t_s = 0.0
        self.s_m = 0.0
        self.mode: wire.Mode = "mission"
        self.stop = ""
        self.gate: wire.ShownGate | None = None  # else that of its mode
        self.checks = [wire.StartCheck(name=name) for name in CHECKS]
        self.doubts: list[wire.SensorDoubt] = []
        self.leg = "row 3"
        self.receiver = make_receiver()
        self.gnss: wire.GnssState | None = GNSS
        self.replay: wire.ReplayProgress | None = None
        self.calibration: wire.CalibrationProgress | None = None
        self.trajectory: list[wire.Vec2] = []
        self.commands: list[wire.PageMessage] = []
        self.path = path()
        self.leg_m = [math.dist(*leg) for leg in itertools.pairwise(self.path)]
        self.length_m = sum(self.leg_m)
        self.weeds = [self._weed(i) for i in range(weeds)]
        self.implement = [wire.ImplementLine(name="Nozzles", text="○●○")]

    def _weed(self, index: int) -> wire.Weed:
        is_crop = index % 5 == 0
        row = int(self.random.integers(ROWS))
        x_m = self.random.uniform(0, ROW_LENGTH_M)
        off_m = self.random.normal(0, 0.05 if is_crop else 0.35)
        confidence = float(self.random.uniform(0.5, 1))
        seen_s = float(index)
        return wire.Weed(
            id=index + 1,
            plant=PlantClass.CROP if is_crop else PlantClass.WEED,
            x_map_m=round(float(x_m), 3),
            y_map_m=round(float(row * ROW_SPACING_M + off_m), 3),
            std_m=0.03,
            confidence=confidence,
            area_m2=float(self.random.uniform(4e-4, 4e-3)),
            sightings=5,
            first_seen_s=seen_s,
            last_seen_s=seen_s + 1.0,
            treated_s=seen_s + 2.0 if index % 3 == 0 and not is_crop else None,
        )

    def pose(self) -> tuple[float, float, float]:
        left_m = self.s_m % self.length_m
        for start, end, leg_m in zip(self.path, self.path[1:], self.leg_m, strict=False):
            if left_m <= leg_m:
                share = left_m / leg_m
                dx, dy = end[0] - start[0], end[1] - start[1]
                return start[0] + share * dx, start[1] + share * dy, math.atan2(dy, dx)
            left_m -= leg_m
        return self.path[-1][0], self.path[-1][1], 0.0

    def step(self, dt_s: float) -> list[wire.Vec2]:
        """One tick; the trajectory points it added."""
        self.n += 1
        self.t_s += dt_s
        if self.mode == "mission":
            self.s_m += SPEED_MPS * dt_s
        x, y, _ = self.pose()
        last = self.trajectory[-1] if self.trajectory else None
        if last and math.dist(last, (x, y)) < 0.05:
            return []
        self.trajectory.append((round(x, 3), round(y, 3)))
        return self.trajectory[-1:]

    def obey(self, message: wire.PageMessage) -> wire.Verdict | None:
        """Note and carry out a command; the verdict on those that want one."""
        self.commands.append(message)
        if isinstance(message, wire.PressStop):
            self.mode, self.stop = "stopped", "pressed on the page"
        elif isinstance(message, wire.DriveByHand) and not self.stop:
            self.mode = "teleop" if message.v_mps or message.yaw_rate_radps else "paused"
        elif isinstance(message, wire.ClearStop):
            self.mode, self.stop = "paused", ""
        elif isinstance(message, wire.ControlMission):
            self.mode = MODES_AFTER.get(message.action, self.mode)
        if not isinstance(message, wire.Request) or not message.id:
            return None
        return wire.Verdict(id=message.id, ok=True)

    def state(self, mono_ms: float) -> wire.State:
        _, y_m, _ = self.pose()
        speed_mps = SPEED_MPS if self.mode == "mission" else 0.0
        row = min(ROWS - 1, int(y_m / ROW_SPACING_M + 0.5))
        wave = 0.04 * math.sin(self.t_s), 0.02 * math.cos(2 * self.t_s)
        return wire.State(
            tick=self.n,
            t_s=self.t_s,
            epoch=EPOCH,
            mono_ms=mono_ms,
            pose=self.pose(),
            pos_std_m=0.018,
            yaw_std_rad=0.01,
            v_mps=speed_mps,
            yaw_rate_radps=0.0,
            cross_track_m=0.021,
            joints_rad=[self.s_m / 0.15] * 4,
            tilt_rad=(0.02, -0.03),
            gnss=self.gnss,
            battery=wire.BatteryState(voltage_v=25.1, charge_pct=87.0),
            mission=self._mission(row),
            mode=self.mode,
            stop=self.stop,
            gate=self.gate
            or wire.ShownGate(state=GATE_STATES.get(self.mode, "standby"), since_s=0.0),
            checks=self.checks,
            doubts=self.doubts,
            implement=self.implement,
            weed_count=len(self.weeds),
            pace_ratio=1.0,
            recording="2026-05-03-171500-farm",
            replay=self.replay,
            calibration=self.calibration,
            signals=[[self.t_s, speed_mps, *wave, 24.6]],
        )

    def _mission(self, row: int) -> wire.MissionProgress:
        return wire.MissionProgress(
            state=MISSION_STATES[self.mode],
            row=row,
            rows_total=ROWS,
            rows_done=row,
            s_m=self.s_m,
            length_m=self.length_m,
            eta_s=(self.length_m - self.s_m) / SPEED_MPS,
            waypoints_total=2 * ROWS,
            waypoints_reached=2 * row,
            leg=self.leg,
        )

    def snapshot(self) -> wire.Snapshot:
        events = (
            wire.LogEvent(t_s=0.0, level="info", source="mission", text="Mission farm started."),
            wire.LogEvent(
                t_s=3.2, level="warn", source="gnss", text="Fix fell back to float for 0.8 s."
            ),
        )
        return wire.Snapshot(
            epoch=EPOCH,
            source="sim",
            name="",
            trace=wire.TracePiece(epoch=EPOCH, points_map_m=self.trajectory),
            weeds=wire.WeedChanges(epoch=EPOCH, set=self.weeds),
            path=wire.PathPiece(epoch=EPOCH, points_map_m=self.path, rows=[0] * len(self.path)),
            events=wire.NewEvents(epoch=EPOCH, events=list(events)),
            signals=wire.SignalTable(
                names=["speed", "cross_track", "heading_error", "battery"],
                units=["m/s", "m", "rad", "V"],
            ),
        )


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
    return wire.CAMERA_HEAD.pack(kind, 0, 0, frame, wall_ms) + file.getvalue()
