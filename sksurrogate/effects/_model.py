"""The augmented model, a plant with effects and re-tuned parameters: a :class:`~sksurrogate.kernels.free_run_model.FreeRunModel`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import (
    BalanceEffect,
    HiddenEffect,
    InputEffect,
    LimitEffect,
    ParameterEffect,
    SensorEffect,
)
from sksurrogate.effects._input import within_runs
from sksurrogate.effects._limit import in_force
from sksurrogate.effects._onset import Starting, edges_of, kinks_of, timed
from sksurrogate.effects._parameter import constant_in_time
from sksurrogate.effects._readings import read_sensors
from sksurrogate.effects._variable import driver_of
from sksurrogate.effects._whole_step import has_own_steps, held_for, own_run, whole_step
from sksurrogate.effects._wires import beside, entering, kink_width, wire_of
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.integrate import closing_weight, rk4
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.signals import Signal, stacked
from sksurrogate.physics._model import PlantModel


class AugmentedModel:
    """A plant with effects and free parameters over a record.

    The parameter vector ``theta`` holds the parameters of every effect in turn, then one number per free parameter: the
    logarithm of its factor, or what is added to it where its nominal value is 0.

    ``free``: names of the parameters that are re-tuned.
    ``n_sub``: substeps per sample.
    ``scale`` (n_nominal_states,): size of every state.
    ``sharpness``: kinks are smoothed over a variable's size divided by it.
    """

    def __init__(
        self,
        model: PlantModel,
        effects: Sequence[BaseEffect],
        free: Sequence[str],
        record: Record,
        *,
        n_sub: int,
        scale: np.ndarray,
        sharpness: float = 50.0,
    ):
        self.model, self.plant, self.record = model, model.plant, record
        self.effects, self.free = tuple(effects), tuple(free)
        self.n_sub, self.sharpness = n_sub, sharpness
        self.n_nominal = len(self.plant.states)
        self._slices: list[slice] = []
        position = 0
        for effect in self.effects:
            self._slices.append(slice(position, position + len(effect.parameters)))
            position += len(effect.parameters)
        self.n_theta = position + len(self.free)
        self.free_slice = slice(position, self.n_theta)
        self._hidden: dict[int, slice] = {}
        n = self.n_nominal
        for i, effect in enumerate(self.effects):
            if isinstance(effect, HiddenEffect):
                self._hidden[i] = slice(n, n + effect.n_hidden)
                n += effect.n_hidden
        self.n_states = n
        self.nominal_scale = np.asarray(scale, dtype=float)
        self.input_scale = np.maximum(np.max(np.abs(record.u), axis=1), 1e-12) if len(record.u) else np.empty(0)
        self.wires = [wire_of(e, model, lambda one: self._size(one) / sharpness) for e in self.effects]
        self.scale = np.concatenate(
            [
                self.nominal_scale,
                [self._size(self.effects[i]) for i, s in self._hidden.items() for _ in range(s.start, s.stop)],
            ]
        )

    def _size(self, effect: BaseEffect) -> float:
        """Size of the variable of an effect."""
        return float(np.prod([self._signal_size(name) for name in effect.signals])) if effect.variable else 1.0

    def _signal_size(self, name: str) -> float:
        if name in self.plant.states:
            return float(self.nominal_scale[self.plant.states.index(name)])
        return float(self.input_scale[self.plant.inputs.index(name)])

    @property
    def held(self) -> list[Signal]:
        """Every input as it was recorded before it was cut, between the samples too."""
        return self.record.uncut.held(self.n_sub, self.record.order_of_inputs(self.plant.hold))

    @property
    def plain_inputs(self) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Inputs that act and those at the samples, where no effect changes them."""
        return self.record.acting(self.n_sub, self.record.order_of_inputs(self.plant.hold))

    def bind(self, theta: np.ndarray) -> BoundModel:
        """The model at parameter vectors ``theta`` (n_theta, n_columns)."""
        return BoundModel(self, theta)

    def parameters_of(self, i: int, theta: np.ndarray) -> list[np.ndarray]:
        """Parameters of effect i as a list of arrays (n_columns, 1)."""
        return [row[:, None] for row in theta[self._slices[i]]]

    def slice_of(self, i: int) -> slice:
        """Where the parameters of effect i stand in theta."""
        return self._slices[i]

    def hidden_of(self, i: int) -> slice:
        """Where the hidden states of effect i stand among the states."""
        return self._hidden[i]

    def variable(self, i: int, x: np.ndarray, u: np.ndarray) -> Any:
        """Values of the variable of effect i: an array, a pair for "v*w", None where there is none."""
        found = tuple(x[place] if is_state else u[place] for is_state, place in self.wires[i].drivers)
        return driver_of(self.effects[i].variable, found)

    def force_of(
        self, i: int, t: Any, x: np.ndarray, u: np.ndarray, parameters: Sequence[Any], width: Any, varied: Any = None
    ) -> Any:
        """What law i adds to its dx/dt, or to what enters at its port, with these parameters, its kinks smoothed over a width."""
        effect, v = self.effects[i], self.variable(i, x, u)
        assert isinstance(effect, BalanceEffect)
        if i in self._hidden:
            force = effect.force(x[self._hidden[i]], v, parameters)  # type: ignore[attr-defined]
            return effect.within(t, parameters, edges_of(width)) * force if isinstance(effect, Starting) else force
        wire = self.wires[i]
        if wire.port < 0:
            return effect.term(t, x[wire.place], v, parameters, width)
        own = beside(self.model, effect, wire.port, x[: self.n_nominal], u, varied)
        return effect.term(t, np.broadcast_to(own, x.shape[1:]), v, parameters, width)

    @property
    def free_states(self) -> np.ndarray:
        """Which initial states are unknown: all nominal ones, and hidden ones that need not have been at rest."""
        known = np.ones(self.n_states, dtype=bool)
        for i, rows in self._hidden.items():
            known[rows] = not self.effects[i].at_rest
        return known

    @property
    def plain_outputs(self) -> tuple[int, ...] | None:
        """Positions of the states that are the outputs; None with an output function or a sensor effect."""
        if self.record.offset is not None or any(isinstance(effect, SensorEffect) for effect in self.effects):
            return None
        if self.plant.output_states is None:
            return None
        shown = dict(enumerate(self.plant.output_states)) | self.shown_memories
        return tuple(shown.values())

    @cached_property
    def shown_memories(self) -> dict[int, int]:
        """Hidden states that sensors show in place of an output: its position -> that of the state."""
        sensors = ((i, rows) for i, rows in self._hidden.items() if self.effects[i].kind == "output")
        return {self.plant.outputs.index(str(self.effects[i].location)): rows.start for i, rows in sensors}

    @property
    def may_jump(self) -> bool:
        """Whether the map is a simulator's own step."""
        return self.plant.access == "step"

    @property
    def steps_many(self) -> bool:
        """Whether this step takes many samples in one call."""
        return self.model.steps_many

    @property
    def runs_at_once(self) -> bool:
        """Whether a free run is one call of a simulator that steps: nothing acts within its steps."""
        return (
            self.may_jump
            and not self.shown_memories
            and all(
                effect.kind in ("input", "output") or wire.parameter is not None or constant_in_time(effect)
                for effect, wire in zip(self.effects, self.wires)
            )
        )

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size to which every state of a free run is closed."""
        return closing_weight(self.scale, self.record.spread, sd, self.plant.output_states)


class BoundModel:
    """An :class:`AugmentedModel` with its parameters filled in: a step map over all samples, and its outputs.

    ``theta`` (n_theta, n_columns).
    """

    def __init__(self, augmented: AugmentedModel, theta: np.ndarray):
        self.a = augmented
        self.theta = theta
        self.record = augmented.record
        self.h = self.record.dt / augmented.n_sub
        self.followed = self.h  #: Step in which fast memories are followed
        self._parameters = [augmented.parameters_of(i, theta) for i in range(len(augmented.effects))]
        wires = augmented.wires
        laws = [i for i, effect in enumerate(augmented.effects) if isinstance(effect, BalanceEffect)]
        self._balances = [i for i in laws if wires[i].place >= 0]
        self._at_ports = [i for i in laws if wires[i].port >= 0 and wires[i].parameter is None]
        self._as_parameters = [i for i in laws if wires[i].parameter is not None]
        self.held = held_for(augmented.plant, self.record.dt, self.h)
        self._widths = [
            kink_width(effect, wire, values, self.held if wire.port >= 0 else self.h)
            for effect, wire, values in zip(augmented.effects, wires, self._parameters)
        ]
        effects = augmented.effects
        for i in [i for i, effect in enumerate(effects) if isinstance(effect, Starting)]:
            self._widths[i] = self._widths[i], self.h  # kinks: a width of the variable, edges: of time
        self._has_limits = any(isinstance(effect, LimitEffect) for effect in effects)
        #: Whether parameters change within a run
        self.moves_params = any(isinstance(e, ParameterEffect) and not constant_in_time(e) for e in effects)
        params = augmented.plant.params
        free = zip(augmented.free, theta[augmented.free_slice])
        self._retuned = {name: retuned(params[name], row[:, None]) for name, row in free}
        self._constant_params = None
        self._constant_params = None if self.moves_params else self.params_at(0.0)
        self._mean, self._half, self.shown = self._inputs()
        changed = any(isinstance(effect, InputEffect) for effect in effects)
        #: Whether effects change inputs within a sample that the simulator takes in steps of its own
        self.moves_within = changed and has_own_steps(augmented.plant) and bool(np.any(self._mean != self._mean[:1]))

    @property
    def widths(self) -> list[float]:
        """Width of the kinks of every effect, in its variable."""
        return [float(np.ravel(kinks_of(width))[0]) for width in self._widths]

    # ---- parameters -------------------------------------------------------------------------------------------------
    def params_at(self, t: Any, x: Any = None, u: Any = None) -> dict[str, np.ndarray]:
        """Parameters that differ from their nominal values, (n_columns, 1) or (n_columns, n_samples), at a time, states and inputs."""
        if self._constant_params is not None:
            return self._constant_params
        params, varied = self.a.plant.params, dict(self._retuned)
        for i, (effect, values) in enumerate(zip(self.a.effects, self._parameters)):
            if isinstance(effect, ParameterEffect) and effect.location is not None:
                driver = () if effect.variable is None else (self.a.variable(i, x, u),)
                before = varied.get(effect.location, params[effect.location])
                varied[effect.location] = effect.value(before, t, values, self.h, *driver)
        for i in self._as_parameters:
            name, value = self.a.wires[i].parameter or ("", 0.0)
            varied[name] = varied.get(name, value) + self._parameters[i][0]
        return varied

    # ---- inputs -----------------------------------------------------------------------------------------------------
    def _inputs(self) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Inputs that act: (n_sub, n_inputs, n_columns | 1, n_samples); those at the samples (n_inputs, n_columns | 1, n_samples)."""
        a, record = self.a, self.record.uncut
        acting = [(e.order, i, e) for i, e in enumerate(a.effects) if isinstance(e, InputEffect)]
        if not acting:
            return a.plain_inputs
        signals = list(a.held)
        given = list(signals)
        own = [row for _, i, _ in acting for row in range(*a.slice_of(i).indices(a.n_theta))]
        # Columns that perturb something else share one path of the input.
        _, first, column = np.unique(self.theta[own], axis=1, return_index=True, return_inverse=True)
        for _, i, effect in sorted(acting, key=lambda item: item[:2]):
            place = a.plant.inputs.index(str(effect.location))
            other = given[a.plant.inputs.index(effect.variable)] if effect.variable else None
            distinct = [row[first, None] for row in self.theta[a.slice_of(i)]]
            own_path = within_runs(timed(effect, record.t), record.whole_starts).transform
            signals[place] = own_path(signals[place], other, distinct, self.h, record.recorded_starts)
        mean, half, shown = self.record.of_uncut(*stacked(signals))
        if mean.shape[2] > 1:
            column = np.ravel(column)
            mean, half = mean[:, :, column], None if half is None else half[:, :, column]
        return mean, half, shown[:, column] if shown.shape[1] > 1 else shown

    # ---- dynamics ---------------------------------------------------------------------------------------------------
    def __call__(self, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """States (n_states, n_columns, n_samples) one sample later; with ``rows``, only those samples."""
        check_time()
        t, mean, half = self.record.t, self._mean, self._half
        if rows is not None:
            t, mean, half = t[rows], mean[..., rows], None if half is None else half[..., rows]
        if self.a.plant.access == "step":
            x = whole_step(self, t, x, mean, bool(self._balances or self.a._hidden), bool(self._at_ports))
            return self.clip(x, t + self.record.dt, True) if self._has_limits else x
        clip = self.clip if self._has_limits else None
        h: float | np.ndarray = self.h
        if self.record.steps is not None:
            h = (self.record.steps if rows is None else self.record.steps[rows]) / len(mean)
        return rk4(self.derivative, t, x, mean, half, h, clip)

    def run(self, x0: np.ndarray) -> np.ndarray | None:
        """Free run (n_states, n_samples) from initial states (n_states, n_runs) by the simulator itself.

        None where it offers none, or an effect acts within its steps that is no law at a port.
        """
        within = self._balances or self._has_limits or self.moves_params or self.a.shown_memories
        return None if within or not self.a.may_jump else own_run(self, x0, self._mean, bool(self._at_ports))

    def entering(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What enters at the ports: the inputs ``u``, with the laws that act there."""
        if not self._at_ports:
            return u
        a, loaded = self.a, any(self.a.effects[i].of_load for i in self._at_ports)  # type: ignore[attr-defined]
        varied = self.params_at(t, x, u) if loaded else None
        given = [(i, t, x, u, self._parameters[i], self._widths[i], varied) for i in self._at_ports]
        return entering(a.plant, u, [(a.wires[one[0]].port, a.force_of(*one)) for one in given], x.shape[1:])

    def derivative(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dx/dt with the effects."""
        n = self.a.n_nominal
        nominal = self.a.model.derivative(t, x[:n], self.entering(t, x, u), self.params_at(t, x, u))
        if not self.a.effects:
            return nominal
        dx = nominal
        if self.a.n_states > n:
            dx = np.empty((self.a.n_states, *nominal.shape[1:]), dtype=nominal.dtype)
            dx[:n] = nominal
        dx = self.rates_of_effects(t, x, u, dx)
        states = self.a.plant.states
        for i, effect in enumerate(self.a.effects if self._has_limits else ()):
            if isinstance(effect, LimitEffect) and effect.variable:
                place, other = states.index(str(effect.location)), states.index(effect.variable)
                how, rates = (effect, t, self._parameters[i], self.h), (dx[place], dx[other])
                at_limit = effect.flow(x[place], *rates, self._parameters[i])
                dx[place], dx[other] = (in_force(*how, *pair) for pair in zip(rates, at_limit))
        return dx

    def rates_of_effects(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, dx: np.ndarray) -> np.ndarray:
        """Add the terms of the balance effects to ``dx`` and fill in the rates of the hidden states."""
        a = self.a
        for i in self._balances:
            dx[a.wires[i].place] += a.force_of(i, t, x, u, self._parameters[i], self._widths[i])
        for i, rows in a._hidden.items():
            effect, v = a.effects[i], self.a.variable(i, x, u)
            is_state, driver = a.wires[i].drivers[0]
            dv = dx[driver] if is_state else np.zeros_like(v)
            given = (x[rows], t, v, dv, self._parameters[i], self._widths[i], self.followed)
            rates = effect.rates_within(*given)  # type: ignore[attr-defined]
            for row, rate in zip(range(rows.start, rows.stop), rates):
                dx[row] = rate
        return dx

    def acting(self, t: int | None) -> np.ndarray:
        """Inputs that act in substep t, or in the mean over the sample (n_inputs, n_columns | 1, n_samples)."""
        return np.asarray(np.mean(self._mean, axis=0) if t is None else self._mean[t])

    def clip(self, x: np.ndarray, t: Any, final: bool = False) -> np.ndarray:
        """Limits on states at a time: of what a step has brought beyond a limit, the share of the step that the limit is in force."""
        x, step = x.copy(), self.record.dt if self.a.plant.access == "step" else self.h
        for i, effect in enumerate(self.a.effects):
            if isinstance(effect, LimitEffect):
                named = effect.location, effect.variable
                place, other = (self.a.plant.states.index(name) if name else None for name in named)
                theta = self._parameters[i]
                how = effect, t - 0.5 * step, theta, 0.5 * step
                limited, received = effect.clip(x[place], None if other is None else x[other], theta, final)
                x[place] = in_force(*how, x[place], limited)
                if other is not None and received is not None:
                    x[other] = in_force(*how, x[other], received)
        return x

    def start(self, x0: np.ndarray) -> np.ndarray:
        """Initial states, hidden ones at rest: (n_nominal, n_columns, n_runs) -> (n_states, n_columns, n_runs)."""
        a = self.a
        out = np.zeros((a.n_states, *x0.shape[1:]))
        out[: a.n_nominal] = x0
        u0 = self.shown[..., self.record.starts]
        for i, effect in enumerate(a.effects):
            if isinstance(effect, HiddenEffect):
                v = np.broadcast_to(self.a.variable(i, x0, u0), x0.shape[1:])
                for row, value in zip(out[a.hidden_of(i)], effect.rest(v, self._parameters[i])):
                    row[:] = value
        return self.clip(out, self.record.t[self.record.starts]) if self._has_limits else out

    # ---- outputs ----------------------------------------------------------------------------------------------------
    def outputs(self, x: np.ndarray, sharp: bool = False) -> np.ndarray:
        """Readings of the sensors (n_outputs, n_columns, n_samples) along states (n_states, n_columns, n_samples).

        Readings that jump are smoothed as kinks are, unless ``sharp``.
        """
        a, record = self.a, self.record
        shown = self.shown if a.plant.output_states is not None else self.entering(record.t, x, self.shown)
        y = a.model.output(record.t, x[: a.n_nominal], shown, self.params_at(record.t, x, self.shown))
        if a.shown_memories:
            y = np.array(y)
            y[list(a.shown_memories)] = x[list(a.shown_memories.values())]
        sensors = [(i, effect) for i, effect in enumerate(a.effects) if isinstance(effect, SensorEffect)]
        if not sensors and record.offset is None:
            return y
        return read_sensors(self, x, y, [(e, self._parameters[i]) for i, e in sensors], sharp)

    def true_outputs(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What the sensors measure at a time, states and inputs."""
        return self.a.model.output(t, x[: self.a.n_nominal], self.entering(t, x, u), self.params_at(t, x, u))

    @property
    def held_before(self) -> np.ndarray:
        """Inputs that act just before the samples (n_inputs, n_columns | 1, n_samples)."""
        last = self._mean[-1] if self._half is None else self._mean[-1] + self._half[-1]
        return np.concatenate([last[..., :1], last[..., :-1]], axis=-1)


def retuned(nominal: float, phi: Any) -> Any:
    """A free parameter: nominal times exp(phi), or phi itself where the nominal value is 0."""
    return phi if nominal == 0 else nominal * np.exp(phi)
