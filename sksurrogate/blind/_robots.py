"""Robots whose effect is withheld: what acts in the real one, marched by MuJoCo's own steps, and the cases made of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.blind._robot_models import RobotSpec, draw_robot, robot_inputs
from sksurrogate.exceptions import require

#: Share by which the size of an effect is moved for the oracle that fits it.
MOVED = 1e-3
#: Sizes tried, over a natural unit of the effect.
EFFECT_SIZES = np.geomspace(2e-3, 2.0, 13)
FRICTIONS = ("coulomb_friction", "stribeck_friction", "lugre_friction", "asymmetric_friction")


@dataclass(frozen=True)
class RobotTruth:
    """What acts in a real robot."""

    name: str  #: Kind; see :data:`ANSWERS`
    joint: int
    size: float  #: Over the natural unit of the kind
    dice: tuple[float, ...] = ()  #: Further numbers in [0, 1) of which a kind makes its shape


#: Kind -> right answers (name, location) of a joint, ``{}`` standing for its name.
ANSWERS: dict[str, tuple[tuple[str, str], ...]] = {
    "frictionloss": (("coulomb_friction", "{}"), ("parameter_error", "{}.frictionloss")),
    "stribeck": (("stribeck_friction", "{}"),),
    "load_friction": tuple((name, "{}") for name in ("load_friction", *FRICTIONS)),
    "damping": (("linear_loss", "{}"), ("parameter_error", "{}.damping")),
    "armature": (("parameter_error", "{}.armature"),),
    "gear": (("parameter_error", "drive_{}.gear"), ("input_gain", "drive_{}")),
    "delay": (("input_delay", "drive_{}"),),
    "backlash": (("input_backlash", "drive_{}"),),
    "sensor_offset": (("sensor_bias", "{}.pos"),),
    "payload": (("parameter_error", "link_{}.load"),),
    "cogging": (),
}
#: Kinds whose form is not the catalogue's: a partial explanation by the right name is right.
INEXACT_ANSWERS = ("load_friction", "stribeck")


def real_runs(robot: RobotSpec, truth: RobotTruth | None, U: np.ndarray, X0: np.ndarray) -> np.ndarray:
    """Joint positions (n_runs, n_samples, n_joints) of the real robot, by ``mj_step``.

    ``U`` (n_runs, n_samples, n_joints).
    ``X0`` (n_runs, 2 n_joints).
    """
    mujoco = require("mujoco", "mujoco")
    payload = truth.size * robot.masses[-1] if truth is not None and truth.name == "payload" else 0.0
    model = mujoco.MjModel.from_xml_string(robot.mjcf(payload))
    force = None if truth is None else _acting(model, robot, truth)
    n, ratio = len(robot.joints), round(robot.dt / robot.timestep)
    Y = np.full((len(U), U.shape[1], n), np.nan)
    for r, run in enumerate(U):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = X0[r, :n], X0[r, n:]
        held = np.repeat(_commands(robot, truth, run, ratio), 1, axis=0)
        for k in range(len(run)):
            Y[r, k] = data.qpos
            for s in range(ratio):
                data.ctrl[:] = held[k * ratio + s]
                if force is not None:
                    data.qfrc_applied[:] = 0.0
                    data.qfrc_applied[truth.joint] = force(data)  # type: ignore[union-attr]
                mujoco.mj_step(model, data)
            if not np.abs(data.qpos).max() < 60.0:
                return Y
    if truth is not None and truth.name == "sensor_offset":
        Y[:, :, truth.joint] += truth.size
    return Y


def _acting(model: Any, robot: RobotSpec, truth: RobotTruth) -> Callable[[Any], float] | None:
    """Change a model by a truth that is one of its numbers; what a force at the joint is otherwise."""
    j, size = truth.joint, truth.size
    unit = robot.inertia[j] * 8.0  # a torque that matters there
    inner = 1.0 / robot.inertia[j]
    if truth.name == "frictionloss":
        model.dof_frictionloss[j] = size * unit
    elif truth.name == "damping":
        model.dof_damping[j] += size * unit
    elif truth.name == "armature":
        model.dof_armature[j] += 2.0 * size * robot.inertia[j]
    elif truth.name == "gear":
        model.actuator_gear[j, 0] *= 1.0 + 0.5 * min(size, 1.0) * (1.0 if truth.dice[0] < 0.5 else -1.0)
    elif truth.name in ("stribeck", "load_friction"):
        rest, speed = 1.5 + truth.dice[0], 0.2 + 0.6 * truth.dice[1]
        width = max(0.01, 3.0 * robot.timestep * size * unit * rest * inner)

        def friction(data: Any) -> float:
            v = float(data.qvel[j])
            if truth.name == "stribeck":
                level = size * unit * (1.0 + (rest - 1.0) * np.exp(-((v / speed) ** 2)))
            else:
                level = size * (0.4 * unit + abs(float(data.qfrc_actuator[j])))
            return -level * float(np.tanh(v / width))

        return friction
    elif truth.name == "cogging":
        teeth, phase = 5.0 + 10.0 * truth.dice[0], 6.28 * truth.dice[1]
        return lambda data: -size * unit * float(np.sin(teeth * data.qpos[j] + phase))
    return None


def _commands(robot: RobotSpec, truth: RobotTruth | None, run: np.ndarray, ratio: int) -> np.ndarray:
    """What the actuators get at every step of the model, (n_samples * ratio, n_joints)."""
    held = np.repeat(run, ratio, axis=0)
    if truth is None or truth.name not in ("delay", "backlash"):
        return held
    held = held.copy()
    u = held[:, truth.joint].copy()
    if truth.name == "delay":
        late = max(1, round(8.0 * truth.size * ratio))
        held[:, truth.joint] = np.r_[np.full(late, u[0]), u][: len(u)]
        return held
    half, at = 0.5 * truth.size * robot.amplitude[truth.joint], float(u[0])
    for k, value in enumerate(u):
        at = min(max(at, value - half), value + half)
        held[k, truth.joint] = at
    return held


def robot_case(rng: np.random.Generator, kind: str | None) -> dict[str, Any] | None:
    """A robot with something in it that makes a gap of 8 to 40 times the noise, as plain data; None where it cannot.

    ``kind``: one of :data:`ANSWERS`; None: nothing.
    Returns dict or None: robot, truth, U, X0, clean readings of the recorded and the test runs, all of these with the
        size moved by :data:`MOVED` of itself, noise (n_joints,), gap over noise.
    """
    robot = draw_robot(rng)
    if kind == "backlash" and not robot.servo:
        return None
    n, n_runs, n_samples = len(robot.joints), int(rng.integers(4, 7)), int(rng.integers(110, 180))
    U, X0 = robot_inputs(rng, robot, n_runs + 2, n_samples), rng.normal(size=(n_runs + 2, 2 * n)) * 0.3
    nominal = real_runs(robot, None, U, X0)
    if not np.isfinite(nominal).all() or np.abs(nominal).max() > 12.0:
        return None
    noise = float(np.exp(rng.uniform(np.log(1e-3), np.log(8e-3)))) * np.std(nominal[:n_runs], axis=(0, 1))
    joint, dice = (n - 1 if kind == "payload" else int(rng.integers(n))), tuple(rng.random(3))
    truth, real, moved, gap = None, nominal, nominal, 0.0
    if kind is not None:
        target = float(np.exp(rng.uniform(np.log(8.0), np.log(40.0))))
        found = [
            _gap(robot, RobotTruth(kind, joint, float(s), dice), U[:2], X0[:2], nominal[:2], noise)
            for s in EFFECT_SIZES
        ]
        able = [k for k, value in enumerate(found) if 6.0 <= value <= 80.0]
        if not able:
            return None
        k = min(able, key=lambda i: abs(np.log(found[i] / target)))
        truth = RobotTruth(kind, joint, float(EFFECT_SIZES[k]), dice)
        real = real_runs(robot, truth, U, X0)
        moved = real_runs(robot, replace(truth, size=truth.size * (1.0 + MOVED)), U, X0)
        gap = _over(real[:n_runs], nominal[:n_runs], noise)
        if not np.isfinite(real).all() or not gap >= 5.0:
            return None
    return {
        "robot": robot, "truth": truth, "U": U[:n_runs], "X0": X0[:n_runs], "U_test": U[n_runs:], "X0_test": X0[n_runs:],
        "clean": real[:n_runs], "test": real[n_runs:], "moved": moved, "noise": noise, "gap": gap,
    }  # fmt: skip


def _over(real: np.ndarray, nominal: np.ndarray, noise: np.ndarray) -> float:
    """Root mean square of the gap over the noise; infinite where a run diverged."""
    error = (real - nominal) / noise
    return float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else float("inf")


def _gap(
    robot: RobotSpec, truth: RobotTruth, U: np.ndarray, X0: np.ndarray, nominal: np.ndarray, noise: np.ndarray
) -> float:
    """Gap over noise on some runs."""
    return _over(real_runs(robot, truth, U, X0), nominal, noise)
