"""The settings of the run as parameters of the node: all to read, a few to change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from agribot.ros.ros2.services import load_service_types
from agribot.ros.ros2.serving import Reply, ServingNode

Value = bool | int | float | str | tuple[float, ...]
Change = Callable[[str, float], str]  # name and value; why not, or empty

# rcl_interfaces/ParameterType
_NOT_SET, _BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLE_ARRAY = 0, 1, 2, 3, 4, 8
_KIND: dict[type, int] = {
    bool: _BOOL, int: _INTEGER, float: _DOUBLE, str: _STRING, tuple: _DOUBLE_ARRAY,
}  # fmt: skip


class ParameterServer:
    """Serves the parameters; `change` applies the `changeable` ones, the others are read-only."""

    def __init__(
        self,
        server: ServingNode,
        node: str,
        values: Mapping[str, Value],
        changeable: frozenset[str],
        change: Change,
        *,
        about: Mapping[str, str] | None = None,
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        """Serve `values`; `about` describes them, `ranges` are limits for sliders."""
        self._about, self._ranges = dict(about or {}), dict(ranges or {})
        self._values, self._changeable, self._change = dict(values), changeable, change
        self._types = load_service_types()
        for name, answer in {
            "ListParameters": self._on_list,
            "GetParameters": self._on_get,
            "GetParameterTypes": self._on_get_types,
            "DescribeParameters": self._on_describe,
            "SetParameters": self._on_set,
            "SetParametersAtomically": self._on_set_all,
        }.items():
            topic = "".join(f"_{c.lower()}" if c.isupper() else c for c in name).strip("_")
            server.serve(self._types, f"/{node}/{topic}", f"rcl_interfaces/srv/{name}", answer)

    def update(self, name: str, value: Value) -> None:
        """Note that a value was changed from elsewhere."""
        self._values[name] = value

    def _on_list(self, request: Any, reply: Reply) -> None:
        wanted = tuple(f"{prefix}." for prefix in request.prefixes)
        names = [n for n in self._values if not wanted or n.startswith(wanted)]
        prefixes = sorted({name.rpartition(".")[0] for name in names} - {""})
        reply(self._types.types["rcl_interfaces/msg/ListParametersResult"](names, prefixes))

    def _on_get(self, request: Any, reply: Reply) -> None:
        reply([self._pack_value(self._values.get(name)) for name in request.names])

    def _on_get_types(self, request: Any, reply: Reply) -> None:
        kinds = [self._find_kind(name) for name in request.names]
        reply(np.array(kinds, dtype=np.uint8))

    def _on_describe(self, request: Any, reply: Reply) -> None:
        reply([self._describe(name) for name in request.names])

    def _describe(self, name: str) -> Any:
        make = self._types.types
        limits = [self._ranges[name]] if name in self._ranges else []
        return make["rcl_interfaces/msg/ParameterDescriptor"](
            name,
            self._find_kind(name),
            self._about.get(name, ""),
            "",
            name not in self._changeable,
            False,
            [make["rcl_interfaces/msg/FloatingPointRange"](*limit, 0.0) for limit in limits],
            [],
        )

    def _on_set(self, request: Any, reply: Reply) -> None:
        reply([self._make_result(self._set_one(parameter)) for parameter in request.parameters])

    def _on_set_all(self, request: Any, reply: Reply) -> None:
        """Change at most one parameter: two changes could not be atomic."""
        if len(request.parameters) > 1:
            why = "give one parameter at a time"
        else:
            why = "".join(self._set_one(parameter) for parameter in request.parameters)
        reply(self._make_result(why))

    def _set_one(self, parameter: Any) -> str:
        name, value = parameter.name, parameter.value
        if name not in self._values:
            return f"there is no parameter {name}"
        if name not in self._changeable:
            return f"{name} cannot be changed while the robot runs"
        number = {
            _BOOL: float(value.bool_value),
            _INTEGER: float(value.integer_value),
            _DOUBLE: float(value.double_value),
        }.get(value.type)
        if number is None:
            return f"{name} must be a number or true or false"
        why = self._change(name, number)
        if not why:
            before = self._values[name]
            self._values[name] = bool(number) if isinstance(before, bool) else number
        return why

    def _make_result(self, why: str) -> Any:
        return self._types.types["rcl_interfaces/msg/SetParametersResult"](not why, why)

    def _find_kind(self, name: str) -> int:
        return _KIND[type(self._values[name])] if name in self._values else _NOT_SET

    def _pack_value(self, value: Value | None) -> Any:
        kind = _NOT_SET if value is None else _KIND[type(value)]
        nothing = np.zeros(0)
        return self._types.types["rcl_interfaces/msg/ParameterValue"](
            kind,
            value if isinstance(value, bool) else False,
            value if isinstance(value, int) and kind == _INTEGER else 0,
            value if isinstance(value, float) else 0.0,
            value if isinstance(value, str) else "",
            np.zeros(0, np.uint8),
            nothing.astype(bool),
            nothing.astype(np.int64),
            np.array(value if isinstance(value, tuple) else ()),
            [],
        )
