"""A model as a small graph of vector operations: plain numpy, exact Jacobians, and one place for every exporter to read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


def _logistic(x: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


#: name -> (value, slope from x and value)
UNARY: dict[str, tuple[Callable[..., Any], Callable[[Any, Any], Any]]] = {
    "tanh": (np.tanh, lambda x, y: 1.0 - y * y),
    "logistic": (_logistic, lambda x, y: y * (1.0 - y)),
    "relu": (lambda x: np.maximum(x, 0.0), lambda x, y: (x > 0) * 1.0),
    "exp": (np.exp, lambda x, y: y),
    "log": (np.log, lambda x, y: 1.0 / x),
    "sin": (np.sin, lambda x, y: np.cos(x)),
    "cos": (np.cos, lambda x, y: -np.sin(x)),
    "tan": (np.tan, lambda x, y: 1.0 + y * y),
    "sqrt": (np.sqrt, lambda x, y: 0.5 / y),
    "abs": (np.abs, lambda x, y: np.sign(x)),
    "sign": (np.sign, lambda x, y: 0.0 * x),
    "round": (np.round, lambda x, y: 0.0 * x),
}

#: name -> (value, slopes by both from x, y and value)
BINARY: dict[str, tuple[Callable[..., Any], Callable[[Any, Any, Any], tuple[Any, Any]]]] = {
    "add": (np.add, lambda a, b, y: (1.0, 1.0)),
    "sub": (np.subtract, lambda a, b, y: (1.0, -1.0)),
    "mul": (np.multiply, lambda a, b, y: (b, a)),
    "div": (np.divide, lambda a, b, y: (1.0 / b, -y / b)),
    "pow": (np.power, lambda a, b, y: (b * np.power(a, b - 1.0), 0.0)),
    "max": (np.maximum, lambda a, b, y: ((a >= b) * 1.0, (a < b) * 1.0)),
    "min": (np.minimum, lambda a, b, y: ((a <= b) * 1.0, (a > b) * 1.0)),
    "ge": (lambda a, b: (a >= b) * 1.0, lambda a, b, y: (0.0, 0.0)),
}


@dataclass(frozen=True, eq=False)
class Node:
    """One operation: ``op`` on earlier nodes."""

    #: "input", "constant", "affine" (``x W + b``), "concat", "take" (components), "peak" (largest component), "choose"
    #: (one component that is 0 or not, then two vectors: the first where it is not 0), or a name in ``UNARY`` or
    #: ``BINARY``; the exponent of "pow" is a constant
    op: str
    args: tuple[int, ...]
    size: int  #: Components
    data: tuple[Any, ...] = ()  #: Numbers that belong to it


@dataclass(eq=False)
class Graph:
    """Inputs and outputs by name, nodes in the order of their making.

    Attributes
    ----------
    nodes : list of Node
    inputs, outputs : dict of name -> number of the node
    initial : ndarray or None
        For recursive models: a state to start from.
    dt : float or None
        Sample time of recursive models.
    states : list of str or None
        Names of the components of "x", where the model names them.
    signals : pair of list of str or None
        Names of the components of "u" and of "y".

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.export import Graph
    >>> graph = Graph()
    >>> x = graph.input("x", 2)
    >>> graph.outputs["y"] = graph.unary("tanh", graph.affine(x, np.ones((2, 1)), np.zeros(1)))
    >>> graph(x=[0.1, 0.2])["y"].round(4)
    array([0.2913])
    >>> graph.jacobian(x=[0.1, 0.2])["y", "x"].round(4)
    array([[0.9151, 0.9151]])
    """

    nodes: list[Node] = field(default_factory=list)
    inputs: dict[str, int] = field(default_factory=dict)
    outputs: dict[str, int] = field(default_factory=dict)
    initial: np.ndarray | None = None
    dt: float | None = None
    states: list[str] | None = None
    signals: tuple[list[str], list[str]] | None = None

    # ---- building ---------------------------------------------------------------------------------------------------
    def _add(self, op: str, args: tuple[int, ...], size: int, *data: Any) -> int:
        self.nodes.append(Node(op, args, size, data))
        return len(self.nodes) - 1

    def input(self, name: str, size: int) -> int:
        """A vector that the caller gives."""
        self.inputs[name] = self._add("input", (), size, name)
        return self.inputs[name]

    def constant(self, value: Any) -> int:
        """A fixed vector."""
        fixed = np.atleast_1d(np.asarray(value, dtype=float)).ravel()
        return self._add("constant", (), len(fixed), fixed)

    def affine(self, x: int, weight: Any, bias: Any = 0.0) -> int:
        """``x W + b`` with W (n_in, n_out)."""
        weight = np.asarray(weight, dtype=float)
        bias = np.broadcast_to(np.asarray(bias, dtype=float), (weight.shape[1],)).copy()
        return self._add("affine", (x,), weight.shape[1], weight, bias)

    def unary(self, op: str, x: int) -> int:
        """An elementwise function."""
        return self._add(op, (x,), self.nodes[x].size)

    def binary(self, op: str, a: int, b: int) -> int:
        """An elementwise operation; one component meets all of the other."""
        return self._add(op, (a, b), max(self.nodes[a].size, self.nodes[b].size))

    def concat(self, *parts: int) -> int:
        """Vectors one after the other."""
        parts = tuple(p for p in parts if self.nodes[p].size)
        sizes = [self.nodes[p].size for p in parts]
        return parts[0] if len(parts) == 1 else self._add("concat", parts, sum(sizes), sizes)

    def take(self, x: int, index: Any) -> int:
        """Components by position."""
        places = np.asarray(index, dtype=int).ravel()
        return self._add("take", (x,), len(places), places)

    def scaled(self, x: int, mean: Any, scale: Any) -> int:
        """``(x - mean) / scale``."""
        return self.binary("div", self.binary("sub", x, self.constant(mean)), self.constant(scale))

    def clipped(self, x: int, low: Any, high: Any) -> int:
        """x held within [low, high]."""
        return self.binary("min", self.binary("max", x, self.constant(low)), self.constant(high))

    def choose(self, condition: int, yes: int, no: int) -> int:
        """``yes`` where the condition is not 0, else ``no``; what is not chosen need not be finite."""
        return self._add("choose", (condition, yes, no), max(self.nodes[yes].size, self.nodes[no].size))

    def peak(self, x: int) -> int:
        """The largest component."""
        return self._add("peak", (x,), 1)

    def embed(self, other: Graph, **given: int) -> dict[str, int]:
        """Another graph behind nodes of this one; its outputs by name."""

        def leaf(node: Node) -> int:
            return given[node.data[0]] if node.op == "input" else self.constant(node.data[0])

        found = other.fold(leaf, lambda node, args: self._add(node.op, tuple(args), node.size, *node.data))
        return {name: found[i] for name, i in other.outputs.items()}

    # ---- reading ----------------------------------------------------------------------------------------------------
    def depends(self, nodes: set[int], source: int) -> bool:
        """Whether one of the nodes is computed from ``source``."""
        seen, waiting = set(), list(nodes)
        while waiting:
            here = waiting.pop()
            if here == source:
                return True
            if here not in seen:
                seen.add(here)
                waiting.extend(self.nodes[here].args)
        return False

    def fold(self, leaf: Callable[[Node], Any], rule: Callable[[Node, list[Any]], Any]) -> list[Any]:
        """Every node's value in another algebra: ``leaf`` for inputs and constants, ``rule`` for the rest."""
        found: list[Any] = []
        for node in self.nodes:
            found.append(leaf(node) if node.op in ("input", "constant") else rule(node, [found[a] for a in node.args]))
        return found

    def _values(self, given: Mapping[str, Any]) -> tuple[list[np.ndarray], bool]:
        missing = sorted(set(self.inputs) - set(given))
        if missing or set(given) - set(self.inputs):
            raise ValueError(f"the graph needs the inputs {list(self.inputs)} by name, but {sorted(given)} were given.")
        rows = {name: np.asarray(value, dtype=float) for name, value in given.items()}
        flat = all(value.ndim == 1 for value in rows.values())
        rows = {name: np.atleast_2d(value) for name, value in rows.items()}
        for name, value in rows.items():
            size = self.nodes[self.inputs[name]].size
            if value.shape[1] != size:
                raise ValueError(
                    f"{name} has {value.shape[1]} components, expected shape ({size},) or (n_rows, {size})."
                )

        def leaf(node: Node) -> np.ndarray:
            return rows[node.data[0]] if node.op == "input" else node.data[0][None]

        def rule(node: Node, args: list[np.ndarray]) -> np.ndarray:
            if node.op == "affine":
                return args[0] @ node.data[0] + node.data[1]
            if node.op == "concat":
                n = max(len(a) for a in args)
                return np.concatenate([np.broadcast_to(a, (n, a.shape[1])) for a in args], axis=1)
            if node.op == "take":
                return args[0][:, node.data[0]]
            if node.op == "peak":
                return args[0].max(axis=1, keepdims=True)
            if node.op == "choose":
                return np.where(args[0] != 0, args[1], args[2])
            return UNARY[node.op][0](*args) if node.op in UNARY else BINARY[node.op][0](*args)

        return self.fold(leaf, rule), flat

    def __call__(self, **given: Any) -> dict[str, np.ndarray]:
        """Outputs by name, (size,) or (n_rows, size) as the inputs are."""
        values, flat = self._values(given)
        n = max([len(values[i]) for i in self.inputs.values()], default=1)
        out = {name: np.broadcast_to(values[i], (n, values[i].shape[1])) for name, i in self.outputs.items()}
        return {name: value[0] if flat else value for name, value in out.items()}

    def jacobian(self, **given: Any) -> dict[tuple[str, str], np.ndarray]:
        """Exact slopes ``(output, input) -> (size, size)`` or (n_rows, size, size)."""
        values, flat = self._values(given)
        n = max([len(values[i]) for i in self.inputs.values()], default=1)
        sizes = [self.nodes[i].size for i in self.inputs.values()]
        edges = np.r_[0, np.cumsum(sizes)]
        place = dict(zip(self.inputs, edges))
        total = int(edges[-1])
        slopes: list[np.ndarray] = []
        for number, node in enumerate(self.nodes):
            slopes.append(self._slope(node, number, values, slopes, place, total))
        out = {}
        for name, i in self.outputs.items():
            whole = np.broadcast_to(slopes[i], (n, *slopes[i].shape[1:]))
            for k, given_name in enumerate(self.inputs):
                part = whole[:, :, edges[k] : edges[k + 1]]
                out[name, given_name] = part[0] if flat else part
        return out

    def _slope(
        self, node: Node, number: int, values: list, slopes: list, place: Mapping[str, int], total: int
    ) -> np.ndarray:
        """Slopes of one node by all inputs, (n_rows, size, total)."""
        if node.op == "input":
            out = np.zeros((1, node.size, total))
            rows = np.arange(node.size)
            out[0, rows, place[node.data[0]] + rows] = 1.0
            return out
        if node.op == "constant":
            return np.zeros((1, node.size, total))
        args = [slopes[a] for a in node.args]
        if node.op == "affine":
            return np.einsum("io,nif->nof", node.data[0], args[0])
        if node.op == "concat":
            n = max(len(a) for a in args)
            return np.concatenate([np.broadcast_to(a, (n, *a.shape[1:])) for a in args], axis=1)
        if node.op == "take":
            return args[0][:, node.data[0]]
        x, y = [values[a] for a in node.args], values[number]
        if node.op == "peak":
            which = x[0].argmax(axis=1)
            base = np.broadcast_to(args[0], (len(x[0]), *args[0].shape[1:]))
            return base[np.arange(len(x[0])), which][:, None]
        if node.op == "choose":
            return np.where((x[0] != 0)[:, :, None], args[1], args[2])
        if node.op in UNARY:
            gate: Any = UNARY[node.op][1]
            return np.asarray(gate(x[0], y))[:, :, None] * args[0]
        by = BINARY[node.op][1](x[0], x[1], y)
        parts = [np.asarray(b)[..., None] * a if np.ndim(b) else b * a for b, a in zip(by, args)]
        shape = np.broadcast_shapes(*(p.shape for p in parts), (1, node.size, total))
        return np.broadcast_to(parts[0], shape) + parts[1]
