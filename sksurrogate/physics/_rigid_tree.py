"""Equations of motion of a tree of hinges and slides: inertia by composite bodies, velocities and weight by Newton and Euler.

Featherstone, *Rigid Body Dynamics Algorithms*, Springer (2008), chapters 5 and 6. Vectors of a link stand in its own frame, whose origin
lies on the axis of its joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from sksurrogate.physics._components import (
    ZERO,
    Component,
    Matrix,
    Vector,
    added,
    cross,
    diagonal,
    dot,
    outer,
    plus,
    product,
    rotation,
    scaled,
    summed,
    times,
    transposed,
    turned,
    turned_back,
)


class Inertia(NamedTuple):
    """Of a link about the origin of its frame; linear in every mass."""

    mass: Component
    moment: Vector  #: Mass times the centre of mass
    second: Matrix

    def seen_from(self, R: Matrix, r: Vector) -> Inertia:
        """In another frame, where the link is turned by R and its origin lies at r (Huygens and Steiner)."""
        h = turned(R, self.moment)
        square, mixed = dot(r, r), dot(r, h)
        second = summed(
            product(product(R, self.second), transposed(R)),
            diagonal(plus(mixed, mixed, times(self.mass, square))),
            outer(scaled(-1.0, r), added(h, scaled(self.mass, r))),
            outer(scaled(-1.0, h), r),
        )
        return Inertia(self.mass, added(h, scaled(self.mass, r)), second)

    def times(self, factor: Component) -> Inertia:
        """Of a body of another density."""
        first, second, third = (scaled(factor, row) for row in self.second)
        return Inertia(times(factor, self.mass), scaled(factor, self.moment), (first, second, third))

    def with_body(self, other: Inertia) -> Inertia:
        """Both together."""
        return Inertia(plus(self.mass, other.mass), added(self.moment, other.moment), summed(self.second, other.second))


@dataclass(frozen=True)
class Link:
    """A body that a joint moves.

    ``parent``: number of the link that carries it, a smaller one; -1 for the ground.
    ``hinge``: turns about the axis, or slides along it.
    ``axis``: a unit vector.
    ``turn``, ``origin``: of its frame in that of the parent, at a position of 0.
    """

    parent: int
    hinge: bool
    axis: Vector
    turn: Matrix
    origin: Vector

    def place(self, q: Component) -> tuple[Matrix, Vector]:
        """Its frame in that of the parent: what turns vectors of the link, and its origin."""
        if self.hinge:
            return product(self.turn, rotation(self.axis, q)), self.origin
        return self.turn, added(self.origin, turned(self.turn, scaled(q, self.axis)))

    def along(self, force: Vector, torque: Vector) -> Component:
        """What of a force and a torque the joint feels."""
        return dot(self.axis, torque if self.hinge else force)


def mass_matrix(
    links: Sequence[Link], inertia: Sequence[Inertia], places: Sequence[tuple[Matrix, Vector]]
) -> list[list[Component]]:
    """Lower triangle of the inertia of all joints."""
    whole = list(inertia)
    for k in reversed(range(len(links))):
        if links[k].parent >= 0:
            whole[links[k].parent] = whole[links[k].parent].with_body(whole[k].seen_from(*places[k]))
    rows: list[list[Component]] = []
    for k, link in enumerate(links):
        m, h, second = whole[k]
        force = cross(link.axis, h) if link.hinge else scaled(m, link.axis)
        torque = turned(second, link.axis) if link.hinge else cross(h, link.axis)
        row: list[Component] = [0.0] * k + [link.along(force, torque)]
        j = k
        while links[j].parent >= 0:
            R, r = places[j]
            force, torque, j = *_carried(force, torque, R, r), links[j].parent
            row[j] = links[j].along(force, torque)
        rows.append(row)
    return rows


def bias(
    links: Sequence[Link],
    inertia: Sequence[Inertia],
    places: Sequence[tuple[Matrix, Vector]],
    v: Sequence[Component],
    gravity: Vector,
) -> list[Component]:
    """Forces at the joints that keep all velocities as they are: centrifugal, of Coriolis, and weight."""
    turning, spinning, moving = list[Vector](), list[Vector](), list[Vector]()
    forces, torques = list[Vector](), list[Vector]()
    for link, (m, h, second), (R, r), speed in zip(links, inertia, places, v):
        k = link.parent
        w, alpha, a = (turning[k], spinning[k], moving[k]) if k >= 0 else (ZERO, ZERO, scaled(-1.0, gravity))
        a = turned_back(R, added(a, cross(alpha, r), cross(w, cross(w, r))))
        w, alpha, own = turned_back(R, w), turned_back(R, alpha), scaled(speed, link.axis)
        if link.hinge:
            alpha, w = added(alpha, cross(w, own)), added(w, own)
        else:
            a = added(a, scaled(2.0, cross(w, own)))
        turning.append(w)
        spinning.append(alpha)
        moving.append(a)
        forces.append(added(scaled(m, a), cross(alpha, h), cross(w, cross(w, h))))
        torques.append(added(turned(second, alpha), cross(w, turned(second, w)), cross(h, a)))
    out: list[Component] = [0.0] * len(links)
    for k in reversed(range(len(links))):
        out[k], j = links[k].along(forces[k], torques[k]), links[k].parent
        if j >= 0:
            force, torque = _carried(forces[k], torques[k], *places[k])
            forces[j], torques[j] = added(forces[j], force), added(torques[j], torque)
    return out


def _carried(force: Vector, torque: Vector, R: Matrix, r: Vector) -> tuple[Vector, Vector]:
    """A force and a torque at the origin of a link, as its parent feels them."""
    force = turned(R, force)
    return force, added(turned(R, torque), cross(r, force))
