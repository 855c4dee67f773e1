"""A simulator with effects about an operating point: what a linearisation is taken of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import factorial
from typing import Any

import numpy as np
from scipy.signal import tf2ss

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect, InputEffect, LimitEffect, SensorEffect
from sksurrogate.effects._followers import InputLag, RateLimit
from sksurrogate.effects._input import InputBacklash, InputDelay, InputQuantization
from sksurrogate.effects._one_sample import InputInSample, Pieces, own_values, unwindowed
from sksurrogate.effects._onset import Starting, window
from sksurrogate.effects._points import bound_at_points, stacked
from sksurrogate.effects._sampled import SampledForm, names_of_memory, point_model
from sksurrogate.effects._sensor import SensorDelay, SensorLag, SensorQuantization
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._simulator import Plant

#: Substeps with which kinks and fast memories are as they are in continuous time.
FINE_SUBSTEPS = 1_000_000
#: Why an effect has no slope.
NO_SLOPE = {
    InputBacklash: "the slope of a backlash depends on the direction of the last move",
    InputQuantization: "the slope of a staircase is 0 between its jumps",
    SensorQuantization: "the slope of a staircase is 0 between its jumps",
}


def refuse_slopes(effects: Sequence[BaseEffect]) -> None:
    """Raise where an effect has no slope at any point."""
    for effect in effects:
        why = NO_SLOPE.get(type(unwindowed(effect)))  # type: ignore[call-overload]
        if why:
            raise SimulatorError(
                f"{effect.name} on {effect.location!r} cannot be linearised: {why}. Linearise the simulator without this "
                "effect, or use to_casadi or to_c, which keep it."
            )


def pade_of(delay: float, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A, B, C, D of Pade's approximation of a delay, numerator and denominator of one order.

    >>> A, B, C, D = pade_of(2.0, 1)   # (1 - s) / (1 + s)
    >>> A.tolist(), D
    ([[-1.0]], -1.0)
    """
    k = np.arange(order + 1)
    weights = np.array([factorial(2 * order - i) // (factorial(i) * factorial(order - i)) for i in k], dtype=float)
    den, num = weights[::-1], (weights * (-1.0) ** k)[::-1]  # in powers of delay * s, highest first
    A, B, C, D = tf2ss(num / den[0], den / den[0])
    return A / delay, B[:, 0] / delay, C[0], float(D[0, 0])


class _Slow:
    """A lag or a delay in continuous time: states and their rates.

    ``value``: time constant or delay, > 0.
    ``order``: of Pade's approximation of a delay.
    """

    def __init__(self, effect: BaseEffect, value: float, order: int):
        if isinstance(effect, InputDelay | SensorDelay):
            self.A, self.B, self.C, self.D = pade_of(value, order)
        else:
            self.A, self.B, self.C, self.D = np.array([[-1.0 / value]]), np.array([1.0 / value]), np.array([1.0]), 0.0
        self.size = len(self.A)

    def begin(self, value: Any) -> list[Any]:
        """At rest under a constant signal."""
        return [part * value for part in np.linalg.solve(self.A, -self.B)]

    def rates(self, z: Sequence[Any], value: Any) -> list[Any]:
        """Their derivatives."""
        return [sum(a * part for a, part in zip(row, z)) + b * value for row, b in zip(self.A, self.B)]

    def passed(self, z: Sequence[Any], value: Any) -> Any:
        """What is passed on."""
        return sum(c * part for c, part in zip(self.C, z)) + self.D * value


class SmallSignal:
    """dx/dt and y of a simulator with effects near a point, for small and slow changes.

    A rate limit that is not reached passes everything on; delays are Pade's approximations.

    ``plant``: with access "rhs".
    ``theta`` (n_theta,).
    ``order``: of Pade's approximation of a delay.
    ``scale, sharpness``: as in :class:`AugmentedSimulator`.
    ``states, inputs, outputs, params, dt, hold, x0``: as a simulator has them.
    """

    def __init__(
        self, plant: Plant, effects: Sequence[BaseEffect], theta: np.ndarray, order: int, scale: Any, sharpness: float
    ):
        refuse_slopes(effects)
        whole = point_model(plant, effects, FINE_SUBSTEPS, scale, sharpness)
        self.plant, self.bound = plant, bound_at_points(whole, theta, False)
        self.inputs, self.outputs, self.params = plant.inputs, plant.outputs, plant.params
        self.dt, self.hold, self.x0 = plant.dt, plant.hold, plant.x0
        self.n_model = whole.n_states
        names = list(plant.states)
        for effect in effects:
            names += names_of_memory(effect, effect.n_hidden) if isinstance(effect, HiddenEffect) else []
        self.acting: list[tuple[BaseEffect, list[float], Any, slice]] = []
        for i, effect in sorted(enumerate(effects), key=lambda item: (item[1].kind == "output", item[1].order)):
            if not isinstance(effect, InputEffect | SensorEffect):
                continue
            values, kind = whole.parameters_of(i, theta), unwindowed(effect)
            part: Any = None
            if isinstance(kind, InputLag | SensorLag | InputDelay | SensorDelay):
                own = own_values(effect, values)[0]
                part = _Slow(kind, own, order) if own > 0 else _Nothing()
            elif isinstance(effect, InputEffect):
                part = _Nothing() if isinstance(kind, RateLimit) else InputInSample(effect, values, self.bound.h, 1, False)  # fmt: skip
            size = 0 if part is None else part.size
            self.acting.append((effect, values, part, slice(len(names), len(names) + size)))
            names += names_of_memory(effect, size)
        self.states = tuple(names)

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """It is not for simulation."""
        raise SimulatorError("a small-signal form is for linearisation; simulate the simulator itself.")

    def complete(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """All states, those of the effects at rest under a constant input.

        Raises SimulatorError where a state stands at its limit.
        """
        a, given = self.bound.a, stacked(list(x))
        for i, effect in enumerate(a.effects):
            if isinstance(effect, LimitEffect):
                limit, name = a.parameters_of(i, self.bound.theta)[0], str(effect.location)
                in_force = np.any(_share(effect, a.parameters_of(i, self.bound.theta), 0.0))
                if in_force and np.any(given[self.plant.states.index(name)] >= limit):
                    raise SimulatorError(
                        f"{effect.name}: {name!r} is at its limit {limit:g}, where it has no slope. Linearise below the limit."
                    )
        z, room = list(given), [None] * len(self.states)
        shown = self._actuated(0.0, room, list(u), fill=room)
        for i, effect in enumerate(a.effects):
            if isinstance(effect, HiddenEffect):
                z += list(effect.rest(a.variable(i, given, shown), a.parameters_of(i, self.bound.theta)))
        room[: self.n_model] = z
        self._read(0.0, room, shown, fill=room)
        return stacked(room)

    def _actuated(self, t: Any, x: Sequence[Any], u: list[Any], rates: Any = None, fill: Any = None) -> np.ndarray:
        """Inputs that act; fills in rates of the actuators' states, or these states at rest."""
        acts, names = list(u), self.plant.inputs
        for effect, values, part, room in self.acting:
            if not isinstance(effect, InputEffect):
                continue
            place = names.index(str(effect.location))
            now = acts[place]
            if isinstance(part, InputInSample):
                other = u[names.index(effect.variable)] if effect.variable else None
                driver = None if other is None else Pieces.held(other, 1)
                changed = part._static([], Pieces.held(now, 1), driver)[1].shown
            else:
                changed = _through(part, x, room, now, rates, fill)
            acts[place] = now + _share(effect, values, t) * (changed - now)
        return stacked(acts)

    def _read(self, t: Any, x: Sequence[Any], shown: np.ndarray, rates: Any = None, fill: Any = None) -> list[Any]:
        """Readings of the sensors; fills in rates of their states, or these states at rest."""
        bound, states = self.bound, stacked(list(x[: self.n_model]))
        enters = shown if self.plant.output_states is not None else bound.entering(t, states, shown)
        raw = list(bound.a.model.output(t, states[: bound.a.n_nominal], enters, bound.params_at(t, states, shown)))
        y, names = list(raw), self.plant.outputs
        for effect, values, part, room in self.acting:
            if not isinstance(effect, SensorEffect):
                continue
            place = names.index(str(effect.location))
            if part is None:
                y[place] = effect.read(y[place], effect.beside(names, raw, self.plant.inputs, shown), t, values)
            else:
                changed = _through(part, x, room, y[place], rates, fill)
                y[place] = y[place] + _share(effect, values, t) * (changed - y[place])
        return y

    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """dx/dt of all states."""
        rates: list[Any] = [0.0] * len(self.states)
        shown = self._actuated(t, list(x), list(u), rates)
        rates[: self.n_model] = list(self.bound.derivative(t, stacked(list(x[: self.n_model])), shown))
        self._read(t, list(x), shown, rates)
        return stacked(rates)

    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """Readings."""
        return stacked(self._read(t, list(x), self._actuated(t, list(x), list(u))))


class _Nothing:
    """A memory that passes everything on."""

    size = 0

    def begin(self, value: Any) -> list[Any]:
        """None."""
        return []

    def rates(self, z: Sequence[Any], value: Any) -> list[Any]:
        """None."""
        return []

    def passed(self, z: Sequence[Any], value: Any) -> Any:
        """The signal itself."""
        return value


def _through(part: Any, x: Sequence[Any], room: slice, value: Any, rates: Any, fill: Any) -> Any:
    """A signal behind a slow part."""
    if fill is not None:
        fill[room] = part.begin(value)
        return value
    if rates is not None:
        rates[room] = part.rates(x[room], value)
    return part.passed(x[room], value)


def _share(effect: BaseEffect, values: Sequence[Any], t: Any) -> Any:
    """1 within the effect's window, 0 outside."""
    return window(t, effect.bounds(values), effect.span, 0.0) if isinstance(effect, Starting) else 1.0


class SampledPoint:
    """A :class:`SampledForm` as a simulator with ``step``: for linearisation and python-control."""

    def __init__(self, form: SampledForm):
        plant = self.plant = form.plant
        self.form, self.states = form, tuple(form.states)
        self.inputs, self.outputs, self.params = plant.inputs, plant.outputs, plant.params
        self.dt, self.hold, self.x0 = plant.dt, plant.hold, plant.x0

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run, from all states ``x0`` or from those of the simulator: (n_samples, n_outputs)."""
        rows = np.asarray(U, dtype=float).reshape(len(U), len(self.inputs))
        x = np.asarray(self.x0 if x0 is None else x0, dtype=float)
        x = self.complete(x, rows[0]) if len(x) != len(self.states) else x
        out = []
        for k, u in enumerate(rows):
            out.append(self.output(k * self.dt, x, u, self.params))
            x = self.step(k * self.dt, x, u, self.params, self.dt)
        return np.array(out)

    def complete(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """All states, those of the effects as at the start of a run."""
        return stacked(self.form.begin(list(x), list(u)))

    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """All states a sample later."""
        return stacked(self.form.step(t, list(x), list(u)))

    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """Readings."""
        return stacked(self.form.output(t, list(x), list(u)))
