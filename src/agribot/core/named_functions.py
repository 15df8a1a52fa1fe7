"""Functions that a table or a setting names as "module:function"."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from agribot.core.errors import ConfigError


def find_function(target: Callable[..., Any] | str, what: str) -> Callable[..., Any]:
    """Return a function as it is, or import the one that "module:function" names.

    `what` names in an error the setting that wanted it, such as "platform = 'my_robot:open'".

    Raises: ConfigError: there is no such function.
    """
    if not isinstance(target, str):
        return target
    module_name, _, name = target.partition(":")
    try:
        found = getattr(import_module(module_name), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(
            f"{what}: {error}; write module:function of an installed module"
        ) from error
    if not callable(found):
        kind = type(found).__name__
        raise ConfigError(f"{what} is not a function but {kind}; write module:function")
    function: Callable[..., Any] = found
    return function
