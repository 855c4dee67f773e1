"""One evaluation of a graph without any package: this file is copied into exported FMUs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def _safe(function: Callable[..., float]) -> Callable[..., float]:
    """As IEEE arithmetic answers, instead of an exception."""

    def answered(*values: float) -> float:
        try:
            return function(*values)
        except (ZeroDivisionError, ValueError):
            return math.nan
        except OverflowError:
            return math.inf

    return answered


def _divide(a: float, b: float) -> float:
    if b == 0.0:
        return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)
    return a / b


ONE: dict[str, Callable[[float], float]] = {
    "tanh": math.tanh,
    "logistic": lambda x: 0.5 + 0.5 * math.tanh(0.5 * x),
    "relu": lambda x: max(x, 0.0),
    "exp": math.exp,
    "log": lambda x: -math.inf if x == 0.0 else math.log(x),
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "sqrt": math.sqrt,
    "abs": abs,
    "sign": lambda x: float((x > 0) - (x < 0)),
    "round": lambda x: float(round(x)),
}
TWO: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": _divide,
    "pow": math.pow,
    "max": lambda a, b: max(a, b) if a == a and b == b else math.nan,
    "min": lambda a, b: min(a, b) if a == a and b == b else math.nan,
    "ge": lambda a, b: float(a >= b),
}


def _stretched(parts: Sequence[list[float]]) -> list[list[float]]:
    """One component meets all of the others."""
    n = max(map(len, parts))
    return [part * n if len(part) == 1 else part for part in parts]


def evaluate(nodes: Sequence[Sequence[Any]], given: Mapping[str, Sequence[float]]) -> list[list[float]]:
    """Values of all nodes ``(op, args, data)`` of a graph.

    >>> nodes = [["input", [], ["x"]], ["constant", [], [[2.0]]], ["pow", [0, 1], []]]
    >>> evaluate(nodes, {"x": [3.0, -1.0]})[-1]
    [9.0, 1.0]
    """
    values: list[list[float]] = []
    for op, args, data in nodes:
        parts = [values[k] for k in args]
        if op == "input":
            out = list(given[data[0]])
        elif op == "constant":
            out = data[0]
        elif op == "affine":
            out = [b + sum(map(float.__mul__, parts[0], w)) for w, b in zip(data[0], data[1])]
        elif op == "concat":
            out = [value for part in parts for value in part]
        elif op == "take":
            out = [parts[0][k] for k in data[0]]
        elif op == "peak":
            out = [max(parts[0])]
        elif op == "choose":
            out = [yes if condition != 0 else no for condition, yes, no in zip(*_stretched(parts))]
        elif op in ONE:
            out = list(map(_safe(ONE[op]), parts[0]))
        else:
            out = [_safe(TWO[op])(a, b) for a, b in zip(*_stretched(parts))]
        values.append(out)
    return values
