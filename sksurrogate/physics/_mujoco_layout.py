"""Names of the states, inputs, ports and sensors of a MuJoCo model, and where they stand in its arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError, require

_LINEAR_AXES, _ROTATION, _QUATERNION = ("x", "y", "z"), ("rx", "ry", "rz"), ("qw", "qx", "qy", "qz")
#: Components of a sensor by their number; others are counted.
_COMPONENTS = {3: _LINEAR_AXES, 4: ("w", *_LINEAR_AXES)}


@dataclass(frozen=True)
class Layout:
    """What a model's numbers are called.

    Attributes
    ----------
    positions, velocities, activations : tuple of str
        The states, in the order of ``qpos``, ``qvel`` and ``act``.
    controls : tuple of str
        One name for each control (each actuator, mostly).
    ports : tuple of str
        One name for each degree of freedom: a generalised force enters there.
    sensors : dict of int
        Place of every sensor component in ``sensordata``.
    same : dict of str
        The state that a sensor reads, by its name.
    slopes : ndarray (n_scalars, 2) of int
        Positions whose rate is a velocity: place in ``qpos``, place in ``qvel``.
    quaternions : ndarray (n_quaternions, 2) of int
        First place in ``qpos``, first place of the angular velocity (in the body's frame) in ``qvel``.
    """

    positions: tuple[str, ...]
    velocities: tuple[str, ...]
    activations: tuple[str, ...]
    controls: tuple[str, ...]
    ports: tuple[str, ...]
    sensors: dict[str, int]
    same: dict[str, str]
    slopes: np.ndarray
    quaternions: np.ndarray

    @property
    def states(self) -> tuple[str, ...]:
        """Positions, velocities, activations."""
        return (*self.positions, *self.velocities, *self.activations)

    def position_rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """``dq/dt`` (n_positions, n_points): velocities, and half the product of quaternion and angular velocity."""
        out = np.empty_like(q)
        out[self.slopes[:, 0]] = v[self.slopes[:, 1]]
        for place, first in self.quaternions:
            w, x, y, z = q[place : place + 4]
            a, b, c = 0.5 * v[first : first + 3]
            out[place] = -x * a - y * b - z * c
            out[place + 1] = w * a + y * c - z * b
            out[place + 2] = w * b + z * a - x * c
            out[place + 3] = w * c + x * b - y * a
        return out


def name_of(model: Any, kind: str, i: int) -> str:
    """Name of an element, or its kind and number where it has none."""
    mujoco = require("mujoco", "mujoco")
    try:
        return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) or f"{kind}{i}"
    except UnicodeDecodeError as error:
        raise SimulatorError(
            f"model: the name of {kind} {i} is not UTF-8 ({error}): save the file as UTF-8."
        ) from error


def read_layout(model: Any) -> Layout:
    """Names of a model."""
    positions, velocities, joints, slopes, quaternions = _joints(model)
    controls, activations = _actuators(model)
    ports = [f"{port}.force" if port in controls else port for port in joints]
    sensors = [
        (part, int(first) + k)
        for i, (first, size) in enumerate(zip(model.sensor_adr, model.sensor_dim))
        for k, part in enumerate(_parts(name_of(model, "sensor", i), int(size)))
    ]
    read = _states_of_sensors(model)
    others = [name for name, _ in sensors if read.get(name) != name]
    _check_distinct((*positions, *velocities, *activations, *others))
    _check_distinct((*controls, *ports))
    return Layout(
        tuple(positions), tuple(velocities), activations, controls, tuple(ports), dict(sensors), read,
        np.array(slopes, dtype=int).reshape(-1, 2), np.array(quaternions, dtype=int).reshape(-1, 2),
    )  # fmt: skip


def _check_distinct(names: tuple[str, ...]) -> None:
    """Elements that are asked for by name need one of their own."""
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise SimulatorError(
            f"model: {twice[0]!r} stands for two of its joints, actuators or sensors (one without a name is called by its kind and "
            "number): give each a name of its own in the MJCF."
        )


def _states_of_sensors(model: Any) -> dict[str, str]:
    """Sensors that read a state, and nothing else of it than its value."""
    kinds = require("mujoco", "mujoco").mjtSensor
    ends = {int(kinds.mjSENS_JOINTPOS): "pos", int(kinds.mjSENS_JOINTVEL): "vel"}
    columns = model.sensor_type.tolist(), model.sensor_objid.tolist(), model.sensor_cutoff.tolist()
    return {
        name_of(model, "sensor", i): f"{name_of(model, 'joint', j)}.{ends[kind]}"
        for i, (kind, j, cutoff) in enumerate(zip(*columns))
        if kind in ends and not cutoff
    }


def _joints(
    model: Any,
) -> tuple[list[str], list[str], list[str], list[tuple[int, int]], list[tuple[int, int]]]:
    """Names of positions, velocities and degrees of freedom; which position follows which velocity, plainly and as a quaternion."""
    kinds = require("mujoco", "mujoco").mjtJoint
    positions: list[str] = []
    velocities: list[str] = []
    freedoms: list[str] = []
    slopes: list[tuple[int, int]] = []
    quaternions: list[tuple[int, int]] = []
    for i, kind in enumerate(map(kinds, model.jnt_type.tolist())):
        joint, first = name_of(model, "joint", i), len(positions)
        if kind in (kinds.mjJNT_HINGE, kinds.mjJNT_SLIDE):
            slopes.append((first, len(velocities)))
            positions.append(f"{joint}.pos")
            velocities.append(f"{joint}.vel")
            freedoms.append(joint)
            continue
        linear = _LINEAR_AXES if kind == kinds.mjJNT_FREE else ()
        slopes += [(first + k, len(velocities) + k) for k in range(len(linear))]
        quaternions.append((first + len(linear), len(velocities) + len(linear)))
        positions += [f"{joint}.pos.{part}" for part in (*linear, *_QUATERNION)]
        velocities += [f"{joint}.vel.{part}" for part in (*linear, *_ROTATION)]
        freedoms += [f"{joint}.{part}" for part in (*linear, *_ROTATION)]
    return positions, velocities, freedoms, slopes, quaternions


def _actuators(model: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of controls and activations."""
    controls, activations = [""] * model.nu, [""] * model.na
    count = len(model.actuator_trntype)
    # one control an actuator before MuJoCo 3.15
    several = getattr(model, "actuator_ctrlnum", np.ones(count, dtype=int))
    firsts = getattr(model, "actuator_ctrladr", np.arange(count))
    for i in range(count):
        name = name_of(model, "actuator", i)
        for k, part in enumerate(_parts(name, int(several[i]))):
            controls[int(firsts[i]) + k] = part
        own = int(model.actuator_actnum[i])
        for k, part in enumerate(_parts(f"{name}.act", own)):
            activations[int(model.actuator_actadr[i]) + k] = part
    return tuple(controls), tuple(activations)


def _parts(name: str, size: int) -> list[str]:
    """A name, or those of its components."""
    if size == 1:
        return [name]
    return [f"{name}.{part}" for part in _COMPONENTS.get(size, range(size))]
