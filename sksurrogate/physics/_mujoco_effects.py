"""Which effects are parameters of a MuJoCo model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.physics._mujoco_engine import Engine
from sksurrogate.physics._mujoco_layout import Layout
from sksurrogate.physics._mujoco_params import ModelParameter

#: Parameters of a joint that are laws at its port, driven by its own velocity or position.
_LAWS = {
    "damping": ("linear_loss", "vel"),
    "frictionloss": ("coulomb_friction", "vel"),
    "stiffness": ("linear_loss", "pos"),
}


def law_of(model: Any, layout: Layout, parameter: ModelParameter) -> list[tuple[str, str, str]]:
    """The law at a port that a parameter is, as the key of an effect; none where it is no law of one degree of freedom."""
    if parameter.element != "joint" or parameter.quantity not in _LAWS:
        return []
    first, place = int(model.jnt_dofadr[parameter.index]), int(model.jnt_qposadr[parameter.index])
    if np.sum(model.dof_jntid == parameter.index) != 1:  # a free or a ball joint
        return []
    if parameter.quantity == "stiffness" and model.qpos_spring[place] != 0:  # its spring pulls elsewhere
        return []
    name, driver = _LAWS[parameter.quantity]
    return [(name, layout.ports[first], layout.velocities[first] if driver == "vel" else layout.positions[place])]


def as_parameters(
    engine: Engine, own: Mapping[str, float], effects: Sequence[Any], values: Sequence[Mapping[str, float]]
) -> tuple[dict[str, float], list[int]]:
    """Parameters that say what effects say, and the numbers of the effects that no parameter can say.

    Parameters
    ----------
    engine : Engine
    own : dict of float
        The simulator's parameters.
    effects : sequence of BaseEffect
    values : sequence of dict of float
        Parameters of each effect, magnitude first.

    Returns
    -------
    params : dict of float
        Those that change.
    left : list of int
    """
    now = {name: one.value for name, one in engine.parameters.items()} | dict(own)
    laws = {law: name for name, one in engine.parameters.items() for law in law_of(engine.origin, engine.layout, one)}
    changed: dict[str, float] = {}
    left: list[int] = []
    for i, (effect, given) in enumerate(zip(effects, values)):
        size = next(iter(given.values()), 0.0)
        found = _as_parameter(engine, effect, size, now, laws)
        plain = not getattr(effect, "span", ()) and getattr(effect, "runs", None) is None
        if found is None or not plain:
            left.append(i)
            continue
        now[found[0]] = changed[found[0]] = found[1]
    return changed, left


def _as_parameter(
    engine: Engine, effect: Any, size: float, now: Mapping[str, float], laws: Mapping[Any, str]
) -> tuple[str, float] | None:
    """Name and value of the parameter that says what an effect says."""
    place = str(effect.location)
    if effect.name == "parameter_error" and place in now:
        return place, now[place] * (1.0 + size) if now[place] != 0 else size
    if effect.name == "input_gain" and f"{place}.gear" in now and _is_linear(engine, place):
        return f"{place}.gear", now[f"{place}.gear"] * (1.0 + size)
    name = laws.get(effect.key)
    return None if name is None else (name, now[name] + size)


def _is_linear(engine: Engine, actuator: str) -> bool:
    """Whether the force of an actuator is in proportion to its control."""
    mujoco, model = require("mujoco", "mujoco"), engine.origin
    i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
    if i < 0 or model.actuator_biastype[i] != int(mujoco.mjtBias.mjBIAS_NONE):
        return False
    linear = [getattr(mujoco.mjtDyn, f"mjDYN_{name}") for name in ("NONE", "INTEGRATOR", "FILTER", "FILTEREXACT")]
    limited = model.actuator_ctrllimited[i] or model.actuator_forcelimited[i] or model.actuator_actlimited[i]
    fixed = int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    return fixed and not limited and int(model.actuator_dyntype[i]) in map(int, linear)
