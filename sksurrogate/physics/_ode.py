"""A simulator from an ODE right-hand side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate._columns import by_name
from sksurrogate._tables import unmasked
from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.linear_step import hold_maps
from sksurrogate.physics._events import EventMap
from sksurrogate.physics._free_run import OF_SCIPY, free_run, raise_if_diverged, substeps
from sksurrogate.physics._linear import exact_run, linear_parts
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._params import ParametricSimulator
from sksurrogate.physics._rhs import PointwiseFunction
from sksurrogate.physics._simulator import describe


def _has_events(self: ODESimulator) -> bool:
    return bool(self.events)


def _is_linear_map(self: ODESimulator) -> bool:
    return self.method == "exact" and self.hold == "zoh" and not self.events


class ODESimulator(ParametricSimulator):
    """Simulator of ``dx/dt = rhs(t, x, u, p)``.

    Parameters
    ----------
    rhs : callable ``rhs(t, x, u, p)``
        x is ``(n_states, *s)``, u ``(n_inputs, *s)``, p a dict of floats (or arrays of shape s); returns ``len(states)``
        components of shape s, or scalars. One that branches on values works too, sample by sample, with a warning; one
        that writes into x, u or t is handed copies, with a warning.
    states, inputs, outputs : list of str
        Names. Outputs are states by name, unless ``output`` is given. A state and an output may share a name.
    params : dict of float
        Parameters of ``rhs`` by name.
    dt : float
        Sample time; its unit is that of time in ``rhs``.
    hold : {"zoh", "foh"}, default="zoh"
        ``U[k]`` acts on [t_k, t_k+1), or samples are joined linearly.
    method : str, default="auto"
        "auto": Runge-Kutta of order 4 with substeps chosen by their error, substeps of its own for every sample of a long run that
        is stiff now and then, scipy's LSODA where the plant is stiff.
        "RK4" forces the first, the name of a method of :func:`scipy.integrate.solve_ivp` the last. "exact" steps a linear
        right-hand side by the matrix exponential.
    output : callable ``output(t, x, u, p)``, optional
        Measured outputs where they are not states.
    x0 : array-like (n_states,), optional
        Initial state; zeros by default.
    kinematic : list of str, optional
        States that are integrals of others, beside those whose rate is seen to be another state: no force is sought there.
    events : list of (when, then), optional
        Two functions of ``(t, x, u, p)``: the states become ``then`` at the moment ``when`` falls through zero (a condition of states
        and time; what an input takes below zero at once is no fall), for instance ``[(lambda t, x, u, p: x[0], lambda t, x, u, p: (0 * x[0], -p["e"] * x[1]))]`` for a ball that bounces. With them the
        plant is known by its map from sample to sample (``step``); inputs are held.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Notes
    -----
    ``Y[0]`` is the output at ``x0``; row k depends on ``U[0..k]`` only.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.6.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import ODESimulator
    >>> def rhs(t, x, u, p):
    ...     q, v = x
    ...     return v, (u[0] - p["k"] * q - p["c"] * v) / p["m"]
    >>> plant = ODESimulator(rhs, states=["position", "velocity"], inputs=["force"], outputs=["position"],
    ...                      params={"m": 1.0, "k": 20.0, "c": 0.3}, dt=0.01)
    >>> plant.simulate(np.zeros((3, 1)), x0=[0.1, 0.0]).round(4)
    array([[0.1   ],
           [0.0999],
           [0.0996]])
    """

    def __init__(
        self,
        rhs: Callable[..., Any],
        *,
        states: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        params: Mapping[str, float],
        dt: float,
        hold: str = "zoh",
        method: str = "auto",
        output: Callable[..., Any] | None = None,
        x0: Any = None,
        kinematic: Sequence[str] | None = None,
        events: Sequence[tuple[Callable[..., Any], Callable[..., Any]]] | None = None,
        units: Mapping[str, str] | None = None,
    ):
        self.rhs = rhs
        self.states = states
        self.inputs = inputs
        self.outputs = outputs
        self.params = params
        self.dt = dt
        self.hold = hold
        self.method = method
        self.output = output
        self.x0 = x0
        self.kinematic = kinematic
        self.events = events
        self.units = units

    def __getstate__(self) -> dict[str, Any]:
        """What is looked up again stays behind."""
        return {key: value for key, value in super().__getstate__().items() if key != "_map"}

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run.

        Parameters
        ----------
        U : array-like (n_samples, n_inputs)
        x0 : array-like (n_states,), optional
            Default: the constructor's, else zeros.
        t : array-like (n_samples,), optional
            Times; default ``dt * arange(n_samples)``.

        Returns
        -------
        ndarray (n_samples, n_outputs)

        Raises
        ------
        SimulationDiverged
            A state became infinite or nan; the message names time, state and remedy.
        SimulatorError
            U or x0 has the wrong shape, or ``rhs`` does not keep the contract.
        """
        inputs = self._check_inputs(U)
        return self._run(inputs[None], self._check_x0(x0)[None], t)[0]

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length, all at once: U (n_runs, n_samples, n_inputs) -> Y (n_runs, n_samples, n_outputs)."""
        inputs = np.asarray(U, dtype=float)
        if inputs.ndim != 3 or inputs.shape[2] != len(self._names("inputs")):
            raise SimulatorError(
                f"U has shape {inputs.shape}, expected (n_runs, n_samples, {len(self._names('inputs'))})."
            )
        states = self._names("states")
        start = self._check_x0(None) if X0 is None else np.asarray(unmasked(X0), dtype=float)
        if start.shape not in ((len(states),), (1, len(states)), (len(inputs), len(states))):
            raise SimulatorError(
                f"X0 has shape {start.shape}, expected ({len(states)},), or ({len(inputs)}, {len(states)}): one row for each run, "
                f"one column for each of states={list(states)}."
            )
        return self._run(inputs, np.broadcast_to(start, (len(inputs), len(states))), t)

    def simulate_states(self, U: Any, x0: Any = None, t: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """States and their derivatives of one run, both (n_samples, n_states); the derivative with the input that acts from t_k on."""
        inputs = self._check_inputs(U)
        X, times, model = self._states(inputs[None], self._check_x0(x0)[None], t)
        if self.events:
            slope = PointwiseFunction(self.rhs, len(self._names("states")), "rhs", self._names("states"))
            return X[0], slope(times, X[0].T, inputs.T, dict(self.params or {})).T
        return X[0], model.derivative(times, X[0].T, inputs.T).T

    def substeps(self, U: Any, x0: Any = None, t: Any = None) -> int:
        """Runge-Kutta steps per sample that :meth:`simulate` takes for these inputs: an export with as many gives the same run.

        Parameters
        ----------
        U, x0, t
            As for :meth:`simulate`.

        Raises
        ------
        SimulatorError
            An integrator of scipy takes the run in steps of its own, or there are events.

        Examples
        --------
        >>> from sksurrogate.datasets import make_reactor
        >>> from sksurrogate.export import to_graph
        >>> plant, U = make_reactor(), [[0.15]] * 50
        >>> graph = to_graph(plant, n_sub=plant.substeps(U, x0=[4.0]))
        """
        inputs, start = self._check_inputs(U), self._check_x0(x0)
        model, times = self._prepared(inputs[None], t)
        if _is_linear_map(self):
            return 1  # the map of a sample is exact
        if self.events or self.hold != "zoh":
            raise SimulatorError(OF_SCIPY)
        given = model.derivative, inputs[None], start[None], times
        found = substeps(*given, 0, method=self.method, many=model.takes_many)
        if found is None:
            raise SimulatorError(OF_SCIPY)
        return found

    @available_if(_is_linear_map)
    def held_map(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, G and g of ``x_next = F x + G u + g`` under held inputs (with ``method="exact"`` only)."""
        n, m = len(self._names("states")), len(self._names("inputs"))
        model, times = self._prepared(np.zeros((1, 2, m)), None)
        A, B, b = linear_parts(model.derivative, np.ones(n), np.ones(m), times, self._names("states"))
        maps = hold_maps(A, np.column_stack([B, b]), float(self.dt), 0)
        return maps.F, maps.G[:, :m], maps.G[:, m]

    @available_if(_has_events)
    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """The states a time ``dt`` later, events within it included (with ``events`` only)."""
        points, inputs = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
        key = (self.rhs, tuple(map(id, self.events or ())))
        kept = self.__dict__.get("_map")
        if kept is None or kept[0] != key:
            self._map = kept = (key, EventMap(self.rhs, self.events or (), self._names("states")))
        flat = points.reshape(len(points), -1)
        times = np.broadcast_to(np.asarray(t, dtype=float), points.shape[1:]).reshape(-1)
        spread = np.broadcast_to(inputs, (len(inputs), *points.shape[1:])).reshape(len(inputs), -1)
        with np.errstate(all="ignore"):
            return kept[1].sample(times, flat, spread, p, dt).reshape(points.shape)

    def _names(self, what: str) -> tuple[str, ...]:
        value = getattr(self, what)
        return (value,) if isinstance(value, str) else tuple(value)

    def _check_inputs(self, U: Any) -> np.ndarray:
        """(n_samples, n_inputs) as float."""
        names = self._names("inputs")
        inputs = np.asarray(by_name(U, names), dtype=float)
        if inputs.ndim == 1 and len(names) == 1:
            inputs = inputs[:, None]
        if inputs.ndim != 2 or inputs.shape[1] != len(names):
            raise SimulatorError(
                f"U has shape {inputs.shape}, expected (n_samples, {len(names)}): one column for each of inputs={list(names)}."
            )
        if not len(inputs):
            raise SimulatorError("U has no rows: give one row for each sample.")
        if not np.all(np.isfinite(inputs)):
            row = int(np.flatnonzero(~np.isfinite(inputs).all(axis=1))[0])
            raise SimulatorError(
                f"U is not finite in row {row}: {inputs[row].tolist()}; interpolate or cut the record there."
            )
        return inputs

    def _check_x0(self, x0: Any) -> np.ndarray:
        """(n_states,) as float."""
        names = self._names("states")
        given = self.x0 if x0 is None else x0
        start = np.zeros(len(names)) if given is None else np.asarray(unmasked(given), dtype=float).reshape(-1)
        if start.shape != (len(names),):
            raise SimulatorError(
                f"x0 has {start.size} values, expected {len(names)}: one for each of states={list(names)}."
            )
        return start

    def _prepared(self, U: np.ndarray, t: Any) -> tuple[PlantModel, np.ndarray]:
        """Model and times, checked."""
        if self.hold not in ("zoh", "foh"):
            raise SimulatorError(f'hold={self.hold!r} is unknown: use "zoh" (held) or "foh" (joined linearly).')
        if not (isinstance(self.dt, (int, float, np.number)) and np.isfinite(self.dt) and self.dt > 0):
            raise SimulatorError(f"dt={self.dt!r} must be a positive number of time units.")
        model = PlantModel(describe(self))
        if not callable(self.output) and model.plant.output_states is None:
            unknown = [name for name in self._names("outputs") if name not in self._names("states")]
            raise SimulatorError(
                f"outputs={list(self._names('outputs'))}: {unknown[0]!r} is not one of states={list(self._names('states'))}; "
                "name a state, or give output=function(t, x, u, p)."
            )
        times = float(self.dt) * np.arange(U.shape[1]) if t is None else np.asarray(t, dtype=float)
        if times.shape != (U.shape[1],):
            raise SimulatorError(f"t has shape {times.shape}, expected ({U.shape[1]},): one time for each row of U.")
        if not np.all(np.diff(times) > 0):
            row = int(np.flatnonzero(~(np.diff(times) > 0))[0]) + 1
            raise SimulatorError(f"t={times[row]:g} in row {row} is not later than t={times[row - 1]:g} before it: sort the rows by time.")  # fmt: skip
        model.probe(U[0, 0])
        return model, times

    def _states(self, U: np.ndarray, X0: np.ndarray, t: Any) -> tuple[np.ndarray, np.ndarray, PlantModel]:
        """States (n_runs, n_samples, n_states), times, model."""
        model, times = self._prepared(U, t)
        if self.events:
            X = self._with_events(model, U, X0, times)
            raise_if_diverged(X, times, self._names("states"), said=model.refusal)
            return X, times, model
        order = 0 if self.hold == "zoh" else 1
        if self.method == "exact":
            X = exact_run(model.derivative, U, X0, times, order=order, states=self._names("states"))
        else:
            X = free_run(model.derivative, U, X0, times, order=order, method=self.method, many=model.takes_many)
        raise_if_diverged(X, times, self._names("states"), said=model.refusal)
        return X, times, model

    def _with_events(self, model: PlantModel, U: np.ndarray, X0: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States (n_runs, n_samples, n_states), sample by sample, all runs at once."""
        if self.hold != "zoh" or self.method not in ("auto", "RK4"):
            raise SimulatorError(
                f'events go with hold="zoh" and method="auto", here hold={self.hold!r} and method={self.method!r}.'
            )
        X = np.empty((U.shape[1], len(self._names("states")), len(U)))
        X[0] = X0.T
        with np.errstate(all="ignore"):
            for k in range(U.shape[1] - 1):
                X[k + 1] = model.step(times[k], X[k], U[:, k].T, float(times[k + 1] - times[k]))
        return X.transpose(2, 0, 1)

    def _run(self, U: np.ndarray, X0: np.ndarray, t: Any) -> np.ndarray:
        """Outputs (n_runs, n_samples, n_outputs)."""
        X, times, model = self._states(U, X0, t)
        Y = model.output(times, X.transpose(2, 0, 1), U.transpose(2, 0, 1)).transpose(1, 2, 0)
        if model.refusal:
            raise_if_diverged(Y, times, model.plant.outputs, said=model.refusal)
        return Y
