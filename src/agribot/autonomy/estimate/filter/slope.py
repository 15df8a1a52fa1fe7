"""What a slope does to a robot that turns: how its heading goes, and how far it slides down."""

from __future__ import annotations

import math

from agribot.core.messages import Vec3

# Least level share of the nose's direction. Straight up it has no heading; a rover never comes near
# it.
LEAST_LEVEL_RATIO = 0.1
# Tilt that is as likely the bias of the IMU or the crumbs under a wheel.
LEVEL_SINE = math.sin(math.radians(2.0))
# Slide downhill per radian of turn and unit of slope: wheels that a turn drags sideways hold no
# side force. Shift of the turning centre per unit of slope towards the axle that carries more and
# holds better. Both in wheelbases and as measured in the simulator, at any speed and rate; the grip
# of soils differs.
SLIDE_WHEELBASES, CENTRE_WHEELBASES = 1.3, 1.3
# Error of the expected slide, 1 sigma, for a radian.
SLIDE_STD_RATIO = 0.5


def heading_rate_radps(gyro_radps: Vec3, up_body: Vec3) -> float:
    """Turn rate of the body's x axis seen from above; on a slope not that about the vertical."""
    level = max(1.0 - up_body[0] * up_body[0], LEAST_LEVEL_RATIO)
    return (gyro_radps[1] * up_body[1] + gyro_radps[2] * up_body[2]) / level


def project_from_above(distance_m: float, up_body: Vec3) -> float:
    """Project a distance along the body's x axis to the map."""
    return distance_m * math.sqrt(max(1.0 - up_body[0] * up_body[0], LEAST_LEVEL_RATIO))


def slide_m(turn_rad: float, up_body: Vec3, wheelbase_m: float) -> tuple[float, float]:
    """Predict how far a slope takes a robot forward and to its left while it turns."""
    x, y, _ = up_body
    if x * x + y * y < LEVEL_SINE * LEVEL_SINE:
        return 0.0, 0.0
    reach_m = SLIDE_WHEELBASES * wheelbase_m * abs(turn_rad)
    return -reach_m * x, -reach_m * y + CENTRE_WHEELBASES * wheelbase_m * turn_rad * x


def rotate(vector: Vec3, gyro_radps: Vec3, dt_s: float) -> Vec3:
    """Rotate a direction that stands still in the world with body axes that turned a little."""
    (x, y, z), (wx, wy, wz) = vector, gyro_radps
    return (
        x - dt_s * (wy * z - wz * y),
        y - dt_s * (wz * x - wx * z),
        z - dt_s * (wx * y - wy * x),
    )
