"""The types of dynamic_reconfigure, which tools such as rqt_reconfigure speak."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.decoding import make_undecodable
from agribot.ros.ros1.service_server import ServiceType

PACKAGE = "dynamic_reconfigure/msg"
CONFIG, DESCRIPTION = f"{PACKAGE}/Config", f"{PACKAGE}/ConfigDescription"
GROUP = "Default"
# Fields on the wire, as every program that speaks it lists them.
_TEXTS = {
    "BoolParameter": "string name\nbool value\n",
    "IntParameter": "string name\nint32 value\n",
    "StrParameter": "string name\nstring value\n",
    "DoubleParameter": "string name\nfloat64 value\n",
    "GroupState": "string name\nbool state\nint32 id\nint32 parent\n",
    "Config": "BoolParameter[] bools\nIntParameter[] ints\nStrParameter[] strs\n"
    "DoubleParameter[] doubles\nGroupState[] groups\n",
    "ParamDescription": "string name\nstring type\nuint32 level\nstring description\n"
    "string edit_method\n",
    "Group": "string name\nstring type\nParamDescription[] parameters\nint32 parent\nint32 id\n",
    "ConfigDescription": "Group[] groups\nConfig max\nConfig min\nConfig dflt\n",
}


class ConfigService(ServiceType):
    """`set_parameters`: a Config in, the Config that now holds out."""

    __slots__ = ()

    @property
    def md5(self) -> str:
        """The sum of a type whose fields are messages: their own sums stand for them."""
        _, config = load_reconfigure_types().generate_msgdef(CONFIG, ros_version=1)
        text = f"{config} config"
        return hashlib.md5((text + text).encode(), usedforsecurity=False).hexdigest()


SET_PARAMETERS = ConfigService("dynamic_reconfigure/Reconfigure", "Config config", "Config config")


@functools.cache
def load_reconfigure_types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in _TEXTS.items():
        store.register(get_types_from_msg(text, f"{PACKAGE}/{name}"))
    return store


def make_config(values: Mapping[str, float]) -> Any:
    """Make a Config of numbers."""
    make = load_reconfigure_types().types
    doubles = [make[f"{PACKAGE}/DoubleParameter"](name, float(v)) for name, v in values.items()]
    state = make[f"{PACKAGE}/GroupState"](GROUP, True, 0, 0)
    return make[CONFIG]([], [], [], doubles, [state])


def make_description(
    about: Mapping[str, str],
    ranges: Mapping[str, tuple[float, float]],
    defaults: Mapping[str, float],
) -> Any:
    """Make a ConfigDescription of numbers with a line about each, their limits and defaults."""
    make = load_reconfigure_types().types
    parameters = [
        make[f"{PACKAGE}/ParamDescription"](name, "double", 0, text, "")
        for name, text in about.items()
    ]
    group = make[f"{PACKAGE}/Group"](GROUP, "", parameters, 0, 0)
    return make[DESCRIPTION](
        [group],
        make_config({name: largest for name, (_, largest) in ranges.items()}),
        make_config({name: smallest for name, (smallest, _) in ranges.items()}),
        make_config(defaults),
    )


def encode(message: Any) -> bytes:
    return bytes(load_reconfigure_types().serialize_ros1(message, message.__msgtype__))


def read_config(data: bytes) -> dict[str, float]:
    """Read the numbers of a Config, whole ones and truth values as well.

    Raises: BridgeError: the bytes are no Config.
    """
    try:
        config: Any = load_reconfigure_types().deserialize_ros1(data, CONFIG)
    except Exception as error:  # the generated code of rosbags raises any error
        raise make_undecodable(data, "dynamic_reconfigure/Config") from error
    return {
        parameter.name: float(parameter.value)
        for parameter in (*config.bools, *config.ints, *config.doubles)
    }
