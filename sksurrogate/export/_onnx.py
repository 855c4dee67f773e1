"""Graphs as ONNX models."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate._files import write_bytes
from sksurrogate.exceptions import require
from sksurrogate.export._describe import to_graph
from sksurrogate.export._graph import Graph, Node

#: Node -> operator of ONNX.
_OPERATORS = {
    "tanh": "Tanh", "logistic": "Sigmoid", "relu": "Relu", "exp": "Exp", "log": "Log", "sin": "Sin", "cos": "Cos",
    "tan": "Tan", "sqrt": "Sqrt", "abs": "Abs", "sign": "Sign", "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div",
    "pow": "Pow", "max": "Max", "min": "Min", "round": "Round",
}  # fmt: skip


def to_onnx(
    model: Any, path: Any = None, name: str = "surrogate", n_sub: int | None = None, dtype: Any = np.float64
) -> Any:
    """A fitted model, scaling and all, as an ONNX model.

    Parameters
    ----------
    model : fitted estimator, simulator or Graph
        As for :func:`to_graph`.
    path : str or path, optional
        File to write.
    name : str, default="surrogate"
    n_sub : int, optional
        Runge-Kutta substeps of right-hand sides; None: as :func:`to_graph` takes them, ``model.substeps(U, x0)``: those of
        ``simulate``.
    dtype : float64 (default) or float32

    Returns
    -------
    onnx.ModelProto
        Inputs and outputs by the names of the graph, (n_rows, size).

    Raises
    ------
    MissingExtraError
        onnx is not installed.

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.export import to_onnx
    >>> model = to_onnx(LinearRegression().fit([[0.0], [1.0]], [1.0, 3.0]))
    >>> [entry.name for entry in model.graph.output]
    ['y']
    """
    onnx = require("onnx", "onnx")
    graph = model if isinstance(model, Graph) else to_graph(model, n_sub)
    writer = _Writer(onnx, np.dtype(dtype))
    for number, node in enumerate(graph.nodes):
        writer.add(f"n{number}", node, [f"n{a}" for a in node.args])
    for out, number in graph.outputs.items():
        whole = writer.rows(f"out_{out}", f"n{number}", graph.nodes[number].size)
        writer.node("Identity", [whole], out)
    kind = onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype))

    def entry(label: str, number: int) -> Any:
        return onnx.helper.make_tensor_value_info(label, kind, ["n_rows", graph.nodes[number].size])

    body = onnx.helper.make_graph(
        writer.nodes,
        name,
        [entry(label, i) for label, i in graph.inputs.items()],
        [entry(label, i) for label, i in graph.outputs.items()],
        writer.initializers,
    )
    proto = onnx.helper.make_model(body, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(proto)
    if path is not None:
        write_bytes(path, proto.SerializeToString())
    return proto


class _Writer:
    """Nodes and fixed numbers of an ONNX graph."""

    def __init__(self, onnx: Any, dtype: np.dtype):
        self.onnx, self.dtype = onnx, dtype
        self.nodes: list[Any] = []
        self.initializers: list[Any] = []
        self.inputs: list[tuple[str, int]] = []
        self.alone: set[str] = set()  # nodes that hang on no input have one row

    def node(self, operator: str, args: list[str], out: str, **attributes: Any) -> None:
        self.nodes.append(self.onnx.helper.make_node(operator, args, [out], **attributes))

    def fixed(self, label: str, value: np.ndarray) -> str:
        self.initializers.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(value), label))
        return label

    def rows(self, label: str, arg: str, size: int) -> str:
        """The argument with as many rows as the inputs have."""
        if arg not in self.alone:
            return arg
        (given, width), many = self.inputs[0], f"{label}_{arg}"
        self.node("MatMul", [given, self.fixed(f"{many}_z", np.zeros((width, size), self.dtype))], f"{many}_p")
        self.node("Add", [f"{many}_p", arg], many)
        return many

    def add(self, label: str, node: Node, args: list[str]) -> None:
        """One node of ours as one or two of theirs."""
        if node.op == "constant" or (args and self.alone.issuperset(args)):
            self.alone.add(label)
        if node.op == "input":
            self.inputs.append((node.data[0], node.size))
            self.node("Identity", [node.data[0]], label)
        elif node.op == "constant":
            self.fixed(label, node.data[0][None].astype(self.dtype))
        elif node.op == "affine":
            self.node("MatMul", [args[0], self.fixed(f"{label}_w", node.data[0].astype(self.dtype))], f"{label}_p")
            self.node("Add", [f"{label}_p", self.fixed(f"{label}_b", node.data[1].astype(self.dtype))], label)
        elif node.op == "concat":
            sizes = dict(zip(args, node.data[0]))
            self.node("Concat", [self.rows(label, a, sizes[a]) for a in args], label, axis=1)
        elif node.op == "take":
            self.node("Gather", [args[0], self.fixed(f"{label}_i", node.data[0].astype(np.int64))], label, axis=1)
        elif node.op == "peak":
            self.node("ReduceMax", args, label, axes=[1], keepdims=1)
        elif node.op == "ge":
            self.node("GreaterOrEqual", args, f"{label}_b")
            self.node("Cast", [f"{label}_b"], label, to=self.onnx.helper.np_dtype_to_tensor_dtype(self.dtype))
        elif node.op == "choose":
            self.node("Cast", args[:1], f"{label}_b", to=self.onnx.TensorProto.BOOL)
            self.node("Where", [f"{label}_b", *args[1:]], label)
        else:
            self.node(_OPERATORS[node.op], args, label)
