"""Shapes that an unknown law of one signal may have: simple forms, polynomials, a smooth curve, a memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sksurrogate.gap._curve_shapes import hats
from sksurrogate.gap._unknown import past_of
from sksurrogate.kernels.record import Record

__all__ = ["Form", "Law", "laws", "roughness"]

#: Forms of one parameter, of a signal over its largest value.
SIMPLE = (
    lambda z: np.sign(z) * np.sqrt(np.abs(z)),
    lambda z: z,
    lambda z: z * np.abs(z),
    lambda z: z**2,
    lambda z: z**3,
    lambda z: z**4,
)
#: Degrees of the polynomials.
DEGREES = (2, 3, 4)
#: Knots of a smooth curve.
KNOTS = 10


class Form(NamedTuple):
    """Which functions make up a form, and whether their weights are those of a curve that should be smooth."""

    functions: np.ndarray
    smooth: bool


class Law(NamedTuple):
    """A signal, functions of it (n_functions, n_samples), and the forms that these make up."""

    variable: str
    functions: np.ndarray
    forms: tuple[Form, ...]


def laws(record: Record, signals: np.ndarray, names: Sequence[str]) -> Iterator[Law]:
    """Laws of each signal, and of the signal with its past."""
    past = past_of(record, signals)
    for i, (name, z) in enumerate(zip(names, signals)):
        if np.ptp(z) <= 1e-9 * max(float(np.max(np.abs(z))), 1e-300):
            continue
        yield Law(name, *static(z))
        yield Law(f"{name} and its past", np.concatenate([z[None], past[:, i]]), (Form(np.arange(4), False),))


def static(z: np.ndarray) -> tuple[np.ndarray, tuple[Form, ...]]:
    """Functions of a signal and their forms."""
    simple = np.stack([form(z / np.max(np.abs(z))) for form in SIMPLE])
    powers = ((z - np.mean(z)) / np.ptp(z)) ** np.arange(max(DEGREES) + 1)[:, None]
    curve = hats(z, KNOTS)
    ends = np.cumsum([len(simple), len(powers), len(curve)])
    forms = [Form(np.array([k]), False) for k in range(ends[0])]
    forms += [Form(np.arange(ends[0], ends[0] + degree + 1), False) for degree in DEGREES]
    forms.append(Form(np.arange(ends[1], ends[2]), len(curve) > 2))
    return np.concatenate([simple, powers, curve]), tuple(forms)


def roughness(n: int) -> np.ndarray:
    """Sum of the squared second differences of n weights, as a quadratic form."""
    second = np.diff(np.eye(n), 2, axis=0)
    return second.T @ second
