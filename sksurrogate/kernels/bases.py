"""Basis functions of Lie (2019), sections 2.1 and 2.2: values and derivatives, arrays in and arrays out.

A spline of order 0 is a pulse between two knots, of order 1 a saw tooth, and higher orders follow by recursion. At any x
only ``degree + 1`` splines differ from zero; everything here works on these *local weights*, and a matrix in compressed
rows is filled with them directly. On equidistant knots they are fixed polynomials of the place within the interval, so
that one small matrix product gives them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from math import factorial, prod
from typing import Any

import numpy as np
import scipy.sparse as sp

#: Rows that are worked on at a time: their weights stay in the cache.
BASIS_ROWS = 8192


@lru_cache(maxsize=64)
def cardinal_coefficients(degree: int, derivative: int = 0) -> np.ndarray:
    """Polynomials of the splines on equidistant knots of distance 1.

    With s in [0, 1) the place within the interval, the r-th of the ``degree + 1`` splines that live there is
    ``sum_k C[k, r] s**k``. The recursion (de Boor 1978, chapter IX) is done in whole fractions, so that C is exact to rounding.

    Returns (degree + 1, degree + 1).

    >>> cardinal_coefficients(1)  # 1 - s and s
    array([[ 1.,  0.],
           [-1.,  1.]])
    """
    table = [[Fraction(1)]]
    for k in range(1, degree + 1):
        higher = [[Fraction(0)] * (k + 1) for _ in range(k + 1)]
        for r, polynomial in enumerate(table):
            for power, c in enumerate(polynomial):
                higher[r][power] += c * Fraction(r + 1, k)
                higher[r][power + 1] -= c / k
                higher[r + 1][power] += c * Fraction(k - 1 - r, k)
                higher[r + 1][power + 1] += c / k
        table = higher
    out = np.zeros((degree + 1, degree + 1))
    for r, polynomial in enumerate(table):
        for power in range(derivative, degree + 1):
            falling = Fraction(factorial(power), factorial(power - derivative))
            out[power - derivative, r] = float(polynomial[power] * falling)
    out.setflags(write=False)
    return out


def spline_weights(
    x: np.ndarray, interval: np.ndarray, knots: np.ndarray, degree: int, derivative: int = 0
) -> np.ndarray:
    """Local weights on any knots by the recursion of Cox and de Boor.

    ``x`` (n_samples,): may lie outside its interval: the polynomial of the interval is continued.
    ``interval`` int (n_samples,): index j with ``knots[j] < knots[j + 1]``: the interval whose polynomials are meant.
    ``knots``: whole knot sequence, in rising order.
    Returns (n_samples, degree + 1): column r belongs to spline ``interval - degree + r``.
    """
    weights = np.zeros((degree + 1, len(x)))
    if derivative > degree:
        return weights.T
    weights[0] = 1.0
    for k in range(1, degree + 1):
        below = weights[:k].copy()
        weights[: k + 1] = 0.0
        for r in range(k):
            left, right = knots[interval + 1 + r - k], knots[interval + 1 + r]
            share = below[r] / (right - left)
            if k > degree - derivative:  # B'_k = k (B_{k-1, left} / width - B_{k-1, right} / width)
                weights[r] -= k * share
                weights[r + 1] += k * share
            else:
                weights[r] += (right - x) * share
                weights[r + 1] += (x - left) * share
    return weights.T


@dataclass(frozen=True, eq=False)
class Spline:
    """The splines of one input."""

    #: (n_breaks + 2 * degree,): whole knot sequence; the splines sum to one between ``low`` and ``high``
    knots: np.ndarray
    degree: int
    #: {"constant", "linear", "continue", "periodic", "zero", "error"}: what holds outside; "error" is up to the caller
    #: and counts as "constant" here
    extrapolation: str = "constant"
    uniform: bool = False  #: Whether the knots are equidistant (the fast path)

    @property
    def low(self) -> float:
        """Left end of the range."""
        return float(self.knots[self.degree])

    @property
    def high(self) -> float:
        """Right end of the range."""
        return float(self.knots[len(self.knots) - self.degree - 1])

    @property
    def n_intervals(self) -> int:
        """Intervals between ``low`` and ``high``."""
        return len(self.knots) - 2 * self.degree - 1

    @property
    def n_splines(self) -> int:
        """Number of basis functions."""
        return self.n_intervals + (0 if self.extrapolation == "periodic" else self.degree)

    def local(self, x: np.ndarray, derivative: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """First spline that lives at x, int (n_samples,), and the weights (n_samples, degree + 1)."""
        span = self.high - self.low
        inside = self.low + np.mod(x - self.low, span) if self.extrapolation == "periodic" else x
        inside = np.clip(inside, self.low, self.high)
        first, weights = self.piece(inside, inside, derivative)
        outside = (x < self.low) | (x > self.high)
        if self.extrapolation == "periodic" or not outside.any():
            return first, weights
        if self.extrapolation == "zero" or (derivative > 0 and self.extrapolation in ("constant", "error")):
            weights[outside] = 0.0
        elif self.extrapolation == "continue":
            weights[outside] = self.piece(inside[outside], x[outside], derivative)[1]
        elif self.extrapolation == "linear":
            slope = self.piece(inside[outside], inside[outside], 1)[1]
            if derivative:
                weights[outside] = slope if derivative == 1 else 0.0
            else:
                weights[outside] += (x - inside)[outside, None] * slope
        return first, weights

    def piece(self, place: np.ndarray, x: np.ndarray, derivative: int) -> tuple[np.ndarray, np.ndarray]:
        """First spline and weights at x by the polynomials of the interval in which ``place`` lies, continued."""
        first = self.interval(place)
        if not self.uniform:
            return first, spline_weights(x, first + self.degree, self.knots, self.degree, derivative)
        pitch = (self.high - self.low) / self.n_intervals
        s = (x - self.low) / pitch - first
        powers = np.ones((self.degree + 1, len(x)))
        for k in range(1, self.degree + 1):
            np.multiply(powers[k - 1], s, out=powers[k])
        return first, (cardinal_coefficients(self.degree, derivative).T / pitch**derivative @ powers).T

    def interval(self, place: np.ndarray) -> np.ndarray:
        """Interval between ``low`` and ``high`` in which each place lies or which is next to it, int (n_samples,)."""
        last = self.n_intervals - 1
        if self.uniform:
            return np.clip((place - self.low) / ((self.high - self.low) / (last + 1)), 0, last).astype(np.int32)
        breaks = self.knots[self.degree : self.degree + last + 2]
        return np.clip(np.searchsorted(breaks, place, side="right") - 1, 0, last).astype(np.int32)


def spline_on(breaks: np.ndarray, degree: int, extrapolation: str = "constant") -> Spline:
    """Splines on given break points.

    Beyond the ends the knots go on at the distance of the last two (periodic: as they do at the other end).

    ``breaks`` (n_breaks,): strictly rising, at least two.
    Returns Spline: with ``n_breaks - 1 + degree`` splines, or ``n_breaks - 1`` periodic ones.

    >>> spline_on(np.array([0.0, 1.0, 2.0]), degree=3).n_splines
    5
    """
    widths = np.diff(breaks)
    if extrapolation == "periodic":
        cycle = np.resize(widths, degree + len(widths))  # wide enough where degree exceeds the number of intervals
        left = breaks[0] - np.cumsum(np.resize(widths[::-1], degree))[::-1]
        right = breaks[-1] + np.cumsum(cycle[:degree])
    else:
        left = breaks[0] - widths[0] * np.arange(degree, 0, -1)
        right = breaks[-1] + widths[-1] * np.arange(1, degree + 1)
    uniform = bool(np.allclose(widths, widths.mean(), rtol=1e-9, atol=0.0))
    return Spline(np.r_[left, breaks, right].astype(float), degree, extrapolation, uniform)


def spline_at_data(x: np.ndarray, degree: int, extrapolation: str = "constant") -> Spline:
    """One spline for each distinct data point, centred there: least squares with them interpolates (section 2.2, Figure 1).

    Order 0 has its knots half-way between the data, order 1 at the data. Higher orders have them alternately so, without
    the ones next to the ends ("not a knot"): the splines still sum to one up to the ends.

    ``x`` (n_samples,).
    ``degree``: lowered where there are fewer than ``degree + 1`` distinct points.
    Returns Spline: with as many splines as distinct points.

    >>> spline_at_data(np.array([0.0, 1.0, 2.0]), degree=0).knots
    array([-0.5,  0.5,  1.5,  2.5])
    """
    sites = np.unique(x).astype(float)
    n = len(sites)
    k = min(degree, n - 1)
    middles = (sites[1:] + sites[:-1]) / 2
    if k == 0:
        first, last = (sites[1] - sites[0], sites[-1] - sites[-2]) if n > 1 else (1.0, 1.0)
        knots = np.r_[sites[0] - first / 2, middles, sites[-1] + last / 2]
        return Spline(
            knots, 0, extrapolation, bool(np.allclose(np.diff(knots), np.diff(knots).mean(), rtol=1e-9, atol=0))
        )
    inner = sites[(k + 1) // 2 : n - (k + 1) // 2] if k % 2 else middles[k // 2 : n - 1 - k // 2]
    return Spline(np.r_[[sites[0]] * (k + 1), inner, [sites[-1]] * (k + 1)], k, extrapolation)


def spline_csr(
    X: np.ndarray, splines: Sequence[Spline], product: bool = False, derivatives: Sequence[int] | None = None
) -> sp.csr_array:
    """Spline features in compressed rows, written without any intermediate matrix.

    ``X`` (n_samples, n_inputs).
    ``splines``: one for each input.
    ``product``: False: the splines of the inputs side by side. True: all their products (last input fastest, as
        ``numpy.kron``).
    ``derivatives``: order of the derivative for each input.

    >>> saw = spline_on(np.array([0.0, 1.0, 2.0]), degree=1)
    >>> spline_csr(np.array([[0.25], [2.0]]), [saw]).toarray()
    array([[0.75, 0.25, 0.  ],
           [0.  , 0.  , 1.  ]])
    """
    n_samples = len(X)
    orders = [0] * len(splines) if derivatives is None else list(derivatives)
    sizes = [spline.n_splines for spline in splines]
    widths = [spline.degree + 1 for spline in splines]
    n_features, width = (prod(sizes), prod(widths)) if product else (sum(sizes), sum(widths))
    index = np.int32 if max(n_samples * width, n_features) < np.iinfo(np.int32).max else np.int64
    data = np.empty((n_samples, width))
    columns = np.empty((n_samples, width), dtype=index)
    blocks: list[Any] = [slice(a, a + BASIS_ROWS) for a in range(0, n_samples, BASIS_ROWS)]
    alike = all(s.uniform and s.degree == splines[0].degree and s.extrapolation != "periodic" for s in splines)
    if alike and not product and not any(orders):
        _fill_uniform(X, splines, data, columns)
        special = [
            (x < s.low) | (x > s.high) for x, s in zip(X.T, splines) if s.extrapolation not in ("constant", "error")
        ]
        outside = np.flatnonzero(np.any(special, axis=0))
        blocks = [outside[a : a + BASIS_ROWS] for a in range(0, len(outside), BASIS_ROWS)]
    for rows in blocks:
        data[rows], columns[rows] = _fill(X[rows], splines, orders, product)
    starts = np.arange(0, n_samples * width + 1, width, dtype=index)
    out = sp.csr_array((data.reshape(-1), columns.reshape(-1), starts), shape=(n_samples, n_features), copy=False)
    if any(spline.extrapolation == "periodic" for spline in splines):
        out.sum_duplicates()
    return out


def _fill_uniform(X: np.ndarray, splines: Sequence[Spline], data: np.ndarray, columns: np.ndarray) -> None:
    """Write all rows, block by block: powers of the place within the interval times a constant matrix."""
    n_samples, n_inputs = X.shape
    width = splines[0].degree + 1
    low = np.array([spline.low for spline in splines])
    n = np.array([spline.n_intervals for spline in splines])
    scale = n / (np.array([spline.high for spline in splines]) - low)
    last = n - 1
    offsets = np.r_[0, np.cumsum([spline.n_splines for spline in splines])[:-1]].astype(columns.dtype)
    coefficients = cardinal_coefficients(width - 1)
    powers = np.ones((min(BASIS_ROWS, n_samples), n_inputs, width))
    for a in range(0, n_samples, BASIS_ROWS):
        s = X[a : a + BASIS_ROWS] - low
        rows = len(s)
        s *= scale
        np.clip(s, 0, n, out=s)
        first = np.minimum(s, last).astype(columns.dtype)
        s -= first
        first += offsets
        block, place = powers[:rows], columns[a : a + rows].reshape(rows, n_inputs, width)
        for k in range(width):
            np.add(first, k, out=place[..., k])
            if k:
                np.multiply(block[..., k - 1], s, out=block[..., k])
        np.matmul(block.reshape(-1, width), coefficients, out=data[a : a + rows].reshape(-1, width))


def _fill(
    X: np.ndarray, splines: Sequence[Spline], orders: Sequence[int], product: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Values and columns of a block of rows for any splines, side by side or multiplied."""
    values: list[np.ndarray] = []
    places: list[np.ndarray] = []
    offset = 0
    for x, spline, order in zip(X.T, splines, orders):
        first, weights = spline.local(x, order)
        place = first[:, None] + np.arange(spline.degree + 1)
        if spline.extrapolation == "periodic":
            place %= spline.n_splines
        if product and values:
            weights = (values[0][:, :, None] * weights[:, None, :]).reshape(len(X), -1)
            place = (places[0][:, :, None] * spline.n_splines + place[:, None, :]).reshape(len(X), -1)
            values, places = [], []
        values.append(weights)
        places.append(place + offset)
        offset += 0 if product else spline.n_splines
    return np.hstack(values), np.hstack(places)


def steps(x: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Unit steps H(x - threshold), 1 from the threshold on (Remark 1): (n_samples, n_thresholds).

    >>> steps(np.array([0.0, 1.0]), np.array([0.5, 1.0]))
    array([[0., 0.],
           [1., 1.]])
    """
    return (x[:, None] >= thresholds).astype(float)


def fourier(x: np.ndarray, wavelengths: np.ndarray, constant: bool = True, derivative: int = 0) -> np.ndarray:
    """1, sin(2 pi x / w_1), cos(2 pi x / w_1), sin(2 pi x / w_2), ... (section 2.1, iii) or their derivatives.

    Returns (n_samples, constant + 2 * n_wavelengths).
    """
    rate = 2 * np.pi / wavelengths
    # d/dx turns the phase by a quarter of the wave and multiplies by the rate
    turn = rate * x[:, None] + derivative * np.pi / 2
    out = np.empty((len(x), int(constant) + 2 * len(wavelengths)))
    if constant:
        out[:, 0] = 0.0 if derivative else 1.0
    out[:, int(constant) :: 2] = np.sin(turn) * rate**derivative
    out[:, int(constant) + 1 :: 2] = np.cos(turn) * rate**derivative
    return out


def gaussians(x: np.ndarray, centers: np.ndarray, width: float | np.ndarray, derivative: int = 0) -> np.ndarray:
    """exp(-(x - c)^2 / (2 width^2)) for each centre, or the first derivative: (n_samples, n_centers)."""
    z = (x[:, None] - centers) / width
    values = np.exp(-0.5 * z * z)
    return values if derivative == 0 else -z / width * values


def radial(X: np.ndarray, centers: np.ndarray, width: float) -> np.ndarray:
    """exp(-|x - c|^2 / (2 width^2)) for centres (n_centers, n_inputs): (n_samples, n_centers)."""
    squares = sum((x[:, None] - c) ** 2 for x, c in zip(X.T, centers.T))
    return np.exp(squares / (-2 * width**2))


def tensor(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """All products of one column of each block, row by row (the last block fastest, as ``numpy.kron``).

    >>> tensor([np.array([[1.0, 2.0]]), np.array([[3.0, 5.0]])])
    array([[ 3.,  5.,  6., 10.]])
    """
    out = blocks[0]
    for block in blocks[1:]:
        out = (out[:, :, None] * block[:, None, :]).reshape(len(out), -1)
    return out
