"""A MuJoCo model in memory: many points, or many runs, in one call of its batched rollout."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._mujoco_equations import MuJoCoEquations
from sksurrogate.physics._mujoco_layout import read_layout
from sksurrogate.physics._mujoco_params import assign, colliding, read_parameters
from sksurrogate.physics._mujoco_points import Points, first_of_equals

#: Numbers that one call of the rollout may write; more are cut into several calls.
_LARGEST_BLOCK = 4_000_000
#: Copies of the model that hold different parameters, and the bytes that all of them may take.
_MOST_COPIES, _MOST_BYTES = 64, 256_000_000
#: Points from which on the equations are faster than MuJoCo.
FEWEST = 128
#: Largest difference of the equations from MuJoCo, over the largest value: its solver of dry friction stops a little before.
AGREEMENT = 1e-6
#: Engines of a parent process: their threads do not exist in a forked child, where freeing them would wait for ever.
_LEFT_BEHIND: list[Any] = []


class Engine:
    """A private copy of a model, its data and threads.

    Parameters
    ----------
    model : ``mujoco.MjModel``
        Not written.
    n_threads : int
        1: the calling thread.

    Attributes
    ----------
    layout : Layout
    parameters : dict of ModelParameter
    timestep : float
    markov : bool
        Whether positions, velocities and activations are the whole state (no delays, plastic joints, plugins).
    accurate : bool
        Whether the model's steps are of order four, and no position is a quaternion: shorter or longer ones lead to the same.
    """

    def __init__(self, model: Any, n_threads: int):
        mujoco = require("mujoco", "mujoco")
        self.origin, self.layout, self.parameters = model, read_layout(model), read_parameters(model)
        self.timestep = float(model.opt.timestep)
        full = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._control = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        stepped = _lean(model)
        self._copies = {"step": _Copies(self, stepped)}
        self._data = [mujoco.MjData(stepped) for _ in range(n_threads)]
        self.rest = np.empty(mujoco.mj_stateSize(model, full))
        mujoco.mj_getState(stepped, self._data[0], self.rest, full)
        self.n_states = len(self.layout.states)
        self.markov = len(self.rest) == 1 + self.n_states
        self.accurate = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 and model.nq == model.nv
        self._pool = require("mujoco.rollout", "mujoco").Rollout(nthread=n_threads if n_threads > 1 else 0)
        self._process, self.n_threads = os.getpid(), n_threads

    @property
    def alive(self) -> bool:
        """Whether this process made the engine."""
        if self._process != os.getpid():
            _LEFT_BEHIND.append(self)
        return self._process == os.getpid()

    @property
    def start(self) -> np.ndarray:
        """The model's initial state (n_states,)."""
        return self.rest[1 : 1 + self.n_states].copy()

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    def changed(self, p: Mapping[str, float]) -> dict[str, float]:
        """Parameters that differ from the model's."""
        return {name: float(value) for name, value in self._differing(p)[0].items()}

    def refusal(self, p: Mapping[str, float]) -> str:
        """A sentence on the first parameter with a value that the model cannot have; empty where there is none."""
        for name, value in p.items():
            if not self.parameters[name].admits(value):
                return f"params: {name}={value:g} is no value of the model; expected {self.parameters[name].domain}."
        return ""

    def with_values(self, p: Mapping[str, float]) -> Any:
        """A copy of the model with these parameters."""
        mujoco = require("mujoco", "mujoco")
        model = copy.copy(self.origin)
        assign(model, self.origin, self.parameters, self.changed(p))
        with silent():
            mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    # ---- points -----------------------------------------------------------------------------------------------------
    def step(self, at: Points, dt: float) -> np.ndarray:
        """States (n_states, n_points) a time ``dt`` later, by steps of the model no longer than its own."""
        n_steps = max(1, int(np.ceil(dt / self.timestep - 1e-6)))
        own = abs(dt - n_steps * self.timestep) <= 1e-6 * dt
        timestep = self.timestep if own else dt / n_steps
        return self._answered(
            at,
            lambda equations, some: equations.step(some, n_steps, timestep),
            lambda some: self._points("step", some, n_steps, timestep)[0],
        )

    def rates(self, at: Points) -> np.ndarray:
        """Time derivatives (n_states, n_points) of the model's forward dynamics."""
        return self._answered(at, MuJoCoEquations.rates, self._rates)

    def _answered(
        self,
        at: Points,
        by_equations: Callable[[MuJoCoEquations, Points], np.ndarray],
        by_mujoco: Callable[[Points], np.ndarray],
    ) -> np.ndarray:
        """An answer at points: many by the model's equations, if these hold; few, and what they leave open, by MuJoCo."""
        single, varied = self._differing(at.p)
        at = replace(at, p={**single, **varied})
        equations = self._equations if at.x.shape[1] >= FEWEST else None
        if equations is None or not equations.hold(at.p):
            return by_mujoco(at)
        out = by_equations(equations, at)
        left = np.isnan(out).any(axis=0)
        if left.any():
            out[:, left] = by_mujoco(at.some(left))
        return out

    def drive_forces(self, at: Points) -> np.ndarray:
        """What the drives bring at every joint (n_joints, n_points), by the model's equations."""
        assert self._equations is not None
        return self._equations.drive_forces(at)

    @property
    def has_equations(self) -> bool:
        """Whether the model's equations are written here."""
        return self._equations is not None

    @cached_property
    def _equations(self) -> MuJoCoEquations | None:
        """None where they do not say what MuJoCo says at random points."""
        found = MuJoCoEquations.of(self.origin, self.parameters) if self.markov else None
        if found is None:
            return None
        at = found.random_points(FEWEST)
        mine = np.vstack([found.rates(at), found.step(at, 2, self.timestep)])
        theirs = np.vstack([self._rates(at), self._points("step", at, 2, self.timestep)[0]])
        near = np.abs(mine - theirs) <= AGREEMENT * np.abs(theirs).max(axis=1, keepdims=True)
        said = ~np.isnan(mine)
        return found if near[said].all() and said.mean() > 0.5 else None

    def _rates(self, at: Points) -> np.ndarray:
        """Time derivatives by MuJoCo itself."""
        if "rates" not in self._copies:
            self._copies["rates"] = _Copies(self, _explicit(self._copies["step"].first))
        after, _ = self._points("rates", at, 1, self.timestep)
        n = len(self.layout.positions)
        out = (after - at.x) / self.timestep
        speeds = at.x[n : n + len(self.layout.velocities)]
        out[:n] = self.layout.position_rates(at.x[:n], speeds) + 0.0 * out[:n]  # nan stays nan
        return out

    def sensors(self, at: Points) -> np.ndarray:
        """Sensor components (n_components, n_points)."""
        return self._points("step", at, 1, self.timestep)[1]

    def _points(self, kind: str, at: Points, n_steps: int, timestep: float) -> tuple[np.ndarray, np.ndarray]:
        """States after some steps, and sensors at the points, equal ones computed once; not finite where the model diverges."""
        at, which = at.distinct()
        n_points, n_controls = at.x.shape[1], len(at.controls)
        control = np.zeros((n_points, n_controls + len(self.layout.ports)))
        control[:, :n_controls] = at.controls.T
        if at.forces is not None:
            control[:, n_controls:] = at.forces.T
        start = np.empty((n_points, len(self.rest)))
        start[:] = self.rest
        start[:, 0], start[:, 1 : 1 + self.n_states] = at.t, at.x.T
        n_sensors = self.origin.nsensordata
        states, sensors = np.full((n_points, self.n_states), np.nan), np.full((n_points, n_sensors), np.nan)
        sound = np.all(np.isfinite(np.column_stack([control, start])), axis=1)
        block = max(1, _LARGEST_BLOCK // (n_steps * (start.shape[1] + control.shape[1] + n_sensors)))
        for models, rows in self._with_parameters(kind, at.p, sound, timestep):
            for a in range(0, len(rows), block):
                some = rows[a : a + block]
                given = models[a : a + block] if len(models) > 1 else models
                held = np.broadcast_to(control[some, None], (len(some), n_steps, control.shape[1]))
                with silent():
                    full, read = self._rollout(given, start[some], held, timestep)
                states[some], sensors[some] = full[:, -1, 1 : 1 + self.n_states], read[:, 0]
        return states[which].T, sensors[which].T

    def _with_parameters(
        self, kind: str, p: Mapping[str, Any], sound: np.ndarray, timestep: float
    ) -> Iterator[tuple[list[Any], np.ndarray]]:
        """Models with their parameters, one for all or one each, and the points (numbers) that belong to them."""
        copies = self._copies[kind]
        single, varied = self._differing(p)
        fixed = {name: float(value) for name, value in single.items()}
        if not all(self.parameters[name].admits(value) for name, value in fixed.items()):
            return
        if not varied:
            with silent():
                one = copies.get(0, fixed, timestep)
            yield [one], np.flatnonzero(sound)
            return
        names = list(varied)
        table = np.stack([np.broadcast_to(varied[name], sound.shape) for name in names])
        sound = sound & np.all([self.parameters[name].admits(row) for name, row in zip(names, table)], axis=0)
        rows = np.flatnonzero(sound)
        if not len(rows):
            return
        first, which = first_of_equals(table[:, rows])
        sets = table[:, rows[first]]
        for a in range(0, sets.shape[1], copies.most):
            chosen = (which >= a) & (which < a + copies.most)
            with silent():
                models = [
                    copies.get(k, {**fixed, **dict(zip(names, values.tolist()))}, timestep)
                    for k, values in enumerate(sets[:, a : a + copies.most].T)
                ]
            yield [models[k] for k in (which[chosen] - a).tolist()], rows[chosen]

    def _differing(self, p: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Parameters that differ from the model's: one value for all points, or one each."""
        single: dict[str, Any] = {}
        varied: dict[str, Any] = {}
        for name, value in p.items():
            if name not in self.parameters:
                raise SimulatorError(f"params: the model has no parameter {name!r}; it has {sorted(self.parameters)}.")
            if np.ndim(value) == 0:
                if value != self.parameters[name].value:
                    single[name] = value
            elif np.size(value):
                first = np.ravel(value)[0]
                if np.any(value != first):
                    varied[name] = value
                elif first != self.parameters[name].value:
                    single[name] = first
        return single, varied

    # ---- runs -------------------------------------------------------------------------------------------------------
    def runs(
        self, t0: float, X0: np.ndarray, controls: np.ndarray, p: Mapping[str, float], rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Free runs, by the model's own step.

        Parameters
        ----------
        t0 : float
        X0 : ndarray (n_runs, n_states)
        controls : ndarray (n_runs, n_steps, n_controls + n_ports)
        p : dict of float
        rows : ndarray (n_samples,) of int
            Steps before each sample; the first is 0, the last at most ``n_steps - 1``.

        Returns
        -------
        states : ndarray (n_runs, n_samples, n_states)
        sensors : ndarray (n_runs, n_samples, n_components)
        """
        n_runs, n_steps, width = controls.shape
        start = np.tile(self.rest, (n_runs, 1))
        start[:, 0], start[:, 1 : 1 + self.n_states] = t0, X0
        states = np.full((n_runs, len(rows), self.n_states), np.nan)
        sensors = np.full((n_runs, len(rows), self.origin.nsensordata), np.nan)
        states[:, 0] = X0
        sound = np.all(np.isfinite(start), axis=1)
        block = max(1, _LARGEST_BLOCK // (n_steps * (len(self.rest) + width)))
        for models, able in self._with_parameters("step", p, sound, self.timestep):
            for a in range(0, len(able), block):
                some = able[a : a + block]
                with silent():
                    full, read = self._rollout(models, start[some], controls[some], self.timestep)
                states[some, 1:] = full[:, rows[1:] - 1, 1 : 1 + self.n_states]
                sensors[some] = read[:, rows]
        return states, sensors

    def stepper(self, p: Mapping[str, float]) -> Callable[[Any, np.ndarray, np.ndarray], np.ndarray]:
        """The model's own step with parameters that stay, for a loop over time: nothing is looked up at every step.

        It takes times, states (n_states, n_runs) and what enters (n_controls + n_ports, n_runs), and gives the states one step later;
        nan where the model cannot have the parameters. To be called within :func:`silent`.
        """
        found = list(self._with_parameters("step", p, np.ones(1, dtype=bool), self.timestep))

        def step(t: Any, x: np.ndarray, control: np.ndarray) -> np.ndarray:
            if not found:
                return np.full_like(x, np.nan)
            start = np.empty((x.shape[1], len(self.rest)))
            start[:] = self.rest
            start[:, 0], start[:, 1 : 1 + self.n_states] = t, x.T
            full, _ = self._rollout(found[0][0], start, control.T[:, None], self.timestep)
            return full[:, 0, 1 : 1 + self.n_states].T

        return step

    def _rollout(
        self, models: list[Any], start: np.ndarray, control: np.ndarray, timestep: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (n, n_steps, n_full) and sensors; nan from where the clock of a run stands still: MuJoCo found it diverging there."""
        n, n_steps = control.shape[:2]
        full, read = np.empty((n, n_steps, start.shape[1])), np.empty((n, n_steps, self.origin.nsensordata))
        self._pool.rollout(
            models * n if len(models) == 1 else models, self._data, start, np.ascontiguousarray(control),
            control_spec=self._control, skip_checks=True, nstep=n_steps, state=full, sensordata=read,
        )  # fmt: skip
        late = np.abs(full[:, :, 0] - start[:, :1] - timestep * np.arange(1, n_steps + 1)) > 0.5 * timestep
        if late.any():
            full[late], read[late] = np.nan, np.nan
        return full, read


class _Copies:
    """Copies of a model that hold different parameters; made when wanted, written when they differ."""

    def __init__(self, engine: Engine, first: Any):
        self.engine, self.first = engine, first
        self.most = int(np.clip(_MOST_BYTES // max(1, first.nbuffer), 1, _MOST_COPIES))
        self._models: list[Any] = []
        self._values: list[dict[str, float]] = []
        mujoco = require("mujoco", "mujoco")
        self._scratch, self._set_const = mujoco.MjData(first), mujoco.mj_setConst

    def get(self, k: int, values: dict[str, float], timestep: float) -> Any:
        """Copy k with these parameters in place of the model's own."""
        while len(self._models) <= k:
            self._models.append(copy.copy(self.first))
            self._values.append({})
        model = self._models[k]
        if values != self._values[k]:
            known, origin = self.engine.parameters, self.engine.origin
            own = {name: known[name].value for name in self._values[k] if name not in values}
            assign(model, origin, known, {**own, **values})
            if any(known[name].leads for name in (*own, *values)):
                self._set_const(model, self._scratch)
            self._values[k] = dict(values)
        model.opt.timestep = timestep
        return model


def _lean(model: Any) -> Any:
    """A copy that shows when a run diverges and leaves out what cannot change a number."""
    mujoco = require("mujoco", "mujoco")
    flags, out = mujoco.mjtDisableBit, copy.copy(model)
    without = [flags.mjDSBL_AUTORESET]
    if model.nsensor == 0:
        without.append(flags.mjDSBL_SENSOR)
    if model.npair == 0 and model.nflex == 0 and not np.any(colliding(model)):
        without.append(flags.mjDSBL_CONTACT)
    if model.ntree == 1 and hasattr(flags, "mjDSBL_ISLAND"):  # one tree is one island
        without.append(flags.mjDSBL_ISLAND)
    for flag in without:
        out.opt.disableflags |= int(flag)
    return out


def _explicit(model: Any) -> Any:
    """A copy whose Euler step adds the time derivative, nothing implicit."""
    mujoco = require("mujoco", "mujoco")
    out = copy.copy(model)
    out.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    out.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    out.actuator_actearly[:] = False
    exact = out.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
    out.actuator_dyntype[exact] = int(mujoco.mjtDyn.mjDYN_FILTER)
    return out


@contextmanager
def silent() -> Iterator[None]:
    """MuJoCo writes a file in the working folder for a run that diverges, which its clock shows, and for an inertia below 0."""
    mujoco = require("mujoco", "mujoco")
    before: Any = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_unheard)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _unheard(message: str) -> None:
    """Swallow a warning."""
    del message
