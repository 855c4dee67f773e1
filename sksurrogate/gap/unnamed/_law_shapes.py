"""Shapes that an unknown law may have: of one signal simple forms, polynomials, a smooth curve, a memory; of two a smooth surface."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sksurrogate.effects._formula import SHAPES
from sksurrogate.gap.fit._pushes import at_end
from sksurrogate.kernels.banded import first_order_scan
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.signals import hold, play, rate_limit

#: Forms of one parameter, of a signal over its largest value: shapes of formulae. The exponent of the power among them: a root.
SIMPLE, ROOT = ("sign", "power", "size", "v", "drag", "square", "cube", "fourth"), 0.5
#: Shares of the samples below the kinks of a signal.
HINGES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
#: Degrees of the polynomials.
POLYNOMIAL_DEGREES = (2, 3, 4)
#: Knots of a smooth curve, and of a smooth surface along each of its signals.
KNOTS_OF_LAW, KNOTS_OF_SURFACE = 10, 6
#: What the name of a signal with its past ends with.
AND_ITS_PAST = " and its past"
#: Samples back of the values that a linear filter weighs.
LAGS_OF_PAST = (1, 2, 4, 8, 16)
#: Half widths of plays, of the range of a signal; samples in which what follows it at a limited rate crosses that range.
PLAYS, SLEWS = (0.02, 0.05, 0.15, 0.4), 2.0 ** np.arange(1, 11)
#: Knots of a piecewise linear curve that may be a staircase: of an input in its place, of the time.
FINE_KNOTS = 40
#: Runs from which on what they share at one time since their starts is a law, and not the disturbance of one of them.
RUNS_THAT_SHARE = 3


def hats(z: np.ndarray, n_knots: int) -> np.ndarray:
    """Piecewise linear functions of a signal that add up to one, (n_knots, n_samples); one where it stands still."""
    knots = np.unique(np.quantile(z, np.linspace(0.0, 1.0, n_knots)))
    if not varies(z):
        knots = knots[:1]
    return hats_at(z, knots)


def hats_at(z: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Hat functions on knots (n_knots, n_samples), constant beyond the ends."""
    return np.stack([np.interp(z, knots, hat) for hat in np.eye(len(knots))])


class Form(NamedTuple):
    """Which functions make up a form, and how rough their weights are, a quadratic form (None: as rough as they may be)."""

    functions: np.ndarray
    rough: np.ndarray | None = None


class SignalForms(NamedTuple):
    """A signal (or two, "a*b"), functions of it (n_functions, n_samples), and the forms that these make up.

    What is ``shown`` of the functions at the samples stands beside them where they are means over each.
    """

    variable: str
    functions: np.ndarray
    forms: tuple[Form, ...]
    shown: np.ndarray | None = None

    @property
    def signals(self) -> list[str]:
        """Names of its signals."""
        return self.variable.removesuffix(AND_ITS_PAST).split("*")


def laws(
    record: Record, signals: np.ndarray, names: Sequence[str], given: Container[str] = ()
) -> Iterator[SignalForms]:
    """Laws of each signal, and of the signal with its past; filters and limited rates of signals that are ``given``.

    Inputs are, and readings for their sensor. The last samples of a measured state tell any force that has moved it: a
    filter of them is a disturbance, no law.
    """
    past = past_of(record, signals)
    for i, (name, z) in enumerate(zip(names, signals)):
        if not varies(z):
            continue
        yield SignalForms(name, *static(z))
        plays, slews, at_samples = followers(record, z)
        memories = shown = [z[None], past[:, i], plays]
        if name in given:
            lags = np.stack([z[record.back(k)] for k in LAGS_OF_PAST])
            memories, shown = ([*memories, lags, *pairs(rates)] for rates in (slews, at_samples))
        functions, (own, *parts) = stacked(memories)
        forms = tuple(Form(np.r_[own, part]) for part in parts)
        yield SignalForms(name + AND_ITS_PAST, functions, forms, np.concatenate(shown))


def past_of(record: Record, signals: np.ndarray) -> np.ndarray:
    """Direction and moving averages over 5 and 25 samples of signals, (3, n_signals, n_samples)."""
    moves = first_order_scan(0.8, np.diff(signals, axis=1, prepend=signals[:, :1]), record.starts)
    return np.stack([np.sign(moves), *(filtered(record, signals, tau) for tau in (5.0, 25.0))])


def filtered(record: Record, signals: np.ndarray, tau: float) -> np.ndarray:
    """First-order filter of signals (n_signals, n_samples) over tau samples, settled at the start of every run."""
    a, first = np.exp(-1.0 / tau), signals[:, record.starts][:, record.run_of_row]
    return np.asarray(first + (1.0 - a) * first_order_scan(a, signals - first, record.starts))


def stacked(parts: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Functions of several parts (n, n_samples) below each other, and the rows of each part."""
    ends = np.cumsum([len(part) for part in parts])
    return np.concatenate(parts), np.split(np.arange(ends[-1]), ends[:-1])


def pairs(f: np.ndarray) -> list[np.ndarray]:
    """Neighbours of rows (n, n_samples)."""
    return [f[k : k + 2] for k in range(len(f) - 1)]


def staircases(z: np.ndarray, name: str) -> Iterator[SignalForms]:
    """A fine curve of an input or a reading, which may be a staircase."""
    if varies(z):
        f = hats(z, FINE_KNOTS)
        yield SignalForms(name, f, (Form(np.arange(len(f))),))


def followers(record: Record, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What follows a signal, held within a sample, with play and at limited rates, its means over each: (n_widths, n_samples).

    And that at limited rates at the samples. Sums of plays are any hysteresis that closes its loops (Prandtl and Ishlinskii).
    """
    reach, held = np.ptp(z), hold(z, 1, 0, record.starts)
    rates = reach / SLEWS
    plays, slews = play(held, reach * np.array(PLAYS), record.starts), rate_limit(held, rates, 1.0, record.starts)
    return plays.mean[0], slews.mean[0], slews.at_samples()


def of_time(record: Record) -> Iterator[SignalForms]:
    """A smooth curve of the time since the start, where runs of different inputs can share it."""
    different = {record.u[:, a : a + n].tobytes() for a, n in zip(record.starts, record.lengths)}
    if len(different) >= RUNS_THAT_SHARE:
        f = hats(record.t - record.t[record.starts][record.run_of_row], FINE_KNOTS)
        yield SignalForms("time", f, (Form(np.arange(len(f)), roughness(len(f))),))


def surfaces(record: Record, signals: np.ndarray, names: Sequence[str], held: Container[str]) -> Iterator[SignalForms]:
    """Laws of two signals, their product and a smooth surface over them, by their means over each sample.

    Signals named in ``held`` stand still within a sample.
    """
    moving = [(name, z) for name, z in zip(names, signals) if varies(z)]
    for (a, za), (b, zb) in combinations(moving, 2):
        across, along = (np.concatenate([z[None], hats(z, KNOTS_OF_SURFACE)]) for z in (za, zb))
        ends = [f if name in held else at_end(record, f) for name, f in ((a, across), (b, along))]
        f = 0.5 * (across[:, None] * along + ends[0][:, None] * ends[1])
        m, n = len(across) - 1, len(along) - 1
        rough = np.kron(roughness(m), np.eye(n)) + np.kron(np.eye(m), roughness(n))
        forms = Form(np.array([0])), Form(np.arange(1, 1 + m * n), rough if rough.any() else None)
        product, surface = f[0, 0] / max(float(np.max(np.abs(f[0, 0]))), 1e-300), f[1:, 1:].reshape(m * n, -1)
        yield SignalForms(f"{a}*{b}", np.concatenate([product[None], surface]), forms)


def over_sample(record: Record, f: np.ndarray) -> np.ndarray:
    """Means of functions (n_functions, n_samples) over each sample, by their values at its ends; the last of a run stands."""
    return 0.5 * (f + at_end(record, f))


def varies(z: np.ndarray) -> bool:
    """Whether a signal does not stand still."""
    return bool(np.ptp(z) > 1e-9 * max(float(np.max(np.abs(z))), 1e-300))


def static(z: np.ndarray) -> tuple[np.ndarray, tuple[Form, ...]]:
    """Functions of a signal and their forms: simple ones, kinks, polynomials, a smooth curve; with a jump at zero too."""
    singles = np.stack([SHAPES[shape].value(z / np.max(np.abs(z)), ROOT, 0.0) for shape in SIMPLE])
    powers = ((z - np.mean(z)) / np.ptp(z)) ** np.arange(max(POLYNOMIAL_DEGREES) + 1)[:, None]
    functions, (simple, power, smooth, kinks) = stacked([singles, powers, hats(z, KNOTS_OF_LAW), hinges(z)])
    polynomials = [power[: degree + 1] for degree in (0, 1, *POLYNOMIAL_DEGREES)]
    rough = roughness(len(smooth)) if len(smooth) > 2 else None
    forms = [*(Form(k[None]) for k in (*simple, *kinks)), *map(Form, polynomials), Form(smooth, rough)]
    if np.min(z) < 0.0 < np.max(z):
        jump = simple[SIMPLE.index("sign")]
        forms += [Form(np.r_[own, jump]) for own in polynomials]
        if rough is not None:
            forms.append(Form(np.r_[smooth, jump], np.pad(rough, (0, 1))))
    return functions, tuple(forms)


def hinges(z: np.ndarray) -> np.ndarray:
    """What a signal exceeds some of its quantiles by, and what it falls short of them by, (n_hinges, n_samples)."""
    levels = np.unique(np.quantile(z, HINGES))[:, None]
    return np.concatenate([SHAPES[shape].value(z, levels, 0.0) for shape in ("above", "below")]) / np.ptp(z)


def roughness(n: int) -> np.ndarray:
    """Sum of the squared second differences of n weights, as a quadratic form."""
    second = np.diff(np.eye(n), 2, axis=0)
    return second.T @ second
