"""What every effect changes in the outputs, to first order about the smoothed trajectory: the columns of the screen."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.effects._balance import ConstantBias
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import (
    BalanceEffect,
    HiddenEffect,
    InputEffect,
    LimitEffect,
    ParameterEffect,
    SensorEffect,
)
from sksurrogate.effects._limit import in_force
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._onset import Starting
from sksurrogate.effects._parameter import ParameterError, ParameterStep, constant_in_time
from sksurrogate.effects._wires import beside
from sksurrogate.gap.fit._normal_equations import project_starts
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.screen._held_forces import HeldForce, following
from sksurrogate.gap.screen._hidden_path import hidden_paths
from sksurrogate.gap.screen._sticking import slowed, sticks
from sksurrogate.kernels.banded import a_sample_later, solve_recursion
from sksurrogate.kernels.limited import limited_recursion
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.smoother import output_jacobian

#: Relative error of a parameter by which the change of a unit is measured.
UNIT_ERROR = 0.05
#: A change of the outputs beyond so many times their noise, or of a state beyond so many times its size, is not a start: it breaks the
#: arithmetic, and the order.
LARGEST_CHANGE = 1e12


class Responses:
    """One linearisation of a base, for all candidates.

    ``base``: the model that effects are added to.
    ``x`` (n_states, n_samples): trajectory near the measured one, to start the smoother.
    """

    def __init__(self, base: OdeCandidate, x: np.ndarray):
        self.problem, self.base = base.problem, base
        problem, theta = base.problem, base.fit.theta
        with np.errstate(all="ignore"):
            self.smoothed = problem.smooth(base.model, theta, x)
            x = self.smoothed.x
            self.lin = linearise(base.model, theta, x, problem.units(base.effects, theta))
            self.bound = base.model.bind(theta[:, None])
            self.after = self.bound(x[:, None])
            _, C = output_jacobian(self.bound, x, base.model.scale)
            self.C = problem.record.seen_of(C)
            self.y = self.bound.outputs(self.lin.x[:, None])
        self.pushes: dict[str, np.ndarray] = {}
        self.errors: dict[str, np.ndarray] = {}

    @cached_property
    def J_x(self) -> np.ndarray:
        """Sensitivities of the free initial states over the noise, (n_outputs, n_states, n_samples)."""
        return np.asarray(self.lin.J_x[:, self.base.model.free_states] / self.problem.sd[:, None, None])

    @cached_property
    def known(self) -> np.ndarray:
        """Residual and sensitivities of the fitted parameters over the noise, (1 + n_theta, n_outputs, n_samples)."""
        r = self.problem.record.residual(self.lin.y)[None]
        return np.concatenate([r, self.lin.J_theta.transpose(1, 0, 2)]) / self.problem.sd[None, :, None]

    @cached_property
    def white(self) -> np.ndarray:
        """The same with the initial states taken out."""
        return project_starts(self.known, self.J_x, self.problem.record.starts)

    @cached_property
    def along(self) -> tuple[tuple[HeldForce, ...], np.ndarray]:
        """Forces at further ports with which the base goes along the path, and its next states with them.

        A wrong inertia acts on what is missing too: without these forces heavier joints stand for any force that keeps them back.
        There is none where the base comes no nearer with it: what enters by its square has no slope at zero.
        """
        ports, record, x = self.problem.plant.further_ports, self.problem.record, self.smoothed.x
        rows = self.problem.rows_of_balances  # forces move positions within the sample, along the path at its end only
        pushes = np.array([self.unit_push(port)[rows] for port in ports])
        missed = np.zeros((len(rows), record.n_samples))
        missed[:, :-1] = x[rows, 1:] - self.after[rows, 0, :-1]
        missed[:, record.starts[1:] - 1] = 0.0
        if not (len(ports) and np.isfinite(pushes).all() and np.isfinite(missed).all()):
            return (), self.after
        scale = self.base.model.scale[rows]
        forces = following(pushes, missed, scale)
        after = self.held(forces)[1]
        still = np.linalg.norm(((missed - (after - self.after)[rows, 0]).T / scale), axis=1)
        return self.held(np.where(still < np.linalg.norm(missed.T / scale, axis=1), forces, 0.0))

    def held(self, forces: np.ndarray) -> tuple[tuple[HeldForce, ...], np.ndarray]:
        """Forces (n_ports, n_samples) at further ports, and the next states with them."""
        held = tuple(HeldForce(port, own) for port, own in zip(self.problem.plant.further_ports, forces))
        model = self.problem.augmented((*self.base.effects, *held))
        return held, model.bind(self.base.fit.theta[:, None])(self.smoothed.x[:, None])

    def columns(self, effect: BaseEffect, starts: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Change of the measured outputs for every start (n_parameters, n_starts): (n_outputs, n_starts, n_samples); trajectories."""
        if effect.settled_form is not effect:  # a memory in motion is seen as one at rest
            return self.columns(effect.settled_form, starts)
        problem, theta = self.problem, np.stack([self.base.theta_with(start) for start in starts.T], axis=1)
        model = problem.augmented((*self.base.effects, effect))
        paths = self.paths(effect, model, starts)
        direct = self.acts_at_once(effect, model)
        out = np.zeros((len(problem.record.y), starts.shape[1], problem.record.n_samples))
        if isinstance(effect, LimitEffect):
            out += np.einsum("oit,ist->ost", self.C, self.limited(effect, starts))
        elif isinstance(effect, BalanceEffect):
            out += self.acted(self.pushed(model, starts, np.stack(paths, axis=1)))
            self.let_stick(out, effect, model, starts)
        elif not isinstance(effect, SensorEffect):
            out += self.acted(self.changed(effect, model, starts, theta))
        if direct:
            out += model.bind(theta).outputs(np.repeat(self.lin.x[:, None], starts.shape[1], axis=1)) - self.y
        return problem.record.seen_of(out), paths

    def stepped(self, model: AugmentedModel, theta: np.ndarray, before: np.ndarray) -> np.ndarray:
        """What a model at parameters (n_theta, n_starts) changes in the next states ``before``: a step of the plant for each."""
        now = np.repeat(self.smoothed.x[:, None], theta.shape[1], axis=1)
        return np.asarray(model.bind(theta)(now) - before)

    def paths(self, effect: BaseEffect, model: AugmentedModel, starts: np.ndarray) -> list[np.ndarray]:
        """The smoothed trajectory for every start, with the states of the effect's own."""
        x = self.smoothed.x
        if not isinstance(effect, HiddenEffect):
            return [x] * starts.shape[1]
        z = hidden_paths(effect, model, starts, x)
        return [np.concatenate([x, z[:, s]]) for s in range(starts.shape[1])]

    def acts_at_once(self, effect: BaseEffect, model: AugmentedModel) -> bool:
        """Whether an effect changes the outputs at the same sample: at a sensor, or at what enters an output function."""
        at_port = model.wires[-1].port >= 0 and not isinstance(effect, HiddenEffect)
        enters = isinstance(effect, (InputEffect, ParameterEffect)) or at_port
        return isinstance(effect, SensorEffect) or (self.problem.plant.output_states is None and enters)

    def changed(self, effect: BaseEffect, model: AugmentedModel, starts: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """What an effect that is no force changes in the next states (n_states, n_starts, n_samples): a step of the plant a start."""
        if isinstance(effect, ParameterEffect):
            return self.rewritten(effect, model, starts, theta)
        if isinstance(effect, InputEffect) and model.may_jump:
            change = self.entered(effect, model, theta)
            if np.all(np.abs(change) < LARGEST_CHANGE * model.scale[:, None, None]):
                return change  # else a unit of the input is beyond what the simulator takes
        return self.stepped(model, theta, self.after)

    def entered(self, effect: InputEffect, model: AugmentedModel, theta: np.ndarray) -> np.ndarray:
        """What another input changes in the next states (n_states, n_starts, n_samples): its mean over the sample, times what a unit of it changes.

        A step of a simulator that steps for every start costs more.
        """
        name = str(effect.location)
        place = self.problem.plant.inputs.index(name)
        more = model.bind(theta).acting(None)[place] - self.bound.acting(None)[place]
        return self.unit_push(name)[:, None] * more

    def rewritten(
        self, effect: ParameterEffect, model: AugmentedModel, starts: np.ndarray, theta: np.ndarray
    ) -> np.ndarray:
        """What another value of a parameter changes in the next states (n_states, n_starts, n_samples), as the path goes."""
        held, after = self.along
        model = self.problem.augmented((*model.effects, *held)) if held else model
        if isinstance(effect, ParameterStep) and np.ptp(starts[0]) == 0:
            return self.switched(model, theta)
        if model.may_jump and not constant_in_time(effect):
            return self.followed(effect, model, starts)
        return self.stepped(model, theta, after)

    def let_stick(self, out: np.ndarray, effect: BalanceEffect, model: AugmentedModel, starts: np.ndarray) -> None:
        """Columns of a friction along a path that sticks, where the sign is that of the noise, from a run that is slowed."""
        problem, wire = self.problem, model.wires[-1]
        x, record = self.smoothed.x, problem.record
        load = beside(model.model, effect, wire.port, x, record.u) if wire.port >= 0 else np.zeros(record.n_samples)
        stuck = sticks(effect, starts, wire, record.dt, load)
        if not np.any(stuck):
            return
        push = self.unit_push(str(effect.location)) if wire.port >= 0 else None
        moved = self.sampled(slowed(problem, effect, starts[:, stuck], x, load, push), int(np.sum(stuck)))
        out[:, stuck] = np.einsum("oit,ist->ost", self.C, moved)

    def acted(self, change: np.ndarray) -> np.ndarray:
        """Change of the outputs by a change of the next states (n_states, n_starts, n_samples)."""
        b = a_sample_later(change, self.problem.record.starts)
        return np.einsum("oit,ist->ost", self.C, solve_recursion(self.lin.band, b))

    def limited(self, effect: LimitEffect, starts: np.ndarray) -> np.ndarray:
        """What a limit changes in the free run (n_states, n_starts, n_samples).

        An unmeasured state may lie far beyond the limit along a path that knows of none.
        """
        x, states, record = self.smoothed.x, self.problem.plant.states, self.problem.record
        place, other = states.index(str(effect.location)), states.index(effect.variable or str(effect.location))
        theta = [row[:, None] for row in starts]

        def limit(s: np.ndarray, rows: np.ndarray) -> np.ndarray:
            near = x[:, None, rows]
            within, received = effect.clip(s[place] + near[place], s[other] + near[other], theta, True)
            how = effect, record.t[rows] - 0.5 * record.dt, theta, 0.5 * record.dt
            s[place] = in_force(*how, s[place], within - near[place])
            if received is not None:
                s[other] = in_force(*how, s[other], received - near[other])
            return s

        return self.sampled(limit, starts.shape[1])

    def sampled(self, act: Callable[[np.ndarray, np.ndarray], np.ndarray], n_starts: int) -> np.ndarray:
        """What acts on the states at every sample changes in the free run (n_states, n_starts, n_samples).

        The free run is first order in the states about the path.
        """
        x, record = self.smoothed.x, self.problem.record
        b = np.zeros((len(x), n_starts, record.n_samples))
        b[:, :, 1:] = (self.after[:, 0, :-1] - x[:, 1:])[:, None]
        b[:, :, record.starts] = 0.0
        return limited_recursion(self.lin.A, b, record.starts, act) - (self.lin.x - x)[:, None]

    def pushed(
        self, model: AugmentedModel, starts: np.ndarray, x: np.ndarray, offset: np.ndarray | None = None
    ) -> np.ndarray:
        """What the force of the last effect changes in the next states (n_states, n_starts, n_samples).

        Its mean over the sample, times what a unit force at its place changes: no step of the plant for every start. The
        path x may lie apart of the smoothed one, by an ``offset`` (n_states, n_samples).
        """
        i, record, wire = len(self.base.effects), self.problem.record, model.wires[-1]
        later = np.concatenate([x[:, :, 1:], x[:, :, -1:]], axis=2)
        later[: self.base.model.n_states] = self.after
        if offset is not None:
            later[: self.base.model.n_states] += np.concatenate([offset[:, 1:], offset[:, -1:]], axis=1)[:, None]
        how: tuple[Any, Any] = [row[:, None] for row in starts], self.bound.h if wire.width is None else wire.width
        if isinstance(model.effects[-1], Starting):
            how = how[0], (how[1], record.dt)
        first = model.force_of(i, record.t, x, self.bound.acting(0), *how)
        last = model.force_of(i, record.t + record.dt, later, self.bound.acting(-1), *how)
        return self.unit_push(str(model.effects[-1].location))[:, None] * (0.5 * (first + last))

    def switched(self, model: AugmentedModel, theta: np.ndarray) -> np.ndarray:
        """What a parameter that jumps by one value at several times changes in the next states (n_states, n_starts, n_samples).

        Before the jump nothing, after it what the new value changes, within the sample of the jump its share.
        """
        record, place = self.problem.record, self.base.n_parameters + 1
        always = theta[:, :1].copy()
        always[place] = -record.dt - float(np.ptp(record.t))
        new = self.stepped(model, always, self.along[1])[: self.base.model.n_states]
        return new * np.clip((record.t + record.dt - theta[place][:, None]) / record.dt, 0.0, 1.0)

    def followed(self, effect: ParameterEffect, model: AugmentedModel, starts: np.ndarray) -> np.ndarray:
        """What a parameter that goes with a signal or with time changes in the next states (n_states, n_starts, n_samples).

        Its relative change amid every sample, times what a unit of it changes: a simulator that steps is written anew for every
        value of a parameter, which costs more than its step.
        """
        record, u = self.problem.record, self.bound.acting(0)
        last = np.repeat(record.starts + record.lengths - 1, record.lengths)
        later = np.minimum(np.arange(record.n_samples) + 1, last)
        x = 0.5 * (self.smoothed.x + self.smoothed.x[:, later])[:, None]
        driver = () if effect.variable is None else (model.variable(len(self.base.effects), x, u),)
        how = record.t + 0.5 * record.dt, [row[:, None] for row in starts], self.bound.h
        relative = np.broadcast_to(effect.value(1.0, *how, *driver) - 1.0, (starts.shape[1], x.shape[2]))
        return self.unit_error(str(effect.location))[:, None] * relative

    def unit_error(self, name: str) -> np.ndarray:
        """What a unit of the relative error of a parameter changes in the next states (n_states, n_samples)."""
        if name not in self.errors:
            error, (held, after) = ParameterError(name), self.along
            theta = self.base.theta_with(np.array([UNIT_ERROR]))
            model = self.problem.augmented((*self.base.effects, error, *held))
            self.errors[name] = self.stepped(model, theta[:, None], after)[:, 0] / UNIT_ERROR
        return self.errors[name]

    def unit_push(self, place: str) -> np.ndarray:
        """What a constant unit force in one balance, or at one port, changes in the next states (n_states, n_samples)."""
        if place not in self.pushes:
            problem, base = self.problem, self.base
            force, states = ConstantBias(place), problem.plant.states
            size = problem.rate[states.index(place)] if place in states else problem.port_rate(place)
            unit = 1e-2 * float(size) or 1e-6
            model, theta = problem.augmented((*base.effects, force)), base.theta_with(np.array([unit]))
            self.pushes[place] = self.stepped(model, theta[:, None], self.after)[:, 0] / unit
        return self.pushes[place]
