"""The instructions of a CasADi function on arrays of points: handing matrices over to CasADi takes longer than what it computes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.special import erf

from sksurrogate.exceptions import require


def _as_number(test: Callable[..., Any], *given: Any) -> Any:
    """Whether a test holds, as a number."""
    return 1.0 * test(*given)


#: Instructions of one result, by their names in CasADi.
_OPERATIONS: dict[str, Callable[..., Any]] = {
    "ASSIGN": lambda x: x, "LIFT": lambda x, y: x, "ADD": np.add, "SUB": np.subtract, "MUL": np.multiply, "DIV": np.divide,
    "NEG": np.negative, "TWICE": lambda x: 2.0 * x, "SQ": np.square, "INV": np.reciprocal, "SQRT": np.sqrt, "POW": np.power,
    "CONSTPOW": np.power, "EXP": np.exp, "EXPM1": np.expm1, "LOG": np.log, "LOG1P": np.log1p, "FABS": np.abs, "SIGN": np.sign,
    "COPYSIGN": np.copysign, "FLOOR": np.floor, "CEIL": np.ceil, "FMOD": np.fmod, "FMIN": np.fmin, "FMAX": np.fmax,
    "HYPOT": np.hypot, "ERF": erf, "SIN": np.sin, "COS": np.cos, "TAN": np.tan, "ASIN": np.arcsin, "ACOS": np.arccos,
    "ATAN": np.arctan, "ATAN2": np.arctan2, "SINH": np.sinh, "COSH": np.cosh, "TANH": np.tanh, "ASINH": np.arcsinh,
    "ACOSH": np.arccosh, "ATANH": np.arctanh,
    "IF_ELSE_ZERO": lambda x, y: np.where(x != 0, y, 0.0),
}  # fmt: skip
#: Those that are 0.0 or 1.0.
_TESTS: dict[str, Callable[..., Any]] = {
    "LT": np.less, "LE": np.less_equal, "EQ": np.equal, "NE": np.not_equal, "NOT": np.logical_not, "AND": np.logical_and,
    "OR": np.logical_or,
}  # fmt: skip
_OPERATIONS |= {name: partial(_as_number, test) for name, test in _TESTS.items()}
#: Points from which on a call of numpy for every instruction pays.
MANY_POINTS = 64


class Tape:
    """A function whose instructions are all known, at points.

    ``function``: of scalar instructions, with dense inputs and outputs.
    """

    def __init__(self, function: Any):
        ca = require("casadi", "casadi")
        names = {getattr(ca, f"OP_{name}"): operation for name, operation in _OPERATIONS.items()}
        self.size, self.outputs = function.sz_w(), [function.numel_out(i) for i in range(function.n_out())]
        self.lines: list[tuple[Callable[..., Any] | None, list[int], list[int], float]] = []
        for k in range(function.n_instructions()):
            kind, given, found = (
                function.instruction_id(k),
                function.instruction_input(k),
                function.instruction_output(k),
            )
            if kind == ca.OP_CONST:
                self.lines.append((None, [], found, float(function.instruction_constant(k))))
            elif kind == ca.OP_INPUT:
                self.lines.append((None, given, found, np.nan))
            elif kind == ca.OP_OUTPUT:
                self.lines.append(
                    (names[ca.OP_ASSIGN], given, [self.size + sum(self.outputs[: found[0]]) + found[1]], np.nan)
                )
            else:
                self.lines.append((names[kind], given, found, np.nan))

    def __call__(self, place: int, arguments: Sequence[np.ndarray], n_points: int) -> np.ndarray:
        """Output ``place`` at points, of arguments (n, n_points): (n_out, n_points)."""
        work: list[Any] = [None] * (self.size + sum(self.outputs))
        with np.errstate(all="ignore"):
            for operation, given, found, constant in self.lines:
                if operation is not None:
                    work[found[0]] = operation(*(work[i] for i in given))
                else:
                    work[found[0]] = arguments[given[0]][given[1]] if given else constant
        first = self.size + sum(self.outputs[:place])
        out = np.empty((self.outputs[place], n_points))
        for row, value in zip(out, work[first:]):
            row[:] = value
        return out


def tape_of(function: Any) -> Tape | None:
    """The instructions of a function, or of what it expands to; None where it calls what has none (a solver, an external function)."""
    sizes = [(function.nnz_in(i), function.numel_in(i)) for i in range(function.n_in())]
    sizes += [(function.nnz_out(i), function.numel_out(i)) for i in range(function.n_out())]
    if any(filled != whole for filled, whole in sizes):
        return None
    try:
        return Tape(function if function.is_a("SXFunction") else function.expand())
    except (RuntimeError, KeyError):  # not made of scalar instructions, or of one that is not known
        return None
