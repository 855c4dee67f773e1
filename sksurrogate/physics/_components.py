"""Vectors and matrices by their components, each a number or an array of points: what is zero at all points costs nothing."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any, TypeAlias

import numpy as np

#: A number, or an array (n_points,).
Component: TypeAlias = Any
Vector: TypeAlias = tuple[Component, Component, Component]
#: Three rows.
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

ZERO: Vector = (0.0, 0.0, 0.0)


def is_number(a: Component, value: float) -> bool:
    """Whether a component is this number at all points; arrays are not looked into."""
    return isinstance(a, float) and a == value


def plus(*terms: Component) -> Component:
    """Sum.

    >>> plus(0.0, 2.0, np.array([1.0, 3.0]))
    array([3., 5.])
    """
    some = [term for term in terms if not is_number(term, 0.0)]
    return reduce(add, some) if some else 0.0


def minus(a: Component, b: Component) -> Component:
    """Difference."""
    return a if is_number(b, 0.0) else (-b if is_number(a, 0.0) else a - b)


def times(a: Component, b: Component) -> Component:
    """Product.

    >>> times(0.0, np.ones(1000))
    0.0
    """
    if is_number(a, 0.0) or is_number(b, 0.0):
        return 0.0
    if is_number(a, 1.0):
        return b
    return a if is_number(b, 1.0) else a * b


def dot(a: Vector, b: Vector) -> Component:
    """Scalar product."""
    return plus(*map(times, a, b))


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product.

    >>> cross((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    (0.0, 0.0, 1.0)
    """
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def added(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    x, y, z = map(plus, *vectors)
    return x, y, z


def scaled(factor: Component, a: Vector) -> Vector:
    """A multiple of a vector."""
    return times(factor, a[0]), times(factor, a[1]), times(factor, a[2])


def turned(R: Matrix, a: Vector) -> Vector:
    """``R a``."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


def turned_back(R: Matrix, a: Vector) -> Vector:
    """``R' a``."""
    return turned(transposed(R), a)


def transposed(R: Matrix) -> Matrix:
    """``R'``."""
    x, y, z = zip(*R)
    return x, y, z


def product(A: Matrix, B: Matrix) -> Matrix:
    """``A B``."""
    rows = transposed(B)
    return turned(rows, A[0]), turned(rows, A[1]), turned(rows, A[2])


def outer(a: Vector, b: Vector) -> Matrix:
    """``a b'``."""
    return scaled(a[0], b), scaled(a[1], b), scaled(a[2], b)


def summed(*matrices: Matrix) -> Matrix:
    """Sum of matrices."""
    x, y, z = (added(*rows) for rows in zip(*matrices))
    return x, y, z


def diagonal(a: Component) -> Matrix:
    """``a`` times the unit matrix."""
    return (a, 0.0, 0.0), (0.0, a, 0.0), (0.0, 0.0, a)


def rotation(axis: Vector, angle: Component) -> Matrix:
    """By an angle about a unit axis (Rodrigues).

    >>> [[round(float(a), 3) for a in row] for row in rotation((0.0, 0.0, 1.0), np.pi / 6)]
    [[0.866, -0.5, 0.0], [0.5, 0.866, 0.0], [0.0, 0.0, 1.0]]
    """
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    sx, sy, sz = scaled(s, axis)
    xy, xz, yz = times(x * y, 1.0 - c), times(x * z, 1.0 - c), times(y * z, 1.0 - c)
    xx, yy, zz = (1.0 if abs(a) == 1.0 else plus(a * a, times(1.0 - a * a, c)) for a in axis)
    return (
        (xx, minus(xy, sz), plus(xz, sy)),
        (plus(xy, sz), yy, minus(yz, sx)),
        (minus(xz, sy), plus(yz, sx), zz),
    )


def with_diagonal(A: list[list[Component]], more: list[Component]) -> list[list[Component]]:
    """A symmetric matrix, its lower triangle given, with something added to its diagonal.

    >>> with_diagonal([[4.0], [2.0, 3.0]], [1.0, 0.0])
    [[5.0], [2.0, 3.0]]
    """
    return [[*row[:k], plus(row[k], extra)] for k, (row, extra) in enumerate(zip(A, more))]


def solved(A: list[list[Component]], b: list[Component]) -> list[Component]:
    """``x`` of ``A x = b`` with a symmetric positive definite A, its lower triangle given (``L D L'``).

    >>> solved([[4.0], [2.0, 3.0]], [2.0, 5.0])
    [-0.5, 2.0]
    """
    n = len(b)
    L: list[list[Component]] = [[0.0] * n for _ in range(n)]
    D, x = list[Component](), list(b)
    for j in range(n):
        D.append(minus(A[j][j], plus(*(times(times(L[j][k], L[j][k]), D[k]) for k in range(j)))))
        for i in range(j + 1, n):
            rest = minus(A[i][j], plus(*(times(times(L[i][k], L[j][k]), D[k]) for k in range(j))))
            L[i][j] = 0.0 if is_number(rest, 0.0) else rest / D[j]
            x[i] = minus(x[i], times(L[i][j], x[j]))
    x = [a / d for a, d in zip(x, D)]
    for i in reversed(range(n)):
        x[i] = minus(x[i], plus(*(times(L[k][i], x[k]) for k in range(i + 1, n))))
    return x
