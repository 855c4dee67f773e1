"""A recursive model as a unit for co-simulation (FMI 2), in Python: no compiler is needed."""

from __future__ import annotations

import json
import sys
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._files import write_bytes, write_text
from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.export import _unit_step
from sksurrogate.export._describe import to_graph
from sksurrogate.export._graph import Graph, Node

#: The class that pythonfmu runs, behind the text of ``_unit_step.py``.
_SCRIPT_OF_UNIT = '''

import json
from pathlib import Path

from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Real


class {name}(Fmi2Slave):
    """States, inputs and outputs by name; the step is that of the exported graph."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        model = json.loads((Path(self.resources) / "{name}.json").read_text())
        self.nodes, self.out, self.dt = model["nodes"], model["outputs"], model["dt"]
        self.x, self.u = list(model["start"]), list(model["held"])
        for k, (label, unit) in enumerate(model["inputs"]):
            self._add(label, Fmi2Causality.input, unit, self.u, k)
        for k, (label, unit) in enumerate(model["states"]):
            self._add(label, Fmi2Causality.local, unit, self.x, k, initial=Fmi2Initial.exact)
        for k, (label, unit) in enumerate(model["names"]):
            read = lambda k=k: self._values()["y"][k]
            self.register_variable(Real(label, causality=Fmi2Causality.output, description=unit, getter=read), nested=False)

    def _add(self, label, causality, unit, values, k, **more):
        read, write = lambda: values[k], lambda value: values.__setitem__(k, value)
        made = Real(label, causality=causality, description=unit, getter=read, setter=write, **more)
        self.register_variable(made, nested=False)

    def _values(self):
        found = evaluate(self.nodes, {{"x": self.x, "u": self.u}})
        return {{name: found[k] for name, k in self.out.items()}}

    def do_step(self, current_time, step_size):
        steps = round(step_size / self.dt)
        if steps < 1 or abs(steps * self.dt - step_size) > 1e-6 * self.dt:
            raise ValueError(f"step size {{step_size}}: expected a multiple of the sample time {{self.dt}}")
        for _ in range(steps):
            self.x[:] = self._values()["x_next"]
        return True
'''


def to_fmu(model: Any, path: Any, x0: Any = None, u0: Any = None, n_sub: int | None = None) -> Path:
    """A recursive model as an FMU for co-simulation, FMI 2.0 (extra ``fmu``).

    The unit carries the arithmetic of the model as a Python script, and pythonfmu's binaries for 64-bit Linux and Windows
    run it: no compiler is needed, and Python 3 must be installed where the unit runs. A tool without Python takes the C code
    of :func:`to_c`. Step sizes are multiples of the sample time, inputs are held over a step. The states are variables
    named ``state.NAME``, whose start values can be set.

    Parameters
    ----------
    model : AugmentedSimulator, simulator with ``rhs`` or ``step``, recursive model or Graph
        As for :func:`to_graph`.
    path : str or path
        File to write, ``NAME.fmu``; NAME is the name of the model in the unit and must be a Python name.
    x0 : array-like (n_states,), optional
        Start of the states; those of the model by default.
    u0 : array-like (n_inputs,), optional
        Inputs before the first one is set; 0 by default. Memories of effects start at rest there.
    n_sub : int, optional
        Runge-Kutta substeps of right-hand sides; None: as :func:`to_graph` takes them, ``model.substeps(U, x0)``: those of
        ``simulate``.

    Returns
    -------
    Path

    Raises
    ------
    SurrogateError
        The model is not recursive, or the path does not end in ``NAME.fmu``.
    MissingExtraError
        pythonfmu is not installed.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.export import to_fmu
    >>> to_fmu(make_reactor(), "reactor.fmu", x0=[4.0], u0=[0.15]).name   # doctest: +SKIP
    'reactor.fmu'
    """
    path = Path(path)
    if path.suffix != ".fmu" or not path.stem.isidentifier():
        raise SurrogateError(f"path={str(path)!r}: expected NAME.fmu with a Python name, for example model.fmu.")
    graph = model if isinstance(model, Graph) else to_graph(model, n_sub)
    if set(graph.inputs) != {"x", "u"}:
        raise SurrogateError(
            f"{type(model).__name__} is not recursive: an FMU needs inputs x and u, got {list(graph.inputs)}."
        )
    described = _described(graph, model, x0, u0, n_sub)
    builder = require("pythonfmu.builder", "fmu").FmuBuilder
    found, name = list(sys.path), path.stem
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the builder's own parsing
        module = f"unit_of_{name}"  # units that run in this process share its modules: no other script has this name
        script, data = Path(folder) / f"{module}.py", Path(folder) / f"{name}.json"
        write_text(script, Path(_unit_step.__file__).read_text(encoding="utf-8") + _SCRIPT_OF_UNIT.format(name=name))
        write_text(data, json.dumps(described))
        sys.modules.pop(module, None)  # of a unit built or run before
        try:
            built = builder.build_FMU(script, dest=Path(folder) / path.name, project_files=[data])
            write_bytes(path, Path(built).read_bytes())
        finally:  # the builder imports the script
            sys.path[:] = found
            sys.modules.pop(module, None)
    return path


def _described(graph: Graph, model: Any, x0: Any, u0: Any, n_sub: int | None) -> dict[str, Any]:
    """What the unit reads: nodes, names with units, start."""
    n_x, n_u = (graph.nodes[graph.inputs[name]].size for name in ("x", "u"))
    held = np.zeros(n_u) if u0 is None else np.asarray(u0, dtype=float).ravel()
    start = _start(graph, model, x0, held, n_sub)
    if len(start) != n_x or len(held) != n_u:
        raise SurrogateError(
            f"x0 has {len(start)} and u0 {len(held)} components: expected {n_x} states and {n_u} inputs."
        )
    if not (np.isfinite(start).all() and np.isfinite(held).all()):
        raise SurrogateError(f"x0={start.tolist()}, u0={held.tolist()}: expected finite numbers.")
    n_y = graph.nodes[graph.outputs["y"]].size
    inputs, outputs = graph.signals or (getattr(model, "inputs", None), getattr(model, "outputs", None))
    states = _named(graph.states or getattr(model, "states", None), n_x, "x")
    units = dict(getattr(model, "units", None) or {})

    def described(names: Sequence[str], prefix: str = "") -> list[tuple[str, str]]:
        return [(prefix + name, units.get(name, "")) for name in names]

    return {
        "nodes": [[node.op, list(node.args), _plain(node)] for node in graph.nodes],
        "outputs": dict(graph.outputs),
        "dt": graph.dt or 1.0,
        "start": start.tolist(),
        "held": held.tolist(),
        "inputs": described(_named(inputs, n_u, "u")),
        "states": described(states, "state."),
        "names": described(_named(outputs, n_y, "y")),
    }


def _start(graph: Graph, model: Any, x0: Any, held: np.ndarray, n_sub: int | None) -> np.ndarray:
    """The states at the start of a run."""
    if hasattr(model, "start_state"):
        return np.asarray(model.start_state(x0, held, n_sub), dtype=float)
    known = next((x for x in (x0, graph.initial, getattr(model, "x0", None)) if x is not None), None)
    return np.zeros(graph.nodes[graph.inputs["x"]].size) if known is None else np.asarray(known, dtype=float).ravel()


def _named(names: Any, count: int, letter: str) -> list[str]:
    """Names of signals; letter and number where they have none."""
    listed = [names] if isinstance(names, str) else list(names or ())
    return listed if len(listed) == count else [f"{letter}{k}" for k in range(count)]


def _plain(node: Node) -> list[Any]:
    """The numbers of a node as lists; the weights of a linear map by output."""
    if node.op == "input":
        return [node.data[0]]
    if node.op == "affine":
        return [np.asarray(node.data[0]).T.tolist(), np.asarray(node.data[1]).tolist()]
    return [np.asarray(part).tolist() for part in node.data] if node.op in ("constant", "take") else []
