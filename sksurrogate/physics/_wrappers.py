"""Simulators from what people have: a table of simulated outputs, a function or fitted estimator, a step function."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate._columns import by_name
from sksurrogate._tables import as_labels, unmasked
from sksurrogate.exceptions import SimulationDiverged, SimulatorError, SurrogateError
from sksurrogate.physics._foreign import LARGEST_OFFERED, REFUSALS, offered
from sksurrogate.physics._free_run import raise_if_diverged
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._params import ParametricSimulator
from sksurrogate.physics._simulator import BaseSimulator, describe
from sksurrogate.runs import unstack_runs


def _inputs(U: Any, names: Sequence[str] | None = None) -> np.ndarray:
    """(n_samples, n_inputs) as float."""
    inputs = np.asarray(by_name(U, names), dtype=float)
    if inputs.ndim == 1:
        inputs = inputs[:, None]
    if inputs.ndim != 2 or (names is not None and inputs.shape[1] != len(names)):
        width = "n_inputs" if names is None else str(len(names))
        raise SimulatorError(
            f"U has shape {inputs.shape}, expected (n_samples, {width}): one row for each sample, one column for each input."
        )
    return inputs


def _bearable(inputs: np.ndarray) -> np.ndarray:
    """The inputs, checked to be finite numbers that a user's function can take."""
    if not offered(inputs.T).all():
        row = int(np.flatnonzero(~offered(inputs.T))[0])
        raise SimulatorError(
            f"U={inputs[row].tolist()} in row {row}: expected finite inputs of at most {LARGEST_OFFERED:g}; interpolate or cut "
            "the record there."
        )
    return inputs


class TableSimulator(BaseSimulator):
    """Outputs that another tool has simulated, looked up by their inputs.

    Parameters
    ----------
    U : array-like (n_samples, n_inputs), optional
        Inputs that were simulated, runs stacked.
    Y : array-like (n_samples,) or (n_samples, n_outputs), optional
        Simulated outputs of these rows.
    groups : array-like (n_samples,), optional
        Run of each row; one run by default.
    columns : list of int or of str, optional
        In place of U and Y: columns of the inputs that already hold the simulated outputs, by number or by name in ``inputs``.
    inputs, outputs : list of str, optional
        Names.
    dt : float, default=1.0
        Sample time.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Notes
    -----
    A run, or a part of one, is found by equal inputs. If several have different outputs, ``x0`` (first outputs) decides. Inputs
    that are not in the table are an error.

    Examples
    --------
    >>> from sksurrogate.physics import TableSimulator
    >>> table = TableSimulator([[0.0], [1.0], [2.0]], [5.0, 6.0, 7.0])
    >>> table.simulate([[1.0], [2.0]]).ravel()
    array([6., 7.])
    """

    def __init__(
        self,
        U: Any = None,
        Y: Any = None,
        *,
        groups: Any = None,
        columns: Sequence[int | str] | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        dt: float = 1.0,
        units: Mapping[str, str] | None = None,
    ):
        self.U = U
        self.Y = Y
        self.groups = groups
        self.columns = columns
        self.inputs = inputs
        self.outputs = outputs
        self.dt = dt
        self.units = units

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Simulated outputs (n_samples, n_outputs) of inputs that are in the table."""
        names = self.inputs or getattr(self.U, "columns", None)
        inputs = _inputs(by_name(U, names))
        if self.columns is not None:
            return inputs[:, self._places_of_columns(inputs.shape[1])]
        if self.U is None or self.Y is None:
            raise SimulatorError(
                "TableSimulator needs U and Y (what was simulated), or columns (where U holds the outputs)."
            )
        table, outputs = _inputs(by_name(self.U, names)), np.asarray(by_name(self.Y, self.outputs), dtype=float)
        outputs = outputs.reshape(len(outputs), -1)
        if len(table) != len(outputs):
            raise SimulatorError(
                f"U has {len(table)} rows and Y has {len(outputs)}: the table needs one row for each sample in both."
            )
        if table.shape[1] != inputs.shape[1]:
            raise SimulatorError(f"U has {inputs.shape[1]} columns, the table {table.shape[1]} inputs.")
        labels = np.zeros(len(table), int) if self.groups is None else as_labels(self.groups)
        found = []
        for u, y in zip(unstack_runs(table, labels), unstack_runs(outputs, labels)):
            found += [y[k : k + len(inputs)] for k in _places(u, inputs)]
        if not found:
            raise SimulatorError(
                f"U ({len(inputs)} rows, first row {inputs[0].tolist()}) is not in the table of simulated inputs: "
                "simulate this run with your tool and add its rows to U and Y."
            )
        if x0 is not None:
            first = np.asarray(x0, dtype=float).reshape(-1)
            found.sort(key=lambda y: float(np.sum((y[0] - first) ** 2)) if y.shape[1] == len(first) else 0.0)
        elif any(not np.array_equal(found[0], y) for y in found[1:]):
            raise SimulatorError(
                f"U fits {len(found)} places of the table with different outputs: give x0, the outputs of the first row."
            )
        return found[0].copy()

    def _places_of_columns(self, n_columns: int) -> list[int]:
        """Numbers of ``columns``, which may be names of ``inputs``."""
        names, places = list(self.inputs or ()), []
        for column in self.columns or ():
            place = names.index(column) if column in names else column
            if isinstance(place, str) or not -n_columns <= place < n_columns:
                raise SimulatorError(
                    f"columns={list(self.columns or ())}: U has {n_columns} columns and inputs={names}, none is {column!r}: "
                    "give numbers of columns, or names among inputs=[...]."
                )
            places.append(place)
        return places


def _places(table: np.ndarray, inputs: np.ndarray) -> list[int]:
    """Rows at which ``inputs`` occur in ``table``."""
    last = len(table) - len(inputs)
    if last < 0:
        return []
    same = {"rtol": 1e-9, "atol": 1e-12 * np.max(np.abs(table), axis=0)}
    starts = np.flatnonzero(np.all(np.isclose(table[: last + 1], inputs[0], **same), axis=1))
    return [int(k) for k in starts if np.isclose(table[k : k + len(inputs)], inputs, **same).all()]


class CallableSimulator(ParametricSimulator):
    """A function, or a fitted estimator, as a simulator.

    Parameters
    ----------
    function : callable, or object with ``predict``
        ``function(U)`` returns the outputs of one run; arguments called ``x0``, ``t``, ``p`` (or ``params``) are
        handed over where it has them. A fitted estimator is asked by ``predict(U)`` and stays as it is in a clone.
    inputs, outputs : list of str, optional
        Names.
    params : dict of float, optional
        Parameters, for functions with an argument ``p``.
    dt : float, default=1.0
        Sample time.
    x0 : array-like, optional
        Handed over where ``simulate`` gets none.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import CallableSimulator
    >>> CallableSimulator(lambda U, p: p["gain"] * U, params={"gain": 2.0}).simulate([[1.0], [3.0]]).ravel()
    array([2., 6.])
    """

    def __init__(
        self,
        function: Any,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        params: Mapping[str, float] | None = None,
        dt: float = 1.0,
        x0: Any = None,
        units: Mapping[str, str] | None = None,
    ):
        self.function = function
        self.inputs = inputs
        self.outputs = outputs
        self.params = params
        self.dt = dt
        self.x0 = x0
        self.units = units

    def __sklearn_clone__(self) -> CallableSimulator:
        """A fitted estimator is data here: a clone keeps it fitted."""
        kept = self.get_params(deep=False)
        if kept["params"] is not None:
            kept["params"] = dict(kept["params"])
        return type(self)(kept.pop("function"), **kept)

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs)."""
        learned = list(
            getattr(self.function, "feature_names_in_", [])
        )  # names of the columns that an estimator was fitted to
        inputs = _bearable(_inputs(U, self.inputs or learned or None))
        if self.inputs and set(learned) == set(self.inputs):
            inputs = inputs[:, [list(self.inputs).index(name) for name in learned]]
        times = self.dt * np.arange(len(inputs)) if t is None else np.asarray(t, dtype=float)
        try:
            out = self._called(inputs, x0, t)
        except (SurrogateError, AttributeError):  # with scikit-learn's NotFittedError, which is a ValueError too
            raise
        except REFUSALS as error:  # of a function that works for other inputs; a mistake in it is shown as it is
            low, high = (np.round(bound, 6).tolist() for bound in (inputs.min(axis=0), inputs.max(axis=0)))
            raise SimulationDiverged(
                f"function stopped with {type(error).__name__}: {error}. It was given {len(inputs)} rows of inputs from {low} to {high}, "
                f"params={dict(self.params or {})}; give inputs and parameters that it takes."
            ) from error
        outputs = np.asarray(out, dtype=float)
        if outputs.ndim == 1:
            outputs = outputs[:, None]
        if (
            outputs.ndim != 2
            or len(outputs) != len(inputs)
            or (self.outputs is not None and outputs.shape[1] != len(self.outputs))
        ):
            width = "n_outputs" if self.outputs is None else str(len(self.outputs))
            raise SimulatorError(
                f"function returned shape {np.shape(out)}, expected ({len(inputs)}, {width}): one row for each row of U."
            )
        names = tuple(self.outputs or (f"y{k}" for k in range(outputs.shape[1])))
        raise_if_diverged(outputs[None], times, names)
        return outputs

    def _called(self, inputs: np.ndarray, x0: Any, t: Any) -> Any:
        """What the function, or the estimator, returns."""
        if hasattr(self.function, "predict"):
            with warnings.catch_warnings():  # its columns have the order of its names
                warnings.filterwarnings("ignore", "X does not have valid feature names")
                return self.function.predict(inputs.copy())
        if callable(self.function):
            start = self.x0 if x0 is None else x0
            start = start.copy() if isinstance(start, np.ndarray) else start
            known = {"x0": start, "t": self.dt * np.arange(len(inputs)) if t is None else np.array(t)}
            known["p"] = known["params"] = dict(self.params or {})
            wanted = dict(list(inspect.signature(self.function).parameters.items())[1:])
            if start is None and "x0" in wanted and wanted["x0"].default is not inspect.Parameter.empty:
                del wanted["x0"]  # the function knows its own initial state
            return self.function(inputs.copy(), **{name: value for name, value in known.items() if name in wanted})
        raise SimulatorError(f"function={self.function!r} is neither callable nor an estimator with predict.")


class StepSimulator(ParametricSimulator):
    """Simulator of ``x[k+1] = step(t, x, u, p, dt)``.

    Parameters
    ----------
    step : callable ``step(t, x, u, p, dt)``
        x ``(n_states, *s)``, u ``(n_inputs, *s)`` -> the states one sample later; one that branches on values is called point
        by point, with a warning.
    states, inputs, outputs : list of str
        Names. Outputs are states by name, unless ``output`` is given.
    params : dict of float, optional
    dt : float, default=1.0
        Sample time.
    output : callable ``output(t, x, u, p)``, optional
    x0 : array-like (n_states,), optional
        Initial state; zeros by default.
    kinematic : list of str, optional
        States that are integrals of others, beside those whose rate is seen to be another state: no force is sought there.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Examples
    --------
    >>> from sksurrogate.physics import StepSimulator
    >>> tank = StepSimulator(lambda t, x, u, p, dt: [x[0] + dt * u[0]], states=["level"], inputs=["flow"], outputs=["level"])
    >>> tank.simulate([[1.0], [1.0], [1.0]]).ravel()
    array([0., 1., 2.])
    """

    def __init__(
        self,
        step: Callable[..., Any],
        *,
        states: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        params: Mapping[str, float] | None = None,
        dt: float = 1.0,
        output: Callable[..., Any] | None = None,
        x0: Any = None,
        kinematic: Sequence[str] | None = None,
        units: Mapping[str, str] | None = None,
    ):
        self.step = step
        self.states = states
        self.inputs = inputs
        self.outputs = outputs
        self.params = params
        self.dt = dt
        self.output = output
        self.x0 = x0
        self.kinematic = kinematic
        self.units = units

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs); row 0 is the output at ``x0``."""
        inputs = _bearable(_inputs(U, self.inputs))
        return self.simulate_batch(
            inputs[None], None if x0 is None else np.reshape(np.asarray(unmasked(x0), dtype=float), (1, -1)), t
        )[0]

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length, all at once: (n_runs, n_samples, n_inputs) -> (n_runs, n_samples, n_outputs)."""
        inputs = np.asarray(U, dtype=float)
        plant = describe(self)
        if inputs.ndim != 3 or inputs.shape[2] != len(plant.inputs):
            raise SimulatorError(f"U has shape {inputs.shape}, expected (n_runs, n_samples, {len(plant.inputs)}).")
        start = plant.x0 if X0 is None else np.asarray(unmasked(X0), dtype=float)
        if start.shape[-1:] != (len(plant.states),):
            raise SimulatorError(
                f"x0 has shape {start.shape}, expected {len(plant.states)} values: one for each of states={list(plant.states)}."
            )
        times = plant.dt * np.arange(inputs.shape[1]) if t is None else np.asarray(t, dtype=float)
        widths = np.diff(times, append=times[-1] + plant.dt)
        model = PlantModel(plant)
        model.probe(inputs[0, 0])
        X = np.empty((len(plant.states), *inputs.shape[:2]))
        X[:, :, 0] = np.broadcast_to(start, (len(inputs), len(plant.states))).T
        with np.errstate(all="ignore"):
            for k in range(inputs.shape[1] - 1):
                X[:, :, k + 1] = model.step(times[k], X[:, :, k], inputs[:, k].T, float(widths[k]))
        raise_if_diverged(X.transpose(1, 2, 0), times, plant.states, said=model.refusal)
        Y = model.output(times, X, inputs.transpose(2, 0, 1)).transpose(1, 2, 0)
        if model.refusal:
            raise_if_diverged(Y, times, plant.outputs, said=model.refusal)
        return Y
