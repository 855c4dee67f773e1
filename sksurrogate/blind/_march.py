"""The plant as it really is: own integration (Kutta's 3/8 rule at fixed fine steps) of equations with their effects.

Lags are states, delays and rate limits are read in continuous time, and no step straddles the moment at which a delayed
input jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.blind._inexact import RESTED, SAMPLED, form_of, loop_rate, wandering
from sksurrogate.blind._laws import family
from sksurrogate.blind._plants import PlantSpec
from sksurrogate.blind._truths import Kind, Term, Truth, sign

#: ``policy(k, y) -> u``: a controller that reads (n_runs, n_outputs) and sets (n_runs, n_inputs).
Policy = Callable[[int, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Course:
    """What happened."""

    states: np.ndarray  #: (n_runs, n_samples, n_states)
    outputs: np.ndarray  #: (n_runs, n_samples, n_outputs)
    inputs: np.ndarray  #: (n_runs, n_samples, n_inputs): as commanded, before effects


def march(
    plant: PlantSpec,
    U: np.ndarray,
    X0: np.ndarray,
    truths: Sequence[Truth] = (),
    *,
    force: tuple[str, np.ndarray] | None = None,
    policy: Policy | None = None,
    substeps: int = 24,
) -> Course:
    """Run a plant with its effects.

    ``U`` (n_runs, n_samples, n_inputs): commanded inputs; overwritten row by row where there is a ``policy``.
    ``X0`` (n_runs, n_states).
    ``truths``: at most one on each input and on each output; parameters may hold one value for each run.
    ``force`` (str, ndarray (n_runs, n_samples)): a state and what is added to its derivative, held over each sample.
    ``substeps``: steps in a sample.
    Returns Course: not finite from where the plant diverges.
    """
    machine = _Machine(plant, np.array(U, dtype=float), truths, force)
    n_runs, n_samples, _ = U.shape
    z = machine.begin(np.array(X0, dtype=float).T)
    offsets = machine.offsets(substeps)
    states = np.empty((n_runs, n_samples, len(plant.states)))
    outputs = np.empty((n_runs, n_samples, len(plant.outputs)))
    with np.errstate(all="ignore"):
        for k in range(n_samples):
            t = k * plant.dt
            if policy is not None:
                machine.U[:, k] = policy(k, machine.reading(k, t, z).T)
            if k == 0:
                machine.first(z)
            machine.enter(k)
            states[:, k] = z[: machine.n].T
            outputs[:, k] = machine.reading(k, t, z).T
            for a, b in zip(offsets[:-1], offsets[1:]):
                machine.note(k, a, t + a, z)
                z = machine.step(t + a, b - a, k, z)
            machine.leave(k)
    return Course(states, outputs, machine.U)


def equation(truth: Truth, kind: Kind) -> Term:
    """The static equation of an effect: of its inexact variant, or of its kind."""
    form = form_of(truth) if truth.variant else kind.form
    assert form is not None
    return form


def there(truth: Truth, t: float) -> Any:
    """Whether an effect acts at a time: all do, but those with an ``onset`` before it and those with an ``end`` after it."""
    p = truth.params
    return 1.0 * ((t >= p.get("onset", -np.inf) - 1e-9) & (t < p.get("end", np.inf) - 1e-9))


class _Machine:
    """A plant with its effects: one matrix of states (all states, n_runs)."""

    def __init__(
        self, plant: PlantSpec, U: np.ndarray, truths: Sequence[Truth], force: tuple[str, np.ndarray] | None
    ) -> None:
        self.plant, self.U, self.dt = plant, U, plant.dt
        self.n, self.n_runs = len(plant.states), len(U)
        self.index = {name: i for i, name in enumerate(plant.states)}
        self.force = None if force is None else (self.index[force[0]], force[1])
        placed: list[tuple[Truth, Kind]] = [(truth, family(truth.name)) for truth in truths]

        def at(place: str) -> list[tuple[Truth, Kind]]:
            return [(truth, kind) for truth, kind in placed if kind.place == place]

        self.parameters = [truth for truth, _ in (*at("parameter"), *at("element"))]
        self.terms, self.limits, self.hidden = at("balance"), [t for t, _ in at("limit")], [t for t, _ in at("hidden")]
        self.ports = [(plant.inputs.index(truth.location), truth, kind) for truth, kind in at("port")]
        self.actuators = {plant.inputs.index(t.location): (t, kind) for t, kind in at("input")}
        self.sensors = {plant.outputs.index(t.location): (t, kind) for t, kind in at("sensor")}
        self.slots: dict[Any, slice] = {}
        count = self.n
        for truth in self.hidden:
            size = 2 if truth.name == "hidden_mode" else 1
            self.slots[id(truth)] = slice(count, count + size)
            count += size
        for table in (self.actuators, self.sensors):
            for truth, _ in table.values():
                if truth.name.endswith("_lag"):
                    self.slots[id(truth)] = slice(count, count + 1)
                    count += 1
        self.size = count
        self.memory = {j: np.zeros(self.n_runs) for j in self.actuators}
        self.late = {j: np.zeros((self.n_runs, U.shape[1])) for j in self.sensors}

    # ---- signals

    def signal(self, name: str, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """A state or an input by name."""
        return x[self.index[name]] if name in self.index else u[self.plant.inputs.index(name)]

    def stretch(self, truth: Truth, x: np.ndarray, u: np.ndarray) -> Any:
        """The difference across an element, a state or "abs(a - b)"."""
        ends = str(truth.variable).removeprefix("abs(").removesuffix(")").split(" - ")
        first, *second = (self.signal(name, x, u) for name in ends)
        return first - second[0] if second else first

    def factors(self, truth: Truth, x: np.ndarray, u: np.ndarray) -> tuple[Any, Any]:
        """The one or two factors of a variable."""
        if truth.variable is None:
            return x[self.index[truth.location]], 1.0
        first, *second = truth.variable.split("*")
        return self.signal(first, x, u), self.signal(second[0], x, u) if second else 1.0

    def commanded(self, j: int, t: Any, middle: Any) -> np.ndarray:
        """Input j at time t as commanded; ``middle`` tells on which side of a jump."""
        last = self.U.shape[1] - 1
        k = np.clip(np.floor(np.asarray(middle) / self.dt + 1e-9).astype(int), 0, last)
        row = np.arange(self.n_runs)
        held = self.U[row, k, j]
        if self.plant.hold == "zoh":
            return held
        share = np.clip(np.asarray(t) / self.dt - k, 0.0, 1.0)
        return held + share * (self.U[row, np.minimum(k + 1, last), j] - held)

    def all_commanded(self, t: float, middle: float) -> np.ndarray:
        """All inputs at one time for all runs, (n_inputs, n_runs)."""
        last = self.U.shape[1] - 1
        k = min(max(int(middle / self.dt + 1e-9), 0), last)
        held = self.U[:, k].T
        if self.plant.hold == "zoh":
            return held
        share = min(max(t / self.dt - k, 0.0), 1.0)
        return held + share * (self.U[:, min(k + 1, last)].T - held)

    def inputs(self, t: float, middle: float, k: int, z: np.ndarray) -> np.ndarray:
        """All inputs as the plant feels them, (n_inputs, n_runs)."""
        u = self.all_commanded(t, middle)
        if not self.actuators:
            return u
        felt = u.copy()
        for j, (truth, kind) in self.actuators.items():
            p = truth.params
            if truth.name == "input_delay":
                delay = p["delay"] * wandering(truth, t, self.dt)
                felt[j] = self.commanded(j, t - delay, middle - delay)
                if truth.variant == RESTED:
                    felt[j] = np.where(middle > delay, felt[j], 0.0)
            elif truth.name == "input_lag":
                felt[j] = z[self.slots[id(truth)]][0]
            elif truth.name == "rate_limit":
                within = self.dt if truth.variant == SAMPLED else t - k * self.dt
                most = p["limit"] * within * wandering(truth, k * self.dt, self.dt)
                felt[j] = self.memory[j] + np.clip(u[j] - self.memory[j], -most, most)
            elif truth.name == "input_backlash":
                felt[j] = np.clip(self.memory[j], u[j] - p["half_width"], u[j] + p["half_width"])
            else:
                v = u[self.plant.inputs.index(truth.variable)] if truth.variable else u[j]
                felt[j] = equation(truth, kind)(t, u[j], v, 1.0, p, truth.width)
            felt[j] = np.where(there(truth, middle) > 0.0, felt[j], u[j])
        return felt

    def parameter_values(self, t: float, middle: float, x: np.ndarray, u: np.ndarray) -> dict[str, Any]:
        """Parameters at time t, states x and inputs u; ``middle`` tells on which side of a window's edge."""
        values: dict[str, Any] = dict(self.plant.params)
        for truth in self.parameters:
            p, nominal = truth.params, values[truth.location]
            change: Any
            if truth.name == "parameter_drift":
                change = p["rate"] * t
            elif truth.name == "parameter_dependence":
                change = there(truth, middle) * (p["slope"] * self.factors(truth, x, u)[0] + p["relative_error"])
            elif truth.name == "backlash":
                stretch = np.abs(self.stretch(truth, x, u))
                lost = np.where(stretch > p["half_width"], p["half_width"] / np.maximum(stretch, 1e-300), 1.0)
                change = -there(truth, middle) * lost
            else:
                change = there(truth, middle) * p["relative_error"] * (t >= p.get("time", -np.inf))
            values[truth.location] = np.where(np.equal(nominal, 0.0), change, nominal * (1.0 + change))
        return values

    # ---- time

    def offsets(self, substeps: int) -> np.ndarray:
        """Moments within a sample between which steps are taken: jumps and readings of delays among them."""
        found = {0.0, self.dt}
        for truth, _ in self.actuators.values():
            if truth.name == "input_delay":
                found |= {float(d) for d in np.ravel(np.mod(truth.params["delay"], self.dt))}
        for truth, _ in self.sensors.values():
            if truth.name == "sensor_delay":
                found |= {float(d) for d in np.ravel(self.reading_offset(truth))}
        corners = sorted(found)
        parts = [np.array([0.0])]
        for a, b in zip(corners[:-1], corners[1:]):
            if b - a > 1e-9 * self.dt:
                parts.append(np.linspace(a, b, max(1, int(np.ceil(substeps * (b - a) / self.dt))) + 1)[1:])
        return np.concatenate(parts)

    def reading_offset(self, truth: Truth) -> np.ndarray:
        """Where in a sample a delayed sensor looks."""
        return np.mod(-np.asarray(truth.params["delay"]), self.dt)

    def begin(self, x0: np.ndarray) -> np.ndarray:
        """All states at the start, before the filters know their first value."""
        for truth in self.limits:
            i = self.index[truth.location]
            x0[i] -= there(truth, 0.0) * np.maximum(x0[i] - truth.params["limit"], 0.0)
        z = np.zeros((self.size, x0.shape[1]))
        z[: self.n] = x0
        for truth in self.hidden:
            settled = truth.name in ("hidden_relaxation", "hidden_mode") or truth.name.startswith("law_")
            if settled and truth.variable in self.index:
                z[self.slots[id(truth)].start] = x0[self.index[truth.variable]]
        return z

    def first(self, z: np.ndarray) -> None:
        """Filters and plays start at their first value, or at rest."""
        for j, (truth, _) in self.actuators.items():
            self.memory[j] = self.U[:, 0, j] * float(truth.variant != RESTED)
            if truth.name == "input_lag":
                z[self.slots[id(truth)]] = self.memory[j]
        y = self.clean(0.0, 0.0, 0, z)
        for j, (truth, _) in self.sensors.items():
            if truth.name == "sensor_lag":
                z[self.slots[id(truth)]] = y[j]
            self.memory[-1 - j] = y[j].copy()

    def enter(self, k: int) -> None:
        """A held input jumps: the play follows."""
        self.play(k, self.commanded_all(k * self.dt, k * self.dt))

    def leave(self, k: int) -> None:
        """What the play and the rate limit have reached at the end of a sample."""
        end = (k + 1) * self.dt
        u = self.commanded_all(end, end - 0.5 * self.dt)
        for j, (truth, _) in self.actuators.items():
            if truth.name == "rate_limit":
                most = truth.params["limit"] * self.dt * wandering(truth, k * self.dt, self.dt)
                self.memory[j] = self.memory[j] + np.clip(u[j] - self.memory[j], -most, most)
        self.play(k, u)

    def commanded_all(self, t: float, middle: float) -> dict[int, np.ndarray]:
        """Commanded inputs of the actuators with a memory."""
        return {j: self.commanded(j, t, middle) for j in self.actuators}

    def play(self, k: int, u: dict[int, np.ndarray]) -> None:
        """The play's output follows its input."""
        for j, (truth, _) in self.actuators.items():
            if truth.name == "input_backlash":
                c = truth.params["half_width"]
                self.memory[j] = np.clip(self.memory[j], u[j] - c, u[j] + c)

    # ---- equations

    def derivative(self, t: float, middle: float, k: int, z: np.ndarray) -> np.ndarray:
        """Derivatives of all states, (all states, n_runs)."""
        x, u = z[: self.n], self.inputs(t, middle, k, z)
        p = self.parameter_values(t, middle, x, u)
        u = self.with_laws(t, middle, x, u)
        dz = np.zeros_like(z)
        for i, value in enumerate(self.plant.rhs(t, x, u, p)):
            dz[i] = value
        if self.force is not None:
            dz[self.force[0]] += self.force[1][:, k]
        for truth, kind in self.terms:
            i = self.index[truth.location]
            v, w = self.factors(truth, x, u)
            dz[i] += there(truth, middle) * equation(truth, kind)(t, x[i], v, w, truth.params, truth.width)
        for truth in self.hidden:
            dz[self.index[truth.location]] += there(truth, middle) * self.pull(truth, x, u, z)
        for truth in self.limits:
            i = self.index[truth.location]
            spilled = there(truth, middle) * np.where((x[i] >= truth.params["limit"]) & (dz[i] > 0), dz[i], 0.0)
            dz[i] -= spilled
            if truth.variable is not None:
                dz[self.index[truth.variable]] += truth.params["share"] * spilled
        for truth in self.hidden:
            dz[self.slots[id(truth)]] = self.hidden_rate(truth, x, u, z, dz)
        self.filters(t, middle, x, u, p, z, dz)
        return dz

    def with_laws(self, t: float, middle: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The inputs (n_inputs, n_runs) with the laws that act there."""
        enters = u.copy() if self.ports else u
        for j, truth, kind in self.ports:
            v = x[self.index[str(truth.variable)]]
            enters[j] += there(truth, middle) * equation(truth, kind)(t, u[j], v, 1.0, truth.params, truth.width)
        return enters

    def pull(self, truth: Truth, x: np.ndarray, u: np.ndarray, z: np.ndarray) -> Any:
        """What a hidden state adds to a balance."""
        i, p, own = self.index[truth.location], truth.params, z[self.slots[id(truth)]]
        v, _ = self.factors(truth, x, u)
        if truth.name in ("hysteresis", "lugre_friction"):
            return -p["stiffness"] * own[0]
        if truth.name == "hidden_relaxation":
            return -p["coefficient"] * (v - own[0])
        if truth.name.startswith("law_"):
            return equation(truth, family(truth.name))(0.0, x[i], own[0], 1.0, p, truth.width)
        return p["gain"] * (own[0] - v)

    def hidden_rate(self, truth: Truth, x: np.ndarray, u: np.ndarray, z: np.ndarray, dz: np.ndarray) -> Any:
        """Derivative of a hidden state."""
        p, own = truth.params, z[self.slots[id(truth)]]
        v, _ = self.factors(truth, x, u)
        if truth.name == "hysteresis":
            return loop_rate(truth, dz[self.index[truth.variable or truth.location]], own[0])
        if truth.name == "lugre_friction":
            g = p["level"] + (p["static_level"] - p["level"]) * np.exp(-((v / p["velocity"]) ** 2))
            return v - p["stiffness"] * v * sign(v, truth.width) * own[0] / g
        if truth.name == "hidden_relaxation" or truth.name.startswith("law_"):
            return (v - own[0]) / p["time_constant"]
        w = p["angular_frequency"]
        return np.stack([own[1], w * w * (v - own[0]) - 2.0 * p["damping"] * w * own[1]])

    def filters(
        self, t: float, middle: float, x: np.ndarray, u: np.ndarray, p: dict[str, Any], z: np.ndarray, dz: np.ndarray
    ) -> None:
        """Lags of inputs and outputs."""
        for j, (truth, _) in self.actuators.items():
            if truth.name == "input_lag":
                slot = self.slots[id(truth)]
                dz[slot] = (self.commanded(j, t, middle) - z[slot]) / truth.params["time_constant"]
        lagged = [(j, truth) for j, (truth, _) in self.sensors.items() if truth.name == "sensor_lag"]
        if lagged:
            y = self.plant.read(t, x, u, p)
            for j, truth in lagged:
                slot = self.slots[id(truth)]
                dz[slot] = (y[j] - z[slot]) / truth.params["time_constant"]

    def step(self, t: float, h: float, k: int, z: np.ndarray) -> np.ndarray:
        """One step of Kutta's 3/8 rule; what overshoots a hard limit is put back."""
        middle = t + h / 2
        a = self.derivative(t, middle, k, z)
        b = self.derivative(t + h / 3, middle, k, z + h / 3 * a)
        c = self.derivative(t + 2 * h / 3, middle, k, z + h * (b - a / 3))
        d = self.derivative(t + h, middle, k, z + h * (a - b + c))
        z = z + h / 8 * (a + 3 * (b + c) + d)
        for truth in self.limits:
            i = self.index[truth.location]
            excess = there(truth, middle) * np.maximum(z[i] - truth.params["limit"], 0.0)
            z[i] -= excess
            if truth.variable is not None:
                z[self.index[truth.variable]] += truth.params["share"] * excess
        return z

    # ---- readings

    def clean(self, t: float, middle: float, k: int, z: np.ndarray) -> np.ndarray:
        """Outputs before the sensors' effects, (n_outputs, n_runs)."""
        u = self.inputs(t, middle, k, z)
        return self.plant.read(t, z[: self.n], u, self.parameter_values(t, middle, z[: self.n], u))

    def note(self, k: int, offset: float, t: float, z: np.ndarray) -> None:
        """Keep what a delayed sensor will show later."""
        for j, (truth, _) in self.sensors.items():
            if truth.name == "sensor_delay":
                here = np.abs(self.reading_offset(truth) - offset) < 1e-9 * self.dt
                if np.any(here):
                    y = self.clean(t, t + 1e-6 * self.dt, k, z)[j]
                    self.late[j][:, k] = np.where(here, y, self.late[j][:, k])

    def reading(self, k: int, t: float, z: np.ndarray) -> np.ndarray:
        """Outputs at sample k as the sensors show them, (n_outputs, n_runs)."""
        y = self.clean(t, t + 1e-6 * self.dt, k, z)
        shown = y.copy()
        for j, (truth, kind) in self.sensors.items():
            if truth.name == "sensor_lag":
                shown[j] = z[self.slots[id(truth)]][0] if k else y[j]
            elif truth.name == "sensor_delay":
                shown[j] = self.delayed(j, truth, k, y[j])
            else:
                v = y[self.plant.outputs.index(truth.variable)] if truth.variable else y[j]
                shown[j] = equation(truth, kind)(t, y[j], v, 1.0, truth.params, truth.width)
            shown[j] = np.where(there(truth, t) > 0.0, shown[j], y[j])
        return shown

    def delayed(self, j: int, truth: Truth, k: int, now: np.ndarray) -> np.ndarray:
        """What a sensor saw ``delay`` ago; the first value before that."""
        delay = np.broadcast_to(np.asarray(truth.params["delay"], dtype=float), now.shape)
        offset = np.broadcast_to(self.reading_offset(truth), now.shape)
        back = np.rint((delay + offset) / self.dt).astype(int)
        seen = np.where(back == 0, now, self.late[j][np.arange(len(now)), np.maximum(k - back, 0)])
        return np.where(k - back < 0, self.memory.get(-1 - j, now), seen)
