"""A simulator with effects as a map from one sample to the next: memories of actuators, sensors and laws are states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect, InputEffect, SensorEffect
from sksurrogate.effects._free_run import SUBSTEPS_OF_SHARP
from sksurrogate.effects._one_sample import InputInSample, Pieces, SensorInSample
from sksurrogate.effects._points import PointModel, bound_at_points, stacked
from sksurrogate.effects._whole_step import whole_step
from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.integrate import rk4
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant


def point_model(plant: Plant, effects: Sequence[BaseEffect], n_sub: int, scale: Any, sharpness: float) -> PointModel:
    """The augmented model at single points; kinks are sharp where the sizes of the states are not known."""
    n = len(plant.inputs)
    record = Record.from_runs(
        [np.zeros((2, n))], [np.zeros((2, len(plant.outputs)))], [plant.dt * np.arange(2.0)], plant.dt
    )
    model = PlantModel(plant)
    sizes = np.zeros(len(plant.states)) if scale is None else np.broadcast_to(np.asarray(scale, float), plant.x0.shape)
    return PointModel(model, effects, (), record, n_sub=n_sub, scale=sizes, sharpness=sharpness)


def names_of_memory(effect: BaseEffect, size: int) -> list[str]:
    """Names of the states that an effect adds."""
    base = f"{effect.name}_{effect.location}"
    return [base] if size == 1 else [f"{base}_{k}" for k in range(size)]


class SampledForm:
    """``x_next, y = f(x, u)`` of a simulator with effects, the input held.

    ``plant``: with access "rhs" or "step".
    ``theta`` (n_theta,): their parameters in a row.
    ``n_sub``: Runge-Kutta substeps of a right-hand side.
    ``scale`` (n_states,): sizes of the states, over which kinks are smoothed.
    ``symbols``: whether the states are symbols of a graph.
    ``states``: those of the simulator, then those of laws, actuators and sensors. A slow sensor of a simulator without
        a right-hand side also keeps how much its output rose in the sample before (``OUTPUT_rise``).
    """

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[BaseEffect],
        theta: np.ndarray,
        *,
        n_sub: int,
        scale: Any,
        sharpness: float,
        symbols: bool = False,
    ):
        if plant.hold != "zoh":
            raise SimulatorError(
                f'hold="{plant.hold}" has no state-space form: a step needs its input held, hold="zoh".'
            )
        n_sub = SUBSTEPS_OF_SHARP if plant.access == "step" else n_sub
        whole = point_model(plant, effects, n_sub, scale, sharpness)
        self.plant, self.n_sub = plant, n_sub
        self.bound = bound_at_points(whole, theta, symbols)
        self.n_model = whole.n_states
        self.states = list(plant.states)
        for effect in effects:
            if isinstance(effect, HiddenEffect):
                self.states += names_of_memory(effect, effect.n_hidden)
        self.actuators: list[tuple[int, int | None, InputInSample, slice]] = []
        self.sensors: list[tuple[int, SensorInSample, slice]] = []
        acting = sorted(enumerate(effects), key=lambda item: (item[1].kind == "output", item[1].order))
        ramps = dict.fromkeys(range(len(plant.inputs)), False)
        for i, effect in acting:
            values = whole.parameters_of(i, theta)
            if isinstance(effect, InputEffect):
                place = plant.inputs.index(str(effect.location))
                other = plant.inputs.index(effect.variable) if effect.variable else None
                rule = InputInSample(effect, values, self.bound.h, n_sub, ramps[place])
                ramps[place] = rule.ramps
                self.actuators.append((place, other, rule, self._room(effect, rule.size)))
            elif isinstance(effect, SensorEffect) and effect.memory:
                slow = SensorInSample(effect, values, plant.dt)
                self.sensors.append((plant.outputs.index(str(effect.location)), slow, self._room(effect, slow.size)))
        seen = {place: plant.outputs[place] for place, _, _ in self.sensors} if plant.access == "step" else {}
        self.rises = {place: len(self.states) + k for k, place in enumerate(seen)}
        self.states += [f"{name}_rise" for name in seen.values()]
        self.readers = [
            (effect, whole.parameters_of(i, theta))
            for i, effect in acting
            if isinstance(effect, SensorEffect) and not effect.memory
        ]

    def _room(self, effect: BaseEffect, size: int) -> slice:
        """Where the memory of an effect stands among the states."""
        first = len(self.states)
        self.states += names_of_memory(effect, size)
        return slice(first, first + size)

    def begin(self, x0: Any, u0: Any) -> list[Any]:
        """All states at the start of a run, given those of the simulator and the first input."""
        acts = list(u0)
        memory: list[Any] = [None] * len(self.states)
        for place, other, rule, room in self.actuators:
            memory[room], acts[place] = rule.begin(acts[place], u0[place if other is None else other])
        u = stacked(acts)
        memory[: self.n_model] = self._model_start(stacked(list(x0)), u)
        y = self._raw(0.0, memory[: self.n_model], u)
        for place, slow, room in self.sensors:
            memory[room] = [y[place]] * slow.size
        if self.rises:  # the first piece is straight: it rises as before it
            for row in self.rises.values():
                memory[row] = 0.0 * y[0]
            later = self.step(0.0, memory, u0)
            for row in self.rises.values():
                memory[row] = later[row]
        return memory

    def _model_start(self, x: np.ndarray, u: np.ndarray) -> list[Any]:
        """States of the simulator and hidden ones at rest."""
        a, out = self.bound.a, list(x)
        for i, effect in enumerate(a.effects):
            if isinstance(effect, HiddenEffect):
                out += list(effect.rest(a.variable(i, x, u), a.parameters_of(i, self.bound.theta)))
        return list(self.bound.clip(stacked(out), 0.0)) if self.bound._has_limits else out

    def _acting(self, t: Any, x: Sequence[Any], u: Sequence[Any]) -> tuple[list[Pieces], dict[int, list[Any]]]:
        """Inputs that act over the sample, and the memories of actuators after it by place."""
        given = [Pieces.held(value, self.n_sub) for value in u]
        acts, later = list(given), {}
        for place, other, rule, room in self.actuators:
            driver = None if other is None else given[other]
            later[room.start], acts[place] = rule.advance(x[room], acts[place], driver, t)
        return acts, later

    def step(self, t: Any, x: Sequence[Any], u: Sequence[Any]) -> list[Any]:
        """All states a sample later."""
        acts, later = self._acting(t, x, u)
        before = stacked(list(x[: self.n_model]))
        after = self._moved(t, before, acts)
        out = list(x)
        out[: self.n_model] = list(after)
        for place, _, rule, room in self.actuators:
            out[room] = later[room.start] if rule.size else []
        pieces: dict[int, tuple[Any, ...]] = {}
        for place, slow, room in self.sensors:
            if place not in pieces:
                pieces[place] = piece = self._piece(t, x, after, acts, place)
                if place in self.rises:
                    out[self.rises[place]] = piece[2] - piece[0]
            out[room], pieces[place] = slow.advance(x[room], pieces[place], t)
        return out

    def _moved(self, t: Any, x: np.ndarray, acts: list[Pieces]) -> np.ndarray:
        """States of the simulator and of laws a sample later."""
        bound = self.bound
        means = np.stack([stacked([p.mean[s] for p in acts]) for s in range(self.n_sub)])
        if self.plant.access == "step":
            x = whole_step(bound, t, x, means, bool(bound._balances or bound.a._hidden), bool(bound._at_ports))
            return bound.clip(x, t + self.plant.dt, True) if bound._has_limits else x
        held = all(p.half is None for p in acts)
        halves = None if held else [stacked([p.rises()[s] for p in acts]) for s in range(self.n_sub)]
        return rk4(bound.derivative, t, x, means, halves, bound.h, bound.clip if bound._has_limits else None)  # type: ignore[arg-type]

    def _piece(
        self, t: Any, states: Sequence[Any], after: np.ndarray, acts: list[Pieces], place: int
    ) -> tuple[Any, ...]:
        """An output over the sample: value and dt times slope at its start, both just before its end."""
        x, dt, end = stacked(list(states[: self.n_model])), self.plant.dt, stacked([p.end for p in acts])
        y0 = self._raw(t, x, stacked([p.shown for p in acts]))[place]
        y1 = self._raw(t + dt, after, end)[place]
        if place in self.rises:  # as slopes_so_far has it
            rise, last = y1 - y0, states[self.rises[place]]
            return y0, 0.5 * (last + rise), y1, rise + 0.5 * (rise - last)
        first = stacked([p.mean[0] - p.rises()[0] for p in acts])
        return y0, dt * self._slope(t, x, first, place), y1, dt * self._slope(t + dt, after, end, place)

    def _slope(self, t: Any, x: np.ndarray, u: np.ndarray, place: int) -> Any:
        """Time derivative of an output, as :meth:`BoundModel._slope` takes it."""
        dx = self.bound.derivative(t, x, u)
        if self.plant.output_states is not None:
            return dx[self.plant.output_states[place]]
        eps = 1e-6 * self.plant.dt
        return (self._raw(t + eps, x + eps * dx, u)[place] - self._raw(t, x, u)[place]) / eps

    def _raw(self, t: Any, x: Any, u: np.ndarray) -> np.ndarray:
        """Outputs of the simulator itself."""
        bound, states = self.bound, stacked(list(x))
        enters = u if self.plant.output_states is not None else bound.entering(t, states, u)
        return bound.a.model.output(t, states[: bound.a.n_nominal], enters, bound.params_at(t, states, u))

    def output(self, t: Any, x: Sequence[Any], u: Sequence[Any]) -> list[Any]:
        """Readings of the sensors."""
        shown = stacked([pieces.shown for pieces in self._acting(t, x, u)[0]])
        raw = list(self._raw(t, x[: self.n_model], shown))
        y, names = list(raw), self.plant.outputs
        for place, slow, room in self.sensors:
            y[place] = slow.reading(x[room], y[place], t)
        for effect, values in self.readers:
            place = names.index(str(effect.location))
            y[place] = effect.read(y[place], effect.beside(names, raw, self.plant.inputs, shown), t, values)
        return y
