"""A MuJoCo model as a tree of hinges and slides, where it is one and nothing else acts: no contact or fluid, no tendon but fixed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.physics._components import Component, Matrix, Vector, plus, times
from sksurrogate.physics._mujoco_load import matrix_of
from sksurrogate.physics._mujoco_params import ModelParameter, colliding
from sksurrogate.physics._rigid_tree import Inertia, Link

#: Numbers of a frame below this are rounding.
ROUNDING = 1e-14
#: Counts of a model that are zero in a mere tree.
COUNTS = ("neq", "nflex", "nplugin", "nmocap", "na", "npair", "nhistory", "nplastic")
#: Arrays of a model that are zero where its joints and actuators are linear and nothing else pushes.
ZEROS = (
    "dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield", "jnt_actfrclimited", "jnt_actgravcomp",
    "body_gravcomp", "actuator_dyntype", "actuator_gaintype", "actuator_damping", "actuator_dampingpoly", "actuator_armature",
    "actuator_actnum", "tendon_stiffness", "tendon_stiffnesspoly", "tendon_damping", "tendon_dampingpoly", "tendon_frictionloss",
    "tendon_limited", "tendon_armature", "tendon_actfrclimited",
)  # fmt: skip


class Drive(NamedTuple):
    """An actuator: its force is ``gain u + bias[0] + bias[1] length + bias[2] speed``; a joint feels its arm times ``gear`` times that.

    ``arms``: joints that it pulls, and by how much its length grows for a unit of each; one joint, or those of a fixed tendon.
    """

    arms: dict[int, float]
    gear: Component
    gain: Component
    bias: tuple[Component, Component, Component]
    inputs: tuple[float, float] | None  #: Range of u
    forces: tuple[float, float] | None

    def torques(self, u: Component, q: Sequence[Component], v: Sequence[Component]) -> dict[int, Component]:
        """By joint, at positions and speeds of all."""
        u = u if self.inputs is None else np.clip(u, *self.inputs)
        own, length, speed = self.bias
        rest = (own, times(length, self.pulled(q)), times(speed, self.pulled(v)))
        force = plus(times(self.gain, u), *rest)
        force = times(self.gear, force if self.forces is None else np.clip(force, *self.forces))
        return {joint: times(arm, force) for joint, arm in self.arms.items()}

    def pulled(self, q: Sequence[Component]) -> Component:
        """Length, or speed, of the actuator."""
        return times(self.gear, plus(*(times(arm, q[joint]) for joint, arm in self.arms.items())))


class Tree(NamedTuple):
    """Links with one joint each, at the model's own parameters.

    Attributes
    ----------
    per_kilogram : dict of (int, Inertia)
        By the name of a mass: link, and what a kilogram more adds to its inertia.
    limits : ndarray (n_joints, 2)
        Positions between which no end stop acts.
    """

    links: list[Link]
    inertia: list[Inertia]
    per_kilogram: dict[str, tuple[int, Inertia]]
    damping: list[Component]
    friction: list[Component]  #: Largest dry friction
    #: Of a dry friction: of a model as it is read for a unit of inertia, then in units of the friction's own
    softness: list[Component]
    stopping: list[float]  #: A dry friction stops a speed in the inverse of this
    armature: list[Component]
    stiffness: list[Component]
    slack: list[float]  #: Positions of the springs
    zero: list[float]  #: Positions in which the bodies stand as they are written
    limits: np.ndarray
    drives: list[Drive]
    gravity: Vector


def is_tree(model: Any) -> bool:
    """Whether nothing in a model is beyond linear joints and actuators; positions of joints with limits may be beyond them."""
    mujoco = require("mujoco", "mujoco")
    plain = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    flags = mujoco.mjtDisableBit
    harmless = flags.mjDSBL_WARMSTART | flags.mjDSBL_AUTORESET | flags.mjDSBL_CONTACT
    opt, nothing = model.opt, np.zeros(1)
    pulls = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_TENDON)]
    return bool(
        model.njnt
        and np.isin(model.jnt_type, [int(kind) for kind in plain]).all()
        and not any(getattr(model, name, 0) for name in COUNTS)
        and not any(np.any(getattr(model, name, nothing)) for name in ZEROS)
        and np.isin(model.actuator_biastype, [int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)]).all()
        and np.isin(model.actuator_trntype, pulls).all() and np.all(model.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT))
        and (opt.disableflags & flags.mjDSBL_CONTACT or not np.any(colliding(model)))
        and not (opt.density or opt.viscosity or opt.enableflags or opt.disableactuator or opt.disableflags & ~int(harmless))
        and model.nu == len(model.actuator_trntype)
        and np.all(model.dof_solref[:, 0] >= 2.0 * opt.timestep)  # below, MuJoCo takes another one, or the numbers mean something else
    )  # fmt: skip


def read_tree(model: Any, parameters: Mapping[str, ModelParameter]) -> Tree:
    """Of a model that :func:`is_tree`."""
    links, where = _links(model)
    inertia = [Inertia(0.0, (0.0, 0.0, 0.0), _numbers(np.zeros((3, 3))))] * len(links)
    for body, (link, turn, origin) in where.items():
        if link >= 0 and model.body_mass[body] > 0:
            axes, centre = matrix_of(model.body_iquat[body]), np.array(model.body_ipos[body])
            about = axes @ np.diag(model.body_inertia[body]) @ axes.T
            own = _inertia(float(model.body_mass[body]), centre, about, turn, origin)
            inertia[link] = inertia[link].with_body(own)
    per_kilogram = {}
    for name, one in parameters.items():
        if one.weight is not None and where[one.index][0] >= 0:
            link, turn, origin = where[one.index]
            weight, about = one.weight, np.zeros((3, 3))
            if one.quantity == "mass":
                axes = matrix_of(weight.turn)
                about = axes @ np.diag(weight.inertia / weight.mass) @ axes.T
            centre = weight.centre if one.quantity == "mass" else np.asarray(weight.tip)
            per_kilogram[name] = link, _inertia(1.0, centre, about, turn, origin)
    limited = model.jnt_limited.astype(bool)[:, None]
    inside = model.jnt_range + model.jnt_margin[:, None] * [1.0, -1.0]
    return Tree(
        links, inertia, per_kilogram, model.dof_damping.tolist(), model.dof_frictionloss.tolist(), *_of_friction(model),
        model.dof_armature.tolist(), model.jnt_stiffness.tolist(),
        model.qpos_spring.tolist(), model.qpos0.tolist(), np.where(limited, inside, [-np.inf, np.inf]),
        [_drive(model, i) for i in range(model.nu)], _vector(model.opt.gravity),
    )  # fmt: skip


def _of_friction(model: Any) -> tuple[list[float], list[float]]:
    """Softness of the dry friction of every joint, and how fast it stops it: MuJoCo's impedance at rest, and its reference."""
    low, high, width = model.dof_solimp[:, :3].T
    least, most = 1e-4, 1.0 - 1e-4  # of MuJoCo
    impedance = np.clip(np.where((low == high) | (width <= 1e-15), 0.5 * (low + high), low), least, most)
    stopping = 2.0 / (np.clip(high, least, most) * model.dof_solref[:, 0])
    return ((1.0 - impedance) / impedance).tolist(), stopping.tolist()


def _links(model: Any) -> tuple[list[Link], dict[int, tuple[int, np.ndarray, np.ndarray]]]:
    """Links, and for every body the link that it belongs to (-1: the ground) and its frame in that of the link."""
    hinge = int(require("mujoco", "mujoco").mjtJoint.mjJNT_HINGE)
    links, where = list[Link](), {0: (-1, np.eye(3), np.zeros(3))}
    for body in range(1, model.nbody):
        link, turn, origin = where[int(model.body_parentid[body])]
        turn, origin = turn @ matrix_of(model.body_quat[body]), origin + turn @ model.body_pos[body]
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            anchor = np.array(model.jnt_pos[joint])
            kind, axis = int(model.jnt_type[joint]) == hinge, _vector(model.jnt_axis[joint])
            links.append(Link(link, kind, axis, _numbers(turn), _vector(origin + turn @ anchor)))
            link, turn, origin = joint, np.eye(3), -anchor
        where[body] = link, turn, origin
    return links, where


def _inertia(mass: float, centre: np.ndarray, about: np.ndarray, turn: np.ndarray, origin: np.ndarray) -> Inertia:
    """Of a body, from its centre of mass and inertia (3, 3) about it in its frame; in the frame of the link."""
    c = origin + turn @ centre
    second = turn @ about @ turn.T + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return Inertia(mass, _vector(mass * c), _numbers(second))


def _drive(model: Any, i: int) -> Drive:
    """Of an actuator."""
    low_high = [
        tuple(getattr(model, f"actuator_{name}range")[i].tolist()) if getattr(model, f"actuator_{name}limited")[i] else None
        for name in ("ctrl", "force")
    ]  # fmt: skip
    affine = int(model.actuator_biastype[i]) == int(require("mujoco", "mujoco").mjtBias.mjBIAS_AFFINE)
    own = tuple(model.actuator_biasprm[i, :3].tolist()) if affine else (0.0, 0.0, 0.0)
    gear, gain = float(model.actuator_gear[i, 0]), float(model.actuator_gainprm[i, 0])
    return Drive(_arms(model, i), gear, gain, own, *low_high)  # type: ignore[arg-type]


def _arms(model: Any, i: int) -> dict[int, float]:
    """Of actuator i: its joint, or those of its fixed tendon."""
    pulled = int(model.actuator_trnid[i, 0])
    if int(model.actuator_trntype[i]) == int(require("mujoco", "mujoco").mjtTrn.mjTRN_JOINT):
        return {pulled: 1.0}
    first, count = int(model.tendon_adr[pulled]), int(model.tendon_num[pulled])
    rows = slice(first, first + count)
    return dict(zip(model.wrap_objid[rows].tolist(), model.wrap_prm[rows].tolist()))


def _vector(a: Sequence[float] | np.ndarray) -> Vector:
    """Three numbers, rounding taken for zero."""
    a = np.asarray(a, dtype=float)
    x, y, z = np.where(np.abs(a) <= ROUNDING * np.abs(a).max(), 0.0, a).tolist()
    return x, y, z


def _numbers(A: np.ndarray) -> Matrix:
    """Rows of three numbers, rounding taken for zero."""
    x, y, z = np.where(np.abs(A) <= ROUNDING * np.abs(A).max(), 0.0, A).tolist()
    return tuple(x), tuple(y), tuple(z)
