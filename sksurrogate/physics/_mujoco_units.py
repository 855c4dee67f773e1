"""SI units of the numbers of a MuJoCo model, by the kinds of its joints."""

from __future__ import annotations

from typing import Any

from sksurrogate._units import over
from sksurrogate.physics._mujoco_layout import name_of

#: Kind of joint -> units of position, velocity, generalised force.
_KINDS = {"slide": ("m", "m/s", "N"), "hinge": ("rad", "rad/s", "N m")}
#: Numbers of the kinds in ``mjtJoint``; free and ball joints have coordinates of several kinds.
_NUMBERS = {2: "slide", 3: "hinge"}


def joint_units(model: Any) -> dict[str, str]:
    """Units of joints, ports, some parameters and time.

    Free and ball joints have coordinates of several kinds and are left out.
    """
    units = {"time": "s"}
    for j in range(model.njnt):
        kind = _NUMBERS.get(int(model.jnt_type[j]))
        if kind is None:
            continue
        name, (position, velocity, force) = name_of(model, "joint", j), _KINDS[kind]
        units |= {f"{name}.pos": position, f"{name}.vel": velocity, name: force}
        units |= {f"{name}.force": force, f"{name}.frictionloss": force}
        units |= {f"{name}.damping": over(force, velocity), f"{name}.stiffness": over(force, position)}
    for b in range(model.nbody):
        units[f"{name_of(model, 'body', b)}.mass"] = "kg"
    return units
