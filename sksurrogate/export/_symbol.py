"""Numbers that write down what is done to them: a right-hand side in numpy becomes nodes of a graph."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.export._graph import Graph


class Symbol:
    """One component of a graph under construction; numpy's functions call its methods."""

    __array_priority__ = 1000

    def __init__(self, graph: Graph, node: int):
        self.graph, self.node = graph, node

    def _other(self, value: Any) -> int:
        if isinstance(value, Symbol):
            return value.node
        return self.graph.constant(float(value))

    def _with(self, op: str, other: Any, swapped: bool = False) -> Any:
        if isinstance(other, np.ndarray):
            if other.ndim:
                return NotImplemented
            other = other.item()
        a, b = self.node, self._other(other)
        return Symbol(self.graph, self.graph.binary(op, *((b, a) if swapped else (a, b))))

    def __add__(self, other: Any) -> Any:
        return self._with("add", other)

    __radd__ = __add__

    def __mul__(self, other: Any) -> Any:
        return self._with("mul", other)

    __rmul__ = __mul__

    def __sub__(self, other: Any) -> Any:
        return self._with("sub", other)

    def __rsub__(self, other: Any) -> Any:
        return self._with("sub", other, True)

    def __truediv__(self, other: Any) -> Any:
        return self._with("div", other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with("div", other, True)

    def __pow__(self, other: Any) -> Any:
        if isinstance(other, Symbol):
            return (self.log() * other).exp()
        if other == 2:
            return self * self
        return self._with("pow", other)

    def __rpow__(self, other: Any) -> Any:
        return (self * float(np.log(other))).exp()

    def __neg__(self) -> Any:
        return self._with("mul", -1.0)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return self._unary("abs")

    def __bool__(self) -> bool:
        raise TypeError(
            "the simulator's functions branch on values, and a graph has no branches: write the branch with np.where, np.minimum, "
            "np.maximum, np.abs or np.tanh, or export the surrogate alone."
        )

    def __ge__(self, other: Any) -> Any:
        return self._with("ge", other)

    def __le__(self, other: Any) -> Any:
        return self._with("ge", other, True)

    def __gt__(self, other: Any) -> Any:
        return 1.0 - (self <= other)

    def __lt__(self, other: Any) -> Any:
        return 1.0 - (self >= other)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """``np.where`` and ``np.clip`` of components; other functions see them as objects."""
        if function is np.where and len(args) == 3:
            return _chosen(self.graph, *args)
        if function is np.clip:
            return np.minimum(np.maximum(args[0], args[1]), args[2])
        return function(*map(_as_objects, args), **{key: _as_objects(value) for key, value in kwargs.items()})

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Any:
        """numpy's elementwise functions on single components; arrays of components go through numpy's object loops."""
        if any(isinstance(v, np.ndarray) and v.ndim for v in inputs):
            loop = [np.asarray(v, dtype=object) if not isinstance(v, Symbol) else _boxed(v) for v in inputs]
            return ufunc(*loop)
        name = {"multiply": "mul", "divide": "div", "true_divide": "div", "subtract": "sub", "power": "pow",
                "maximum": "max", "minimum": "min", "absolute": "abs", "fabs": "abs", "float_power": "pow",
                "greater_equal": "ge", "less_equal": "le"}.get(ufunc.__name__, ufunc.__name__)  # fmt: skip
        one = next(v for v in inputs if isinstance(v, Symbol))
        if name == "negative":
            return -one
        if name in ("greater", "less", "le"):
            a, b = inputs if name != "less" else inputs[::-1]
            return 1.0 - np.less_equal(a, b) if name != "le" else np.greater_equal(b, a)
        if name == "square":
            return one * one
        if name == "pow":
            return inputs[0] ** inputs[1] if isinstance(inputs[0], Symbol) else one.__rpow__(inputs[0])
        if len(inputs) == 1 and hasattr(one, name):
            return getattr(one, name)()
        if len(inputs) == 2 and name in ("add", "sub", "mul", "div", "max", "min"):
            return one._with(name, inputs[1] if inputs[0] is one else inputs[0], inputs[0] is not one)
        raise TypeError(f"np.{ufunc.__name__} cannot be written as a graph: export the surrogate alone.")

    def _unary(self, op: str) -> Symbol:
        return Symbol(self.graph, self.graph.unary(op, self.node))

    def exp(self) -> Symbol:
        """e to the power of it."""
        return self._unary("exp")

    def log(self) -> Symbol:
        """Natural logarithm."""
        return self._unary("log")

    def sin(self) -> Symbol:
        """Sine."""
        return self._unary("sin")

    def cos(self) -> Symbol:
        """Cosine."""
        return self._unary("cos")

    def tan(self) -> Symbol:
        """Tangent."""
        return self._unary("tan")

    def tanh(self) -> Symbol:
        """Hyperbolic tangent."""
        return self._unary("tanh")

    def sqrt(self) -> Symbol:
        """Square root."""
        return self._unary("sqrt")

    def abs(self) -> Symbol:
        """Absolute value."""
        return self._unary("abs")

    def sign(self) -> Symbol:
        """Sign."""
        return self._unary("sign")

    def rint(self) -> Symbol:
        """The nearest whole number, halves to the even one."""
        return self._unary("round")


def _chosen(graph: Graph, condition: Any, yes: Any, no: Any) -> Any:
    """``np.where`` of single components."""
    if not isinstance(condition, Symbol):
        return np.where(condition, _as_objects(yes), _as_objects(no)).item()
    nodes = [v.node if isinstance(v, Symbol) else graph.constant(float(v)) for v in (condition, yes, no)]
    return Symbol(graph, graph.choose(*nodes))


def _boxed(value: Symbol) -> np.ndarray:
    box = np.empty((), dtype=object)
    box[()] = value
    return box


def _as_objects(value: Any) -> Any:
    """Symbols, also within lists and tuples, as arrays that numpy passes on."""
    if isinstance(value, Symbol):
        return _boxed(value)
    return type(value)(map(_as_objects, value)) if type(value) in (list, tuple) else value


def symbols(graph: Graph, node: int) -> np.ndarray:
    """The components of a node as an array of symbols (size,)."""
    out = np.empty(graph.nodes[node].size, dtype=object)
    for k in range(len(out)):
        out[k] = Symbol(graph, graph.take(node, [k]))
    return out


def joined(graph: Graph, values: Any) -> int:
    """Symbols and numbers as one vector."""
    return graph.concat(
        *(
            v.node if isinstance(v, Symbol) else graph.constant(float(v))
            for v in np.ravel(np.asarray(values, dtype=object))
        )
    )
