"""Forward dynamics and steps of a MuJoCo model that is a tree of hinges and slides, for many points at once.

MuJoCo computes one point after the other. Whether the equations agree with it is asked once, at random points; where they do not, and for
every other model, MuJoCo is asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.physics._components import Component, is_number, minus, plus, solved, times, with_diagonal
from sksurrogate.physics._dry_friction import DryFriction, friction_of
from sksurrogate.physics._mujoco_params import ModelParameter
from sksurrogate.physics._mujoco_points import Points
from sksurrogate.physics._mujoco_tree import Drive, Tree, is_tree, read_tree
from sksurrogate.physics._rigid_tree import bias, mass_matrix

#: Points that are computed together: they stay in the processor's cache.
BLOCK = 4096

#: Quantities of parameters that leave a tree a tree.
WRITTEN = ("damping", "frictionloss", "stiffness", "armature", "mass", "load", "gear", "kp", "kv")

#: Quantities of joints, and what a tree calls them.
AT_JOINTS = {"damping": "damping", "frictionloss": "friction", "armature": "armature", "stiffness": "stiffness"}

#: Positions or velocities, one number or array of points for each joint.
Joints: TypeAlias = list[Component]
#: (q, v) -> accelerations
Accelerations: TypeAlias = Callable[[Joints, Joints], Joints]


def with_values(tree: Tree, parameters: Mapping[str, ModelParameter], p: Mapping[str, Component]) -> Tree:
    """A tree with parameters in place of the model's own, and the softness of its dry frictions with these."""
    inertia, drives = list(tree.inertia), list(tree.drives)
    at_joints = {name: list(getattr(tree, field)) for name, field in AT_JOINTS.items()}
    for name, value in p.items():
        one = parameters[name]
        if one.quantity in at_joints:
            at_joints[one.quantity][one.index] = value
        elif name in tree.per_kilogram:
            link, unit = tree.per_kilogram[name]
            more = minus(value, one.value)
            inertia[link] = inertia[link].with_body(unit.times(more))
        elif one.element == "actuator":
            drives[one.index] = _driven(drives[one.index], one.quantity, value)
    damping, friction, armature, stiffness = at_joints.values()
    changed = tree._replace(
        inertia=inertia, drives=drives, damping=damping, friction=friction, armature=armature, stiffness=stiffness
    )
    return changed._replace(softness=softness_at_rest(changed))


def _driven(drive: Drive, quantity: str, value: Component) -> Drive:
    """An actuator with another gear, ``kp`` or ``kv``."""
    own, length, speed = drive.bias
    if quantity == "gear":
        return drive._replace(gear=value)
    if quantity == "kp":
        return drive._replace(gain=value, bias=(own, -value, speed))
    of_speed = is_number(length, 0.0)  # a servo of the velocity
    return drive._replace(gain=value if of_speed else drive.gain, bias=(own, length, -value))


def accelerations(tree: Tree, u: Joints, forces: Joints | None, q: Joints, v: Joints, damped: Joints | None) -> Joints:
    """Of all joints: ``M a = drives + forces - springs - damping - bias + dry friction``.

    ``u``: inputs of the drives.
    ``forces``: at the joints.
    ``damped``: what a step adds to the diagonal of the inertia once the dry friction is known.
    """
    places = [link.place(minus(a, zero)) for link, a, zero in zip(tree.links, q, tree.zero)]
    M = mass_matrix(tree.links, tree.inertia, places)
    held = bias(tree.links, tree.inertia, places, v, tree.gravity)
    torque = driven(tree, u, q, v)
    for j in range(len(q)):
        spring = times(tree.stiffness[j], minus(q[j], tree.slack[j]))
        entering = 0.0 if forces is None else forces[j]
        torque[j] = minus(plus(entering, torque[j]), plus(spring, times(tree.damping[j], v[j]), held[j]))
    M = with_diagonal(M, tree.armature)
    rubbing = list(map(DryFriction, tree.friction, tree.softness, tree.stopping))
    torque = list(map(plus, torque, friction_of(rubbing, M, torque, v)))
    return solved(M if damped is None else with_diagonal(M, damped), torque)


def driven(tree: Tree, u: Joints, q: Joints, v: Joints) -> Joints:
    """What the drives bring at every joint."""
    torque: Joints = [0.0] * len(q)
    for drive, value in zip(tree.drives, u):
        for j, own in drive.torques(value, q, v).items():
            torque[j] = plus(torque[j], own)
    return torque


def softness_at_rest(tree: Tree) -> Joints:
    """Softness of every dry friction, over the inertia that its joint feels where the bodies stand as written."""
    if all(is_number(loss, 0.0) for loss in tree.friction):
        return [0.0] * len(tree.links)
    places = [link.place(0.0) for link in tree.links]
    M = with_diagonal(mass_matrix(tree.links, tree.inertia, places), tree.armature)
    units = [[float(i == j) for i in range(len(M))] for j in range(len(M))]
    return [times(soft, solved(M, unit)[j]) for j, (soft, unit) in enumerate(zip(tree.softness, units))]


def damped_in_a_step(tree: Tree, model: Any, h: float) -> Joints | None:
    """What the model's integrator adds to the inertia, for its step h: the damping at the end of the step; None where it adds none."""
    kinds = require("mujoco", "mujoco").mjtIntegrator
    if model.opt.integrator == kinds.mjINT_RK4:
        return None
    implicit = [times(h, d) for d in tree.damping]
    if model.opt.integrator == kinds.mjINT_IMPLICITFAST:
        for drive in tree.drives:
            for j, arm in drive.arms.items():
                gear = times(drive.gear, drive.gear)
                implicit[j] = minus(implicit[j], times(h * arm**2, times(gear, drive.bias[2])))
    return implicit


def stepped(acceleration: Accelerations, q: Joints, v: Joints, h: float, order_four: bool) -> tuple[Joints, Joints]:
    """Positions and velocities a step later: Euler's, velocities first, or that of Runge and Kutta."""
    a1 = acceleration(q, v)
    if not order_four:
        v = _moved(v, h, a1)
        return _moved(q, h, v), v
    v2 = _moved(v, h / 2, a1)
    a2 = acceleration(_moved(q, h / 2, v), v2)
    v3 = _moved(v, h / 2, a2)
    a3 = acceleration(_moved(q, h / 2, v2), v3)
    v4 = _moved(v, h, a3)
    a4 = acceleration(_moved(q, h, v3), v4)
    return _moved(q, h, list(map(_mean, v, v2, v3, v4))), _moved(v, h, list(map(_mean, a1, a2, a3, a4)))


def _moved(a: Joints, h: float, rates: Joints) -> Joints:
    return [x + h * rate for x, rate in zip(a, rates)]


def _mean(a: Component, b: Component, c: Component, d: Component) -> Component:
    """Of the four slopes."""
    return (a + 2.0 * (b + c) + d) / 6.0


@dataclass(frozen=True, eq=False)
class MuJoCoEquations:
    """Of one model.

    ``model``, ``parameters``: as they were read.
    """

    model: Any
    parameters: Mapping[str, ModelParameter]
    tree: Tree

    @classmethod
    def of(cls, model: Any, parameters: Mapping[str, ModelParameter]) -> MuJoCoEquations | None:
        """None for a model that is no tree, or that is stepped by an integrator that is not written here."""
        kinds = require("mujoco", "mujoco").mjtIntegrator
        written = model.opt.integrator in (kinds.mjINT_EULER, kinds.mjINT_IMPLICITFAST, kinds.mjINT_RK4)
        return cls(model, parameters, read_tree(model, parameters)) if written and is_tree(model) else None

    def hold(self, p: Mapping[str, Any]) -> bool:
        """Whether parameters that differ from the model's leave it a tree."""
        return all(self.parameters[name].quantity in WRITTEN for name in p)

    @np.errstate(all="ignore")
    def rates(self, at: Points) -> np.ndarray:
        """Time derivatives (n_states, n_points); nan where the equations leave them open.

        That is where an end stop acts, where no guess of what slides is right, and where the model cannot have the parameters.
        """
        out = np.empty_like(at.x)
        for rows, (tree, u, forces, q, v) in self._blocks(at):
            out[:, rows] = _stacked([*v, *accelerations(tree, u, forces, q, v, None)])
        return np.where(self._sound(at, out) & ~self._beyond(at.x), out, np.nan)

    @np.errstate(all="ignore")
    def step(self, at: Points, n_steps: int, h: float) -> np.ndarray:
        """States (n_states, n_points) some steps later; nan as in :meth:`rates`."""
        out, beyond = np.empty_like(at.x), np.zeros(at.x.shape[1], dtype=bool)
        order_four = self.model.opt.integrator == require("mujoco", "mujoco").mjtIntegrator.mjINT_RK4
        for rows, (tree, u, forces, q, v) in self._blocks(at):
            solve = partial(accelerations, tree, u, forces, damped=damped_in_a_step(tree, self.model, h))
            for _ in range(n_steps):
                beyond[rows] |= self._beyond(q)
                q, v = stepped(solve, q, v, h, order_four)
            out[:, rows] = _stacked([*q, *v])
        return np.where(self._sound(at, out) & ~beyond & ~self._beyond(out), out, np.nan)

    def drive_forces(self, at: Points) -> np.ndarray:
        """What the drives bring at every joint (n_joints, n_points)."""
        out = np.empty((len(self.tree.links), at.x.shape[1]))
        at = replace(at, p={name: value for name, value in at.p.items() if self.parameters[name].element == "actuator"})
        for rows, (tree, u, _, q, v) in self._blocks(at):
            out[:, rows] = _stacked([np.broadcast_to(one, q[0].shape) for one in driven(tree, u, q, v)])
        return out

    def _beyond(self, q: Any) -> np.ndarray:
        """Where an end stop acts (n_points,), by positions: one array for each joint, and what comes behind them."""
        low_high = zip(q, self.tree.limits)
        return np.any([(a <= low) | (a >= high) for a, (low, high) in low_high if low > -np.inf] or [False], axis=0)

    def random_points(self, n_points: int) -> Points:
        """Between the limits of the joints, every parameter at random too."""
        rng, model, n = np.random.default_rng(0), self.model, len(self.tree.links)
        low, high = np.clip(self.tree.limits.T, -3.0, 3.0)[:, :, None]
        inertia = model.dof_M0[:, None]
        p = {}
        for name, one in self.parameters.items():
            if one.quantity in WRITTEN:
                size = (
                    float(model.dof_M0[one.index]) if one.element == "joint" else one.weight.mass if one.weight else 0.0
                )
                p[name] = one.value * rng.uniform(0.7, 2.0, n_points) + size * rng.uniform(0.0, 1.0, n_points)
        x = np.concatenate([rng.uniform(low, high, (n, n_points)), rng.normal(0.0, 2.0, (n, n_points))])
        forces = inertia * rng.normal(0.0, 5.0, (n, n_points))
        return Points(np.zeros(n_points), x, rng.normal(0.0, 2.0, (model.nu, n_points)), forces, p)

    def _blocks(self, at: Points) -> Iterator[tuple[slice, tuple[Tree, Joints, Joints | None, Joints, Joints]]]:
        """Rows of some points, and the arguments of :func:`accelerations` there."""
        n = len(self.tree.links)
        for a in range(0, at.x.shape[1], BLOCK):
            rows = slice(a, a + BLOCK)
            some = at.some(rows)
            tree = with_values(self.tree, self.parameters, some.p)
            forces = None if some.forces is None else list(some.forces)
            yield rows, (tree, list(some.controls), forces, list(some.x[:n]), list(some.x[n:]))

    def _sound(self, at: Points, out: np.ndarray) -> np.ndarray:
        """Where parameters are what a model can have, and everything is finite (n_points,)."""
        admitted = [self.parameters[name].admits(value) for name, value in at.p.items()]
        return np.all(np.broadcast_arrays(*np.isfinite(at.x), *np.isfinite(out), *admitted), axis=0)


def _stacked(parts: Joints) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*parts))
