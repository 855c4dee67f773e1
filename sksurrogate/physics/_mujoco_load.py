"""A load at the tip of a link: a mass that a robot carries and its model does not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import require

#: MuJoCo's ``mjSAMEFRAME_NONE``: an element with a frame of its own.
NO_FRAME = 0


def tip_of(model: Any, body: int) -> np.ndarray | None:
    """Where a body that carries no other may hold a load, in its frame (3,); None where it cannot be said.

    The point of its geoms that is farthest from its origin: ends of their long axes, half of their thickness inside.
    """
    geoms = np.flatnonzero(model.geom_bodyid == body)
    simple = model.body_simple[body] != 0  # MuJoCo counts on a centre of mass on its axis
    if simple or not len(geoms) or np.any(model.body_parentid[1:] == body):
        return None
    ends = [end for geom in geoms.tolist() for end in _ends(model, geom)]
    far = ends[int(np.argmax([np.sum(end**2) for end in ends]))]
    return None if np.allclose(far, 0.0) else far


def _ends(model: Any, geom: int) -> list[np.ndarray]:
    """Both ends of the long axis of a geom, in the frame of its body."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    reach = np.where(np.arange(3) == np.argmax(half), np.max(half) - np.min(half), 0.0)
    turn = matrix_of(model.geom_quat[geom])
    return [model.geom_pos[geom] + turn @ (centre + sign * reach) for sign in (1.0, -1.0)]


def loaded(
    mass: float, centre: np.ndarray, inertia: np.ndarray, load: float, tip: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre of mass (3,) and inertia about it (3, 3) of a body with a point mass ``load`` at its tip.

    ``centre`` and ``inertia``: those of the body alone (Huygens and Steiner).

    >>> centre, inertia = loaded(1.0, np.zeros(3), np.zeros((3, 3)), 1.0, np.array([2.0, 0.0, 0.0]))
    >>> centre.tolist(), np.diag(inertia).tolist()
    ([1.0, 0.0, 0.0], [0.0, 2.0, 2.0])
    """
    both = (mass * centre + load * tip) / (mass + load)
    return both, inertia + mass * _of_point(centre - both) + load * _of_point(tip - both)


def _of_point(r: np.ndarray) -> np.ndarray:
    """Inertia of a unit point mass at r."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))


@dataclass(frozen=True, eq=False)
class Weight:
    """What a mass and a load change in a model, looked up once: a fit writes them for every point."""

    body: int
    mass: float
    centre: np.ndarray
    turn: np.ndarray  #: Quaternion of the axes of the inertia
    inertia: np.ndarray  #: About these axes, (3,)
    tip: np.ndarray | None  #: Where the load is
    #: Whether MuJoCo places the body, its geoms and sites by the frame of its inertia, which a load moves: (array, rows, values of
    #: the model)
    framed: tuple[tuple[str, np.ndarray, np.ndarray], ...]

    @classmethod
    def of(cls, model: Any, body: int) -> Weight:
        """Of a model as it was read."""
        same = require("mujoco", "mujoco").mjtSameFrame
        by_inertia = [int(same.mjSAMEFRAME_INERTIA), int(same.mjSAMEFRAME_INERTIAROT)]
        framed = [("body_sameframe", np.array([body]))]
        for kind in ("geom", "site"):
            own = getattr(model, f"{kind}_bodyid") == body
            framed.append(
                (f"{kind}_sameframe", np.flatnonzero(own & np.isin(getattr(model, f"{kind}_sameframe"), by_inertia)))
            )
        frames = tuple((name, rows, getattr(model, name)[rows].copy()) for name, rows in framed if len(rows))
        centre, turn = np.array(model.body_ipos[body]), np.array(model.body_iquat[body])
        inertia, tip = np.array(model.body_inertia[body]), tip_of(model, body)
        return cls(body, float(model.body_mass[body]), centre, turn, inertia, tip, frames)

    def write(self, model: Any, mass: float, load: float) -> None:
        """Give the body of a model a mass and a load; another mass is the same shape of another density, its inertia goes with it."""
        centre, turn, inertia = self.centre, self.turn, self.inertia * (mass / self.mass)
        if load and self.tip is not None:
            axes = matrix_of(turn)
            centre, whole = loaded(mass, centre, axes @ np.diag(inertia) @ axes.T, load, self.tip)
            inertia, axes = np.linalg.eigh(whole)
            turn = _quaternion(axes * np.linalg.det(axes))
        body = self.body
        model.body_mass[body] = mass + load
        model.body_ipos[body], model.body_iquat[body], model.body_inertia[body] = centre, turn, inertia
        for name, rows, given in self.framed:
            getattr(model, name)[rows] = NO_FRAME if load else given


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix of a unit quaternion."""
    out = np.empty(9)
    require("mujoco", "mujoco").mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    """Unit quaternion of a rotation matrix."""
    out = np.empty(4)
    require("mujoco", "mujoco").mju_mat2Quat(out, np.ascontiguousarray(matrix).ravel())
    return out
