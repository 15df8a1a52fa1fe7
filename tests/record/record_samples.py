"""A made-up robot and a made-up run for the tests of recording and report."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.messages import (
    WHEEL_NAMES,
    BaseFix,
    BatterySample,
    BumperSample,
    CameraFrame,
    ControlMission,
    DriveCommand,
    Estimate,
    GnssFix,
    GnssQuality,
    GnssStatus,
    GroundPlant,
    ImplementCommand,
    ImuSample,
    MagSample,
    MappedPlant,
    MissionState,
    MissionStatus,
    Path,
    PlantClass,
    RobotCommand,
    Row,
    Satellite,
    Scene,
    SensorBatch,
    TickRecord,
    Tracking,
    WheelSample,
)
from agribot.core.robot import (
    CameraSpec,
    Joint,
    Link,
    Origin,
    RobotSpec,
    SensorMount,
    TyreSpec,
)
from tests.asking import ask
from tests.robot_parts import change_drive, make_wheels

URDF = '<robot name="made_up"><link name="base_link"/></robot>'
SPEED_MPS = 0.4


def robot(with_camera: bool = True) -> RobotSpec:
    fixed = {
        "base_link": ("dummy_link", Origin()),
        "imu_link": ("base_link", Origin(xyz_m=(0.1, 0.0, 0.2))),
        "gps_link": ("base_link", Origin(xyz_m=(0.0, 0.0, 0.6))),
        "camera_link": ("base_link", Origin(xyz_m=(0.4, 0.0, 0.5), rpy_rad=(0.0, 0.9, 0.0))),
    }
    joints = [
        Joint(name=f"{child}_joint", kind="fixed", parent=parent, child=child, origin=origin)
        for child, (parent, origin) in fixed.items()
    ]
    joints += make_wheels(0.3, 0.39, -0.1, axis=(0.0, 1.0, 0.0))
    camera = CameraSpec(
        link="camera_link", width_px=64, height_px=48, hfov_rad=1.4, rate_hz=10.0,
        noise_std=0.0, clip_near_m=0.02, clip_far_m=300.0,
    )  # fmt: skip
    return RobotSpec(
        name="made_up",
        links=tuple(Link(name=name) for name in ("dummy_link", *fixed, *WHEEL_NAMES)),
        joints=tuple(joints),
        drive=change_drive(
            wheel_radius_m=0.09, track_m=0.78, wheelbase_m=0.6, plugin_diameter_m=0.2,
            yaw_multiplier=1.6, torque_nm=20.0, max_yaw_rate_radps=1.2, max_accel_mps2=1.0,
            max_yaw_accel_radps2=3.0, servo_gain_nmspr=10.0,
        ),
        tyre=TyreSpec(),
        imu=SensorMount(link="imu_link", rate_hz=200.0),
        gnss=SensorMount(link="gps_link", rate_hz=10.0),
        mag=SensorMount(link="imu_link", rate_hz=20.0),
        camera=camera if with_camera else None,
    )  # fmt: skip


def rows() -> tuple[Row, ...]:
    return tuple(
        Row(index=i, start_map_m=(1.0 + i, 2.0), end_map_m=(1.0 + i, 12.0)) for i in range(6)
    )


def plan() -> Path:
    """North along row 0, then a quarter turn's worth of nothing: a straight path is enough."""
    s_m = np.arange(0.0, 10.001, 0.02)
    return Path(
        xy_map_m=np.column_stack([np.full_like(s_m, 1.0), 2.0 + s_m]),
        yaw_map_rad=np.full_like(s_m, math.pi / 2),
        curvature_radpm=np.zeros_like(s_m),
        row=np.zeros(len(s_m), dtype=np.int64),
        s_m=s_m,
    )


def status(
    state: MissionState = "running", row: int = 0, s_m: float = 0.0, reason: str = ""
) -> MissionStatus:
    return MissionStatus(
        state=state, reason=reason, row=row, rows_total=6, rows_done=tuple(range(max(row, 0))),
        s_m=s_m, length_m=10.0, waypoints_total=12, waypoints_reached=int(s_m >= 10.0),
        goal_map_m=(1.0, 2.0),
    )  # fmt: skip


def estimate(t_s: float, noise: np.random.Generator | None = None) -> Estimate:
    jitter = noise.normal(0.0, 0.01, 3) if noise is not None else np.zeros(3)
    return Estimate(
        t_s=t_s, x_map_m=1.0 + float(jitter[0]), y_map_m=2.0 + SPEED_MPS * t_s + float(jitter[1]),
        yaw_map_rad=math.pi / 2 + float(jitter[2]), v_mps=SPEED_MPS, yaw_rate_radps=0.01,
        slip_rad=0.0, pose_cov=(4e-4, 1e-5, 0.0, 1e-5, 4e-4, 0.0, 0.0, 0.0, 1e-4),
        pos_std_m=0.02, yaw_std_rad=0.01, quality=GnssQuality.RTK_FIXED, ok=True,
    )  # fmt: skip


def unplaced(record: TickRecord) -> TickRecord:
    """The same before the first fix: at the origin, to a kilometre."""
    cov = (1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 10.0)
    nowhere = msgspec.structs.replace(
        record.estimate, ok=False, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, pose_cov=cov,
        pos_std_m=1e3, yaw_std_rad=math.sqrt(10.0),
    )  # fmt: skip
    return msgspec.structs.replace(record, estimate=nowhere)


def tick(index: int, noise: np.random.Generator, with_camera: bool = False) -> TickRecord:
    """50 Hz ticks with 200 Hz IMU, 100 Hz wheels, 20 Hz magnetometer, 10 Hz GNSS and camera."""
    t_s = (index + 1) * 0.02
    batch = SensorBatch(
        t_s=t_s,
        wheels=tuple(
            WheelSample(
                t_s=t_s - 0.01 * k,
                angle_rad=tuple((noise.normal(0.0, 0.01, 4) + 4.4 * t_s).tolist()),
                speed_radps=tuple(noise.normal(4.4, 0.02, 4).tolist()),
            )
            for k in (1, 0)
        ),
        imu=tuple(
            ImuSample(
                t_s=t_s - 0.005 * k,
                gyro_radps=tuple(noise.normal(0.0, 0.01, 3).tolist()),
                accel_mps2=tuple(noise.normal((0.0, 0.0, 9.8), 0.1).tolist()),
            )
            for k in (3, 2, 1, 0)
        ),
        mag=(MagSample(t_s=t_s, field_t=(3.8e-5, 1e-6, -2.3e-5)),) if index % 5 in (0, 2) else (),
        gnss=(_fix(t_s, noise),) if index % 5 == 0 else (),
        gnss_status=(_sky(t_s),) if index % 5 == 0 else (),
        frames=(frame(index, t_s),) if with_camera and index % 5 == 0 else (),
        requests=(ask(ControlMission(action="pause"), t_s=t_s),) if index == 7 else (),
        base=(base_fix(t_s),) if index % 10 == 0 else (),
        bumper=(BumperSample(t_s=t_s, x_body_m=0.35, y_body_m=-0.1),) if index % 20 == 9 else (),
        battery=(battery(t_s),) if index % 50 == 0 else (),
    )
    return TickRecord(
        batch=batch,
        scenes=(scene(index - 10, t_s),) if with_camera and index >= 10 and index % 5 == 0 else (),
        estimate=estimate(t_s, noise),
        status=status(s_m=min(10.0, SPEED_MPS * t_s)),
        tracking=Tracking(
            s_m=SPEED_MPS * t_s,
            cross_track_m=float(noise.normal(0.0, 0.01)),
            heading_error_rad=float(noise.normal(0.0, 0.01)),
        ),
        command=RobotCommand(
            t_s=t_s,
            drive=DriveCommand(v_mps=SPEED_MPS, yaw_rate_radps=0.01),
            implement=ImplementCommand(sections_on=(False, True, False)),
        ),
    )


def base_fix(t_s: float) -> BaseFix:
    return BaseFix(
        t_s=t_s, lat_deg=21.1613, lon_deg=72.78703, alt_m=9.5, pos_std_m=1.5,
        known_lat_deg=21.161289, known_lon_deg=72.787022, known_alt_m=10.0,
        velocity_mps=(0.01, -0.02, 0.0),
    )  # fmt: skip


def battery(t_s: float) -> BatterySample:
    return BatterySample(t_s=t_s, voltage_v=24.5, current_a=1.25, charge_ratio=0.9)


def ticks(count: int, seed: int = 0, with_camera: bool = False) -> list[TickRecord]:
    noise = np.random.default_rng(seed)
    return [tick(index, noise, with_camera) for index in range(count)]


def without_frames(record: TickRecord) -> TickRecord:
    """For comparing: arrays have no plain equality."""
    return msgspec.structs.replace(record, batch=msgspec.structs.replace(record.batch, frames=()))


def frame(index: int, t_s: float) -> CameraFrame:
    image = np.full((48, 64, 3), (110, 85, 60), dtype=np.uint8)
    image[20:28, 28:36] = (60, 140, 50)
    return CameraFrame(t_s=t_s, index=index, image_rgb=image)


def scene(frame_index: int, ready_s: float) -> Scene:
    weed = GroundPlant(
        x_body_m=0.9, y_body_m=0.05, plant=PlantClass.WEED, area_m2=2e-3, confidence=0.9, std_m=0.01
    )
    return Scene(
        t_s=ready_s - 0.2,
        ready_s=ready_s,
        frame_index=frame_index,
        plants=(weed,),
        view_body_m=((0.5, -0.4), (0.5, 0.4), (1.5, 0.6), (1.5, -0.6)),
        class_ratio=(0.01, 0.02, 0.97),
    )


def plant(
    number: int, kind: PlantClass = PlantClass.WEED, treated_s: float | None = None
) -> MappedPlant:
    return MappedPlant(
        id=number, plant=kind, x_map_m=1.05 + 0.1 * number, y_map_m=3.0 + 0.7 * number,
        cov_m2=(1e-4, 2e-5, 2e-5, 3e-4), area_m2=1.5e-3, confidence=0.93, sightings=5,
        first_seen_s=1.0 + number, last_seen_s=3.0 + number, treated_s=treated_s,
    )  # fmt: skip


def _sky(t_s: float) -> GnssStatus:
    seen = Satellite(
        system="GP", number=5, elevation_deg=71.0, azimuth_deg=210.0, snr_db=44.0, is_used=True
    )
    return GnssStatus(t_s=t_s, satellites=(seen,), hdop=0.9, correction_counts=((1005, 3),))


def _fix(t_s: float, noise: np.random.Generator) -> GnssFix:
    return GnssFix(
        t_s=t_s - 0.05,
        lat_deg=21.161289 + float(noise.normal(0.0, 1e-7)),
        lon_deg=72.787022,
        alt_m=4.5,
        pos_std_m=0.02,
        quality=GnssQuality.RTK_FIXED,
        velocity_mps=(0.0, SPEED_MPS, 0.0),
    )
