"""Dry friction at joints as MuJoCo has it: the force that stops a joint, if a little softly, and never more than its largest.

With the acceleration ``a`` the force is ``-(a + k v) / R``, within ``+- f``: at rest it holds, beyond ``f`` the joint slides. Which joints
slide is found by Newton's method: a guess is solved, and what then slides is the next guess.

Todorov, *Convex and analytically-invertible dynamics with contacts and constraints*, ICRA (2014).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sksurrogate.physics._components import Component, is_number, solved, with_diagonal

#: Guesses, after which a point is left open.
MOST_GUESSES = 20


class DryFriction(NamedTuple):
    """Of one joint."""

    largest: Component  #: f
    softness: Component  #: R
    stopping: float  #: k


def friction_of(
    joints: Sequence[DryFriction], M: list[list[Component]], torque: Sequence[Component], v: Sequence[Component]
) -> list[Component]:
    """Forces of friction of all joints with the inertia M (lower triangle) under other torques, at speeds v; nan where none is found.

    >>> rest, torque = np.zeros(3), np.array([0.5, 2.0, -2.0])
    >>> friction_of([DryFriction(1.0, 1e-9, 100.0)], [[2.0]], [torque], [rest])[0].round(6)
    array([-0.5, -1. ,  1. ])
    """
    rubbing = [j for j, joint in enumerate(joints) if not is_number(joint.largest, 0.0)]
    forces: list[Component] = [0.0] * len(joints)
    if not rubbing:
        return forces

    def ways(a: Sequence[Component]) -> np.ndarray:
        """Which joints slide (n_rubbing, ...): the sign of what their acceleration is beyond that which stops them; 0 of one that is held."""
        beyond = [(joints[j], a[j] + joints[j].stopping * v[j]) for j in rubbing]
        found = [np.sign(x) * (np.abs(x) > joint.softness * joint.largest) for joint, x in beyond]
        return np.stack(np.broadcast_arrays(*found))

    def solved_with(slides: np.ndarray) -> list[Component]:
        """Accelerations where these joints slide."""
        stiffness: list[Component] = [0.0] * len(joints)
        given = list(torque)
        for j, way in zip(rubbing, slides):
            joint = joints[j]
            stiffness[j] = np.where(way == 0.0, 1.0 / joint.softness, 0.0)
            given[j] = given[j] - joint.largest * way - stiffness[j] * joint.stopping * v[j]
        return solved(with_diagonal(M, stiffness), given)

    slides = ways(solved(M, list(torque)))
    for _ in range(MOST_GUESSES):
        a = solved_with(slides)
        after = ways(a)
        after = np.where(after * slides < 0.0, 0.0, after)  # one that would turn back within a guess is held
        settled = np.all(after == slides, axis=0)
        if settled.all():
            break
        slides = after
    for j, way in zip(rubbing, slides):
        held = -(a[j] + joints[j].stopping * v[j]) / joints[j].softness
        forces[j] = np.where(settled, np.where(way == 0.0, held, -joints[j].largest * way), np.nan)
    return forces
