"""Bounds for the expressions of xacro files, so that nested powers are refused."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sized
from contextlib import contextmanager
from typing import Any

import xacro
import xacro.substitution_args as substitution

MAX_BITS = 4096  # bits of a whole number; those of robots have about 50
MAX_ITEMS = 100_000  # length of a text or list that is repeated
MAX_EXPONENT = 64  # exponent that $(eval ...) may write


def raise_to_power(base: Any, exponent: Any) -> Any:
    is_whole = isinstance(base, int) and isinstance(exponent, int)
    if is_whole and exponent > 0 and base.bit_length() * exponent > MAX_BITS:
        raise ValueError(f"a power with more than {MAX_BITS} bits; write it as a decimal number")
    return base**exponent


def shift(value: Any, places: Any) -> Any:
    if isinstance(places, int) and places > MAX_BITS:
        raise ValueError(f"a shift by {places} bits, more than {MAX_BITS}")
    return value << places


def multiply(left: Any, right: Any) -> Any:
    for many, count in ((left, right), (right, left)):
        if isinstance(many, Sized) and isinstance(count, int) and len(many) * count > MAX_ITEMS:
            raise ValueError(f"a text or list repeated to more than {MAX_ITEMS} items")
    return left * right


# Names that an expression cannot write itself: xacro refuses those that begin so.
_GUARDS = {"__power": raise_to_power, "__shift": shift, "__multiply": multiply}
_GUARD_OF = {ast.Pow: "__power", ast.LShift: "__shift", ast.Mult: "__multiply"}


class _OperatorGuard(ast.NodeTransformer):
    """Replaces operators by calls of the guards."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        guard = _GUARD_OF.get(type(node.op))
        if guard is None:
            return node
        name = ast.Name(id=guard, ctx=ast.Load())
        return ast.copy_location(ast.Call(name, [node.left, node.right], []), node)


def evaluate(expression: str, symbols: dict[str, Any], names: Any = None) -> Any:
    """Evaluate an expression in the place of xacro's own function; refuse the same names.

    Raises: ValueError: a number or text that would grow beyond the limits.
    """
    tree = ast.parse(expression.strip(), mode="eval")
    used = compile(tree, "<expression>", "eval").co_names
    forbidden = [name for name in used if name.startswith("__")]
    if forbidden:
        raise xacro.XacroException("Use of invalid name(s): ", ", ".join(forbidden))
    guarded = ast.fix_missing_locations(_OperatorGuard().visit(tree))
    symbols.update(__builtins__=_GUARDS)
    return eval(compile(guarded, "<expression>", "eval"), symbols, names)


def _check_substitution(text: str) -> None:
    """Check an expression of `$(eval ...)`.

    Raises: ValueError: an operator that may grow without limit.
    """
    for node in ast.walk(ast.parse(text.strip(), mode="eval")):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow | ast.LShift):
            by = node.right
            if not (isinstance(by, ast.Constant) and isinstance(by.value, int | float)
                    and by.value <= MAX_EXPONENT):  # fmt: skip
                raise ValueError(f"$(eval {text}): an exponent must be a number to {MAX_EXPONENT}")


@contextmanager
def bound_arithmetic() -> Iterator[None]:
    """Keep xacro's expressions within the limits, while open."""
    evaluate_freely, substitute = xacro.safe_eval, substitution._eval

    def substitute_bounded(text: str, context: Any) -> Any:
        _check_substitution(text)
        return substitute(text, context)

    xacro.safe_eval, substitution._eval = evaluate, substitute_bounded
    try:
        yield
    finally:
        xacro.safe_eval, substitution._eval = evaluate_freely, substitute
