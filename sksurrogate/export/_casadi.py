"""Graphs as CasADi functions, and as C code through them."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._files import write_text
from sksurrogate.exceptions import require
from sksurrogate.export._describe import to_graph
from sksurrogate.export._graph import Graph, Node


def to_casadi(model: Any, name: str = "surrogate", n_sub: int | None = None) -> Any:
    """A fitted model as ``casadi.Function``.

    Parameters
    ----------
    model : fitted estimator, simulator or Graph
        As for :func:`to_graph`.
    name : str, default="surrogate"
    n_sub : int, optional
        Runge-Kutta substeps of right-hand sides; None: as :func:`to_graph` takes them, ``model.substeps(U, x0)``: those of
        ``simulate``.

    Returns
    -------
    casadi.Function
        ``y = f(x)``, or ``x_next, y = f(x, u)``; vectors are columns.

    Raises
    ------
    MissingExtraError
        casadi is not installed.

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.export import to_casadi
    >>> round(float(to_casadi(LinearRegression().fit([[0.0], [1.0]], [1.0, 3.0]))(2.0)), 9)
    5.0
    """
    ca = require("casadi", "casadi")
    graph = model if isinstance(model, Graph) else to_graph(model, n_sub)
    values = graph.fold(
        lambda node: ca.SX.sym(node.data[0], node.size) if node.op == "input" else ca.SX(ca.DM(node.data[0])),
        lambda node, args: _rule(ca, node, args),
    )
    return ca.Function(
        name,
        [values[i] for i in graph.inputs.values()],
        [ca.densify(values[i]) for i in graph.outputs.values()],
        list(graph.inputs),
        list(graph.outputs),
    )


def _rule(ca: Any, node: Node, args: list[Any]) -> Any:
    """One node on CasADi columns."""
    if node.op == "affine":
        return ca.DM(np.ascontiguousarray(node.data[0].T)) @ args[0] + ca.DM(node.data[1])
    if node.op == "concat":
        return ca.vertcat(*args)
    if node.op == "take":
        return args[0][[int(k) for k in node.data[0]]]
    if node.op == "peak":
        return ca.mmax(args[0])
    if node.op == "logistic":
        return 0.5 + 0.5 * ca.tanh(0.5 * args[0])
    if node.op == "relu":
        return ca.fmax(args[0], 0.0)
    if node.op == "round":  # halves to the even number, as numpy rounds
        return args[0] - ca.remainder(args[0], 1.0)
    if node.op == "ge":
        return args[0] >= args[1]
    if node.op == "choose":
        return ca.if_else(args[0], args[1], args[2])
    known = {"max": "fmax", "min": "fmin", "abs": "fabs"}
    if node.op in ("add", "sub", "mul", "div", "pow"):
        a, b = args
        return {"add": a.__add__, "sub": a.__sub__, "mul": a.__mul__, "div": a.__truediv__, "pow": a.__pow__}[node.op](
            b
        )
    return getattr(ca, known.get(node.op, node.op))(*args)


def to_c(model: Any, path: Any = None, name: str = "surrogate", n_sub: int | None = None) -> str:
    """A fitted model as C code without dependencies, made by CasADi.

    Parameters
    ----------
    model : fitted estimator, simulator or Graph
    path : str or path, optional
        File to write.
    name : str, default="surrogate"
        Of the C function ``int name(const double** arg, double** res, ...)``.
    n_sub : int, optional
        As for :func:`to_casadi`.

    Returns
    -------
    str
        The code.

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.export import to_c
    >>> "int surrogate(" in to_c(LinearRegression().fit([[0.0], [1.0]], [1.0, 3.0]))
    True
    """
    function = to_casadi(model, name, n_sub)
    with tempfile.TemporaryDirectory() as folder:
        generator = require("casadi", "casadi").CodeGenerator(f"{name}.c")
        generator.add(function)
        generator.generate(folder + os.sep)
        code = (Path(folder) / f"{name}.c").read_text()
        if generator.dump() not in code:  # casadi says nothing where the disk is full
            raise OSError(28, f"{name}.c came out shorter than it is: is the disk of temporary files full?", folder)
    if path is not None:
        write_text(path, code)
    return code
