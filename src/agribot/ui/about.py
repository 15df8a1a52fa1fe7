"""What the page's server gets when it starts, and the number of a run or recording."""

from __future__ import annotations

import secrets

import msgspec

from agribot.core.config import RunConfig
from agribot.core.robot import RobotSpec
from agribot.ui import wire

EPOCH_BITS = 32


class RosPlaces(msgspec.Struct, frozen=True, kw_only=True):
    """Where the page looks for topics when somebody asks for them."""

    master: str = "http://127.0.0.1:11311"
    router: str = "tcp/127.0.0.1:7447"
    domain: int = 0
    layers_from: tuple[str, ...] = ()  # networks whose programs may add layers


class About(msgspec.Struct, kw_only=True):
    """What the server gets once, when it starts."""

    host: str
    port: int
    names: tuple[str, ...]
    operator_token: str
    viewer_token: str
    session_key: str
    profile: str
    source: str
    field: wire.Field
    robot: wire.Robot
    urdf: str
    meshes: dict[str, str]
    settings: list[wire.SettingGroup]
    rates: dict[str, float]
    runs_dir: str
    current: str
    home_dir: str
    page_dir: str
    config: RunConfig
    robot_spec: RobotSpec
    recording: str = ""
    lan_url: str = ""
    tls_cert: str = ""
    tls_key: str = ""
    ros: RosPlaces = RosPlaces()
    run_id: int = 0  # the same for all server processes of a run


def make_epoch() -> int:
    """Make a number that nothing else has that is or was shown at this address."""
    return secrets.randbits(EPOCH_BITS)
