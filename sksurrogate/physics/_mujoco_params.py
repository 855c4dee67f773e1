"""Parameters of a MuJoCo model by name: where they stand, how they are read and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.physics._mujoco_layout import name_of
from sksurrogate.physics._mujoco_load import Weight

#: Friction of a geom: its three columns.
_FRICTION = ("friction", "torsional_friction", "rolling_friction")
#: Quantities of a joint below 0 of which it would make energy, or mass, of nothing.
_NOT_NEGATIVE = ("damping", "frictionloss", "armature")
#: Quantities of which ``mj_setConst`` computes others: inertias about the joints, and the acceleration by an actuator.
_LEADING = ("mass", "load", "armature", "gear")


@dataclass(frozen=True)
class ModelParameter:
    """One number of a model.

    Attributes
    ----------
    element : {"joint", "body", "actuator", "geom"}
    index : int
        Number of the element.
    quantity : str
        Last part of the name.
    value : float
        The model's own.
    weight : Weight or None
        Of a body.
    """

    element: str
    index: int
    quantity: str
    value: float
    weight: Weight | None = None

    def admits(self, value: Any) -> Any:
        """Whether a model can have this value (elementwise)."""
        return np.isfinite(value) & ((np.asarray(value) > 0) | (self.quantity != "mass"))

    @property
    def not_negative(self) -> bool:
        """Whether a value below 0 has no meaning, though a model takes it; one that the model has itself is left to it."""
        return self.quantity in _NOT_NEGATIVE and self.value >= 0.0

    @property
    def leads(self) -> bool:
        """Whether other numbers of a model follow from it."""
        return self.quantity in _LEADING

    @property
    def domain(self) -> str:
        """What :meth:`admits`, in words."""
        return "a finite number above 0" if self.quantity == "mass" else "a finite number"


def read_parameters(model: Any) -> dict[str, ModelParameter]:
    """Everything that can be re-tuned, by name."""
    found: list[tuple[Any, ...]] = []
    for i, dof in enumerate(model.jnt_dofadr):
        found += [("joint", i, name, float(getattr(model, f"dof_{name}")[dof])) for name in ("damping", "frictionloss", "armature")]  # fmt: skip
        found.append(("joint", i, "stiffness", float(model.jnt_stiffness[i])))
    for i in range(1, model.nbody):
        if model.body_mass[i] > 0:
            weight = Weight.of(model, i)
            found.append(("body", i, "mass", weight.mass, weight))
            found += [("body", i, "load", 0.0, weight)] if weight.tip is not None else []
    for i in range(len(model.actuator_trntype)):
        found += [("actuator", i, *item) for item in _of_actuator(model, i)]
    touching = colliding(model)
    for i in range(model.ngeom):
        if touching[i]:
            found += [("geom", i, name, float(model.geom_friction[i, k])) for k, name in enumerate(_FRICTION)]
    out: dict[str, ModelParameter] = {}
    for element, i, quantity, *own in found:
        out.setdefault(f"{name_of(model, element, i)}.{quantity}", ModelParameter(element, i, quantity, *own))
    return out


def colliding(model: Any) -> np.ndarray:
    """Which geoms may touch another one, bool (n_geoms,): by their masks, and by bodies that MuJoCo lets collide.

    Geoms of one body, of bodies welded together, and of a body and its parent (the world apart) never do, unless a pair
    names them.
    """
    mujoco = require("mujoco", "mujoco")
    body = model.body_weldid[model.geom_bodyid]
    parent = model.body_weldid[model.body_parentid[body]]
    masks = (model.geom_contype[:, None] & model.geom_conaffinity[None]) != 0
    able = (masks | masks.T) & (body[:, None] != body[None])
    if not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        child = (parent[:, None] == body[None]) & (body[None] != 0)
        able &= ~(child | child.T)
    found = able.any(axis=1)
    found[np.unique(np.r_[model.pair_geom1, model.pair_geom2]).astype(int)] = True
    return found


def _of_actuator(model: Any, i: int) -> list[tuple[str, float]]:
    """Gear, and the gains of servos."""
    mujoco = require("mujoco", "mujoco")
    gear, out = float(model.actuator_gear[i, 0]), []
    if gear != 0:
        out.append(("gear", gear))
    fixed = int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    affine = int(model.actuator_biastype[i]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    gain, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
    if fixed and affine and gain > 0:
        if gain == -bias[1]:  # a position servo: force = kp (target - length) - kv velocity
            out += [("kp", gain), ("kv", float(-bias[2]))]
        elif gain == -bias[2] and bias[1] == 0:  # a velocity servo: force = kv (target - velocity)
            out.append(("kv", gain))
    return out


def assign(model: Any, origin: Any, parameters: Mapping[str, ModelParameter], values: Mapping[str, float]) -> None:
    """Write values into a copy of a model (what follows from them, ``mj_setConst`` computes).

    ``model``: written.
    ``origin``: the model as it was read.
    ``parameters``: those of ``origin``.
    """
    bodies: dict[Weight, dict[str, float]] = {}
    for name, value in values.items():
        one = parameters[name]
        i = one.index
        if one.element == "joint":
            if one.quantity == "stiffness":
                model.jnt_stiffness[i] = value
            else:
                getattr(model, f"dof_{one.quantity}")[model.dof_jntid == i] = value
        elif one.weight is not None:
            bodies.setdefault(one.weight, {})[one.quantity] = value
        elif one.element == "geom":
            model.geom_friction[i, _FRICTION.index(one.quantity)] = value
        elif one.quantity == "gear":
            model.actuator_gear[i, 0] = value
        elif one.quantity == "kp":
            model.actuator_gainprm[i, 0], model.actuator_biasprm[i, 1] = value, -value
        else:
            model.actuator_biasprm[i, 2] = -value
            if origin.actuator_gainprm[i, 0] == -origin.actuator_biasprm[i, 2] and origin.actuator_biasprm[i, 1] == 0:
                model.actuator_gainprm[i, 0] = value
    for weight, given in bodies.items():
        weight.write(model, given.get("mass", weight.mass), given.get("load", 0.0))
