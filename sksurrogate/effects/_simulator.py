"""A simulator with effects in it: a simulator again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate._columns import by_name
from sksurrogate.effects._at_work import acting_in, is_null, paired, values_of
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import check_place
from sksurrogate.effects._families import BalanceEffect, HiddenEffect, ParameterEffect, SensorEffect
from sksurrogate.effects._free_run import augmented_states
from sksurrogate.effects._model import AugmentedModel, BoundModel
from sksurrogate.effects._pointwise import acting_params, entering_at, term_at
from sksurrogate.effects._small_signal import SampledPoint
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.effects._state_space_forms import graph_of, sampled_of, small_signal_of, steps_of
from sksurrogate.effects._trajectory import even_times, plain_runs, retuned_simulator, trajectory_runs
from sksurrogate.exceptions import SimulatorError
from sksurrogate.export._describe import SUBSTEPS
from sksurrogate.export._dynamic import substeps_of
from sksurrogate.export._graph import Graph
from sksurrogate.kernels.record import Record
from sksurrogate.physics._free_run import OF_SCIPY, raise_if_diverged
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import BaseSimulator, Plant, describe, units_of


def _is_pointwise(effect: BaseEffect) -> bool:
    """Whether an effect is a function of the present state, input and time."""
    if isinstance(effect, SensorEffect):
        return not effect.memory
    return isinstance(effect, ParameterEffect | BalanceEffect) and not isinstance(effect, HiddenEffect)


def _has_rhs(self: AugmentedSimulator) -> bool:
    """Whether the simulator with its effects is a right-hand side of its own states."""
    return describe(self.simulator).access == "rhs" and all(map(_is_pointwise, self.effects))


def _has_output(self: AugmentedSimulator) -> bool:
    """Whether outputs are more than states by name."""
    own = callable(getattr(self.simulator, "output", None))
    return _has_rhs(self) and (own or any(isinstance(effect, SensorEffect) for effect in self.effects))


class AugmentedSimulator(BaseSimulator):
    """A simulator with effects added and parameters re-tuned.

    Parameters
    ----------
    simulator : object with ``simulate``
    effects : sequence of BaseEffect, default=()
        Instances with their places.
    values : sequence of dict or tuple, default=()
        For each effect its parameters: ``{"level": 0.3}``, or in the order of ``effect.parameters``.
    retuned : dict of float, optional
        Parameters of the simulator that differ from its own.
    runs : sequence, optional
        For each effect the labels of the runs in which it acts, None for all. :meth:`simulate` acts as where all do,
        :meth:`in_run` gives the simulator of one run.
    scale : array-like (n_states,), optional
        Size of every state. Kinks such as sign(v) are smoothed over the size of v divided by ``sharpness``; by default
        the sizes are those of the free run without effects.
    sharpness : float, default=500
        The larger, the sharper the kinks, the smaller the substeps.

    Attributes
    ----------
    states, inputs, outputs, params, dt, hold, x0, units
        Those of the simulator; ``params`` with the re-tuned values.

    Notes
    -----
    ``x0`` holds the states of the simulator; the effects' own states start at rest, filters at their first input.
    Simulators that only give trajectories take effects on inputs (as means over a sample), sensors and parameters.
    Effects at their null value leave the simulator as it is. ``rhs`` and ``output`` exist where no effect has a memory,
    acts on an input or is a limit: then everything that needs a right-hand side can use the simulator. ``to_graph``,
    ``to_casadi``, ``to_c``, ``linearise`` and ``to_control`` take all effects: memories become states.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.effects import CATALOGUE, AugmentedSimulator
    >>> from sksurrogate.physics import ODESimulator
    >>> def rhs(t, x, u, p):
    ...     return (u[0] - p["k"] * x[0],)
    >>> plant = ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={"k": 1.0}, dt=0.1)
    >>> leak = CATALOGUE["linear_loss"]("x", "x")
    >>> wet = AugmentedSimulator(plant, [leak], [{"coefficient": 1.0}])
    >>> wet.simulate(np.ones((3, 1))).ravel().round(4)  # (1 - exp(-2 t)) / 2
    array([0.    , 0.0906, 0.1648])
    """

    def __init__(
        self,
        simulator: Any,
        effects: Sequence[BaseEffect] = (),
        values: Sequence[Any] = (),
        retuned: Mapping[str, float] | None = None,
        runs: Sequence[Sequence[Any] | None] | None = None,
        *,
        scale: Any = None,
        sharpness: float = KINK_SHARPNESS,
    ):
        self.simulator = simulator
        self.effects = effects
        self.values = values
        self.retuned = retuned
        self.runs = runs
        self.scale = scale
        self.sharpness = sharpness

    def in_run(self, label: Any) -> AugmentedSimulator:
        """The simulator of one run, by its label as in ``groups``: with the effects that act in it.

        Raises
        ------
        SimulatorError
            A run is listed under the same text, but is of another type.
        """
        kept = acting_in(self.effects, self.runs, label)
        chosen = [self.effects[k] for k in kept], [self.values[k] for k in kept]
        return AugmentedSimulator(self.simulator, *chosen, self.retuned, scale=self.scale, sharpness=self.sharpness)

    # ---- what a simulator shows -------------------------------------------------------------------------------------
    @property
    def states(self) -> Any:
        """Names of the states of the simulator; None where it has none."""
        return self._named("states")

    @property
    def inputs(self) -> Any:
        """Names of the inputs."""
        return self._named("inputs")

    @property
    def outputs(self) -> Any:
        """Names of the outputs."""
        return self._named("outputs")

    @property
    def params(self) -> dict[str, float]:
        """Parameters by name, re-tuned."""
        return {**dict(getattr(self.simulator, "params", None) or {}), **dict(self.retuned or {})}

    @property
    def dt(self) -> Any:
        """Sample time."""
        return getattr(self.simulator, "dt", None)

    @property
    def hold(self) -> str:
        """How inputs act between samples."""
        return str(getattr(self.simulator, "hold", "zoh"))

    @property
    def units(self) -> dict[str, str]:
        """Units by name, as far as the simulator knows them."""
        return units_of(self.simulator)

    @property
    def x0(self) -> Any:
        """Initial states by default."""
        return self._named("x0")

    def _named(self, what: str) -> Any:
        """What the simulator was given, else what it knows by itself."""
        given = getattr(self.simulator, what, None)
        if given is None and callable(getattr(self.simulator, "described", None)):
            return self.simulator.described().get(what)
        return given

    def set_params(self, **params: Any) -> AugmentedSimulator:
        """Set constructor arguments, or single parameters of the simulator as ``params__k=2.0``."""
        single = {key.removeprefix("params__"): params.pop(key) for key in list(params) if key.startswith("params__")}
        if params:
            super().set_params(**params)
        if single:
            unknown = sorted(set(single) - set(self.params))
            if unknown:
                raise ValueError(
                    f"params__{unknown[0]}: the simulator has no such parameter, only {sorted(self.params)}."
                )
            self.retuned = {**dict(self.retuned or {}), **single}
        return self

    # ---- simulation -------------------------------------------------------------------------------------------------
    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: U (n_samples, n_inputs) -> Y (n_samples, n_outputs).

        Parameters
        ----------
        U : array-like (n_samples, n_inputs)
        x0 : array-like (n_states,), optional
            States of the simulator at the first row.
        t : array-like (n_samples,), optional
            Evenly spaced times: the simulator's own. Effects count theirs from the first row.

        Raises
        ------
        SimulationDiverged
            A state became infinite or nan.
        SimulatorError
            U, x0, t, values or places do not fit.
        """
        inputs = np.asarray(by_name(U, self.inputs), dtype=float)
        if inputs.ndim == 1:
            inputs = inputs[:, None]
        start = None if x0 is None else np.asarray(x0, dtype=float).reshape(1, -1)
        return self.simulate_batch(inputs[None], start, t)[0]

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs at once: U (n_runs, n_samples, n_inputs) -> Y (n_runs, n_samples, n_outputs)."""
        inputs, plant, effects, theta = self._read(U)
        if not effects:
            return plain_runs(plant.simulator, inputs, X0, t)
        if plant.access == "trajectory":
            return trajectory_runs(plant, effects, theta, inputs, X0, t)
        X, bound, _ = self._states(plant, effects, theta, inputs, X0, t)
        Y = bound.outputs(X[:, None], sharp=True)[:, 0]
        return Y.reshape(len(Y), len(inputs), -1).transpose(1, 2, 0)

    def simulate_states(self, U: Any, x0: Any = None, t: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """States of the simulator and their derivatives of one run, both (n_samples, n_states)."""
        inputs, plant, effects, theta = self._read(np.asarray(U, dtype=float)[None])
        if plant.access == "trajectory":
            raise SimulatorError(f"{type(self.simulator).__name__} gives no states: it has neither rhs nor step.")
        X, bound, _ = self._states(plant, effects, theta, inputs, None if x0 is None else np.reshape(x0, (1, -1)), t)
        n = len(plant.states)
        if plant.access == "step":
            return X[:n].T, np.gradient(X[:n], bound.record.dt, axis=1).T
        return X[:n].T, bound.derivative(bound.record.t, X[:, None], bound.shown)[:n, 0].T

    def substeps(self, U: Any, x0: Any = None, t: Any = None) -> int:
        """Runge-Kutta steps per sample that :meth:`simulate` takes for these inputs: an export with as many gives the same run.

        Parameters
        ----------
        U, x0, t
            As for :meth:`simulate`.

        Raises
        ------
        SimulatorError
            scipy's integrator simulates the run with variable steps, the simulator gives trajectories only, or kinks are
            smoothed over sizes that an export does not know: the message gives them.

        Examples
        --------
        >>> from sksurrogate.datasets import make_reactor
        >>> from sksurrogate.effects import CATALOGUE, AugmentedSimulator
        >>> slow = AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [{"time_constant": 0.05}])
        >>> n_sub = slow.substeps([[0.15]] * 50, x0=[4.0])
        >>> graph = slow.to_graph(n_sub)
        """
        inputs, plant, effects, theta = self._read(np.asarray(U, dtype=float)[None])
        if not effects and callable(getattr(plant.simulator, "substeps", None)):
            return int(plant.simulator.substeps(U, x0, t))
        if plant.access == "trajectory":
            raise SimulatorError(f"{type(self.simulator).__name__} gives trajectories only: its steps are not known.")
        X, bound, fixed = self._states(
            plant, effects, theta, inputs, None if x0 is None else np.reshape(x0, (1, -1)), t
        )
        if not fixed:
            raise SimulatorError(OF_SCIPY)
        return steps_of((plant, effects, theta), X, bound, self.scale, self.sharpness)

    # ---- where nothing has a memory ---------------------------------------------------------------------------------
    @available_if(_has_rhs)
    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> list[Any]:
        """dx/dt with the effects (kinks are sharp unless ``scale`` is given)."""
        states, acting = list(self.states), acting_params(self, t, x, u, p)
        laws = [(e, g) for e, g in paired(self.effects, self.values) if isinstance(e, BalanceEffect)]
        enters, forces = self._entering(t, x, u, acting)
        dx = list(self.simulator.rhs(t, x, enters, acting, *forces))
        for effect, given in laws:
            if effect.location in states:
                i = states.index(str(effect.location))
                dx[i] = dx[i] + term_at(self, effect, given, t, x, u, x[i])
        return dx

    def _entering(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> tuple[Any, tuple[Any, ...]]:
        """The inputs with the laws at them, and what enters at further ports."""
        laws = [(e, g) for e, g in paired(self.effects, self.values) if isinstance(e, BalanceEffect)]
        return entering_at(self, t, x, u, p, [(e, g) for e, g in laws if e.location not in list(self.states)])

    @available_if(_has_output)
    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> list[Any]:
        """Readings of the sensors."""
        names = list(self.outputs)
        if callable(getattr(self.simulator, "output", None)):
            params = acting_params(self, t, x, u, p)
            enters, forces = self._entering(t, x, u, params)
            plain = list(self.simulator.output(t, x, enters, params, *forces))
        else:
            plain = [x[list(self.states).index(name)] for name in names]
        y = list(plain)
        acting = [(e.order, e, g) for e, g in paired(self.effects, self.values) if isinstance(e, SensorEffect)]
        for _, effect, given in sorted(acting, key=lambda item: item[0]):
            i = names.index(str(effect.location))
            beside = effect.beside(names, plain, list(self.inputs), u)
            y[i] = effect.read(y[i], beside, t, values_of(effect, given))
        return y

    # ---- where it goes to -------------------------------------------------------------------------------------------
    def to_graph(self, n_sub: int | None = None) -> Graph:
        """The simulator with its effects as ``x_next, y = f(x, u)`` over a sample, for CasADi, C and ONNX.

        The state holds the states of the simulator, then those of laws, actuators and sensors with a memory, then the time
        where something depends on it: ``graph.states`` names them, :meth:`start_state` gives them at the start of a run.
        The formulae are those of :meth:`simulate` in ``n_sub`` (default: 4) substeps of Runge-Kutta's method;
        :meth:`substeps` gives the number with which both are equal.
        """
        return graph_of(self._parts(), substeps_of(n_sub, SUBSTEPS), self.scale, self.sharpness)

    def start_state(self, x0: Any = None, u0: Any = None, n_sub: int | None = None) -> np.ndarray:
        """All states of :meth:`to_graph` at the start of a run.

        Parameters
        ----------
        x0 : array-like (n_states,), optional
            States of the simulator; its own initial states by default.
        u0 : array-like (n_inputs,), optional
            First row of the inputs; 0 by default.
        n_sub : int, optional
            As in :meth:`to_graph`.

        Returns
        -------
        ndarray (n_all_states,)
        """
        parts = self._parts()
        x = parts[0].x0 if x0 is None else np.asarray(x0, dtype=float).ravel()
        u = np.zeros(len(parts[0].inputs)) if u0 is None else np.asarray(u0, dtype=float).ravel()
        started = SampledPoint(sampled_of(parts, substeps_of(n_sub, SUBSTEPS), self.scale, self.sharpness)).complete(
            x, u
        )
        timed = len(self.to_graph(n_sub).states or ()) - len(started)
        return np.append(started, np.zeros(timed))

    def small_signal(self, pade: int = 2) -> Any:
        """What :func:`~sksurrogate.physics.linearise` reads: the simulator with the states of its effects, delays by Pade."""
        return small_signal_of(self._parts(), pade, self.scale, self.sharpness)

    def to_control(self, n_sub: int | None = None) -> Any:
        """``control.NonlinearIOSystem``: continuous without memories and limits, else from sample to sample, with all states.

        With ``n_sub`` from sample to sample in any case, in so many substeps; without it in 16.
        """
        if n_sub is None and _has_rhs(self):
            return super().to_control()
        form = sampled_of(self._parts(), substeps_of(n_sub, 16), self.scale, self.sharpness)
        return BaseSimulator.to_control(SampledPoint(form))  # type: ignore[arg-type]

    def _parts(self) -> tuple[Plant, list[BaseEffect], np.ndarray]:
        """The plant, and the effects at work with their parameters."""
        names = list(self.inputs or ())
        _, plant, effects, theta = self._read(np.zeros((1, 1, len(names))))
        return plant, effects, theta

    # ---- helpers ----------------------------------------------------------------------------------------------------
    def _read(self, U: Any) -> tuple[np.ndarray, Plant, list[BaseEffect], np.ndarray]:
        """Inputs (n_runs, n_samples, n_inputs), the re-tuned plant, the effects at work, their parameters in a row."""
        inputs = np.asarray(U, dtype=float)
        plant = describe(retuned_simulator(self.simulator, self.retuned))
        if inputs.ndim != 3 or (plant.inputs and inputs.shape[2] != len(plant.inputs)):
            expected = f"(n_samples, {len(plant.inputs)}): one column for each of inputs={list(plant.inputs)}"
            raise SimulatorError(
                f"U has shape {inputs.shape[1:] if len(inputs) == 1 else inputs.shape}, expected {expected}."
            )
        if not plant.inputs:
            plant = replace(plant, inputs=tuple(f"u{k}" for k in range(inputs.shape[2])))
        kept: list[BaseEffect] = []
        numbers: list[float] = []
        for effect, given in paired(self.effects, self.values):
            theta = values_of(effect, given)
            if np.isnan(theta).any():
                raise SimulatorError(f"values of {effect!r}: got {given!r}, expected numbers.")
            if not (plant.access == "trajectory" and not plant.outputs):
                check_place(effect, plant)
            if not is_null(effect, theta):
                kept.append(effect)
                numbers.extend(theta)
        return inputs, plant, kept, np.array(numbers)

    def _states(
        self, plant: Plant, effects: list[BaseEffect], theta: np.ndarray, inputs: np.ndarray, X0: Any, t: Any
    ) -> tuple[np.ndarray, BoundModel, bool]:
        """States (n_states with hidden ones, n_runs * n_samples), the model that made them, whether in fixed steps."""
        start = np.broadcast_to(
            plant.x0 if X0 is None else np.asarray(X0, dtype=float), (len(inputs), len(plant.states))
        )
        times, dt, begins = even_times(t, inputs.shape[1], plant.dt)
        empty = np.zeros((len(times), len(plant.outputs)))
        record = Record.from_runs(list(inputs), [empty] * len(inputs), [times] * len(inputs), dt)
        model = PlantModel(plant, begins)
        model.probe(inputs[0, 0])

        def augmented(n_sub: int, scale: np.ndarray, bare: bool = False) -> BoundModel:
            chosen, numbers = ((), np.zeros((0, 1))) if bare else (effects, theta[:, None])
            whole = AugmentedModel(model, chosen, (), record, n_sub=n_sub, scale=scale, sharpness=self.sharpness)
            return whole.bind(numbers)

        scale = None if self.scale is None else np.asarray(self.scale, dtype=float)
        if scale is not None and scale.shape not in ((), (1,), (len(plant.states),)):
            raise SimulatorError(f"scale has shape {scale.shape}, expected one size for each of {list(plant.states)}.")
        scale = None if scale is None else np.broadcast_to(scale, (len(plant.states),))
        method = str(getattr(plant.simulator, "method", "auto")).replace("exact", "auto")  # effects are not linear
        with np.errstate(all="ignore"):
            X, bound, fixed = augmented_states(augmented, start.T, scale, method)
        own = tuple(f"{e.name} ({k})" for e in effects for k in range(getattr(e, "n_hidden", 0)))
        raise_if_diverged(X.reshape(len(X), len(inputs), -1).transpose(1, 2, 0), times + begins, plant.states + own)
        return X, bound, fixed
