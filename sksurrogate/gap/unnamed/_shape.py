"""The shape of a missing term: estimated through the dynamics, not read off a smoothed force.

``r = sum_j c_j G phi_j(z) + C dx + noise``: a function of the states and inputs enters one balance, input or sensor and G
carries it to the outputs. Generalised least squares under the noise model with a free force at that place gives the
function with honest bands; the force takes what other variables add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._law import LawEffect
from sksurrogate.gap.fit._pushes import a_sample_later
from sksurrogate.gap.results._interval import BAND
from sksurrogate.gap.results._missing_term import Curve, MissingTerm
from sksurrogate.gap.unnamed._symbolic_laws import Library, library, sparse_laws
from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.record import Record

__all__ = ["Channel", "evidence_of_law", "shape_of"]

#: Knots of a curve; rows that each must see.
KNOTS_OF_TERM, FEWEST_ROWS = 14, 8
#: Laws that are listed.
MOST_LAWS = 4
#: Share that a further term must explain for a law to be listed before a shorter one.
WORTH_OF_TERM = 0.01
#: Laws that explain less are not worth telling.
LEAST_TERM_EXPLAINED = 0.05


@dataclass(frozen=True, eq=False)
class Channel:
    """How a signal that enters at one place reaches the outputs.

    Attributes
    ----------
    record : Record
    D : Disturbance
        With the one force at the place (for a sensor: a force that is held at nothing).
    noise : Noise
        With the force, or the coloured sensor noise, that explains the gap.
    r : ndarray (n_outputs, n_samples)
        Measured less simulated, about the path.
    push : ndarray (n_states, n_samples) or None
        States after one sample of a unit signal; None for a sensor.
    sensor : int or None
    unit : float
        Size of the force that counts as one.
    held : ndarray of bool
        Noise parameters that stay.
    Z : ndarray (n_samples, n_variables)
    names : list of str
    log_likelihood : float
        Of the residual with the free signal.
    followers : (ndarray (n_outputs, n_theta, n_samples), ndarray (n_theta,), ndarray (n_theta,)), optional
        Sensitivities of the parameters that follow, and what holds them: precision and pull.
    x : ndarray (n_states, n_samples), optional
        The path.
    """

    record: Record
    D: Disturbance
    noise: Noise
    r: np.ndarray
    push: np.ndarray | None
    sensor: int | None
    unit: float
    held: np.ndarray
    Z: np.ndarray
    names: list[str]
    log_likelihood: float = -np.inf
    followers: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    x: np.ndarray | None = None

    @property
    def known(self) -> np.ndarray:
        """Sensitivities of the parameters that follow (n_outputs, n_theta, n_samples)."""
        return np.zeros((len(self.r), 0, self.r.shape[1])) if self.followers is None else self.followers[0]

    @property
    def precision(self) -> np.ndarray:
        """What holds them (n_theta,)."""
        return np.zeros(0) if self.followers is None else self.followers[1]

    @property
    def pull(self) -> np.ndarray:
        """What pulls them (n_theta,)."""
        return np.zeros(0) if self.followers is None else self.followers[2]

    def respond(self, signal: np.ndarray) -> np.ndarray:
        """Outputs (n_outputs, n_columns, n_samples) that signals (n_columns, n_samples) cause."""
        m = len(self.r)
        out = np.zeros((m, *signal.shape))
        if self.push is None:
            out[self.sensor] = signal
            return out
        A, C = self.D.A.transpose(1, 2, 0), self.D.C.transpose(1, 2, 0)
        band = recursion_band(A, self.record.starts)
        for a in range(0, len(signal), 32):
            b = a_sample_later(self.push[:, None, :] * signal[None, a : a + 32], self.record.starts)
            out[:, a : a + 32] = np.einsum("oit,ikt->okt", C, solve_recursion(band, b))
        return out

    def force(self, r: np.ndarray | None = None) -> np.ndarray:
        """The smoothed signal at the place, (n_samples,)."""
        _, force, coloured = self.D.states(self.r if r is None else r, self.noise)
        return coloured[self.sensor] if self.sensor is not None else force[0]

    def settled(self, J: np.ndarray) -> Noise:
        """The noise that is left beside columns J (n_outputs, n_columns, n_samples)."""
        try:
            return fit_noise(
                self.D,
                self.r,
                self.noise,
                np.array([self.unit]),
                J,
                np.full(J.shape[1], 1e-12),
                np.zeros(J.shape[1]),
                held=self.held,
                max_iterations=6,
            )[0]
        except np.linalg.LinAlgError:
            return self.noise


def shape_of(channel: Channel, location: str, kind: str, changes: Sequence[float] = ()) -> MissingTerm:
    """The term at a place against each variable with 90 % bands, and laws that come close to it.

    Parameters
    ----------
    channel : Channel
    location, kind : str
    changes : sequence of float
        Times at which the term changes.
    """
    run = np.arange(len(channel.record.starts))
    fold = run % min(len(run), 5)
    whole = channel.force()
    curves = []
    for name, z in zip(channel.names, channel.Z.T):
        if np.std(z) > 1e-12 * max(np.abs(z).max(), 1e-300):
            curves.append(_curve(channel, name, z, whole, fold))
    curves.sort(key=lambda curve: -curve.explained)
    order = [channel.names.index(curve.variable) for curve in curves]
    texts, effects = _told(channel, order, whole, fold, location, kind, changes)
    return MissingTerm(location, kind, tuple(curves), tuple(texts), tuple(effects))


# ---- curves ---------------------------------------------------------------------------------------------------------
def _curve(channel: Channel, name: str, z: np.ndarray, whole: np.ndarray, fold: np.ndarray) -> Curve:
    """A piecewise linear function of one variable."""
    knots = np.unique(np.r_[z.min(), np.quantile(z, np.linspace(0, 1, KNOTS_OF_TERM + 2)[1:-1]), z.max()])
    hats = _hats(z, knots)
    enough = (hats > 0.25).sum(axis=1) >= FEWEST_ROWS
    if not enough.all() and enough.sum() >= 2:
        knots = knots[enough]
        hats = _hats(z, knots)
    J = channel.respond(hats)
    noise = channel.settled(J)
    columns = np.concatenate([channel.r[:, None], J], axis=1)
    G, _ = channel.D.gram(columns, noise)
    H = G[1:, 1:] + 1e-9 * np.trace(G[1:, 1:]) / len(hats) * np.eye(len(hats))
    covariance = np.linalg.pinv(H, rcond=1e-12, hermitian=True)
    value = covariance @ G[1:, 0]
    fine = np.unique(np.r_[knots, 0.5 * (knots[1:] + knots[:-1])])
    mix = _hats(fine, knots)
    variance = np.maximum(np.einsum("kf,kl,lf->f", mix, covariance, mix), 0.0)
    # Straight pieces miss a bend by up to an eighth of its second difference.
    bend = np.zeros(len(knots))
    bend[1:-1] = np.abs(value[:-2] - 2 * value[1:-1] + value[2:]) / 8
    if len(bend) > 2:
        bend[0], bend[-1] = bend[1], bend[-2]
    spread = np.sqrt(BAND**2 * variance + (mix.T @ bend) ** 2)
    explained = _explained(channel, hats, J, whole, fold)
    return Curve(name, fine, mix.T @ value, mix.T @ value - spread, mix.T @ value + spread, explained)


def _hats(z: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Hat functions (n_knots, n_samples), constant beyond the ends."""
    place = np.clip(np.searchsorted(knots, z, side="right") - 1, 0, max(len(knots) - 2, 0))
    out = np.zeros((len(knots), len(z)))
    if len(knots) == 1:
        out[0] = 1.0
        return out
    share = np.clip((z - knots[place]) / (knots[place + 1] - knots[place]), 0.0, 1.0)
    rows = np.arange(len(z))
    out[place, rows] = 1.0 - share
    out[place + 1, rows] += share
    return out


def _explained(channel: Channel, phi: np.ndarray, J: np.ndarray, whole: np.ndarray, fold: np.ndarray) -> float:
    """Share of the smoothed force's variance that functions phi explain on runs left out."""
    grams, _ = channel.D.gram_by_run(np.concatenate([channel.r[:, None], J], axis=1), channel.noise)
    total = grams.sum(axis=0)
    fold_of_row = fold[channel.record.run_of_row]
    r = channel.r.copy()
    for k in np.unique(fold):
        train = total - grams[fold == k].sum(axis=0) if len(np.unique(fold)) > 1 else total
        H = train[1:, 1:] + 1e-6 * np.trace(train[1:, 1:]) / len(phi) * np.eye(len(phi))
        c = np.linalg.lstsq(H, train[1:, 0], rcond=1e-10)[0]
        rows = fold_of_row == k
        r[:, rows] -= np.einsum("k,okt->ot", c, J[:, :, rows])
    left = channel.force(r)
    spread = float(np.sum((whole - whole.mean()) ** 2))
    level = max(spread, 0.05 * float(np.sum(whole**2)), 1e-300)  # a constant has no variance to explain
    return float(1.0 - np.sum(left**2) / level)


# ---- laws -----------------------------------------------------------------------------------------------------------
def _told(
    channel: Channel,
    order: list[int],
    whole: np.ndarray,
    fold: np.ndarray,
    location: str,
    kind: str,
    changes: Sequence[float],
) -> tuple[list[str], list[LawEffect]]:
    """Laws as text, and as effects where they stand in a balance or at an input."""
    if not order:
        return [], []
    shapes = library(channel.Z[:, order], [channel.names[i] for i in order], channel.record.t, changes)
    J = channel.respond(shapes.values)
    grams, _ = channel.D.gram_by_run(np.concatenate([channel.r[:, None], J], axis=1), channel.noise)
    found: list[tuple[float, list[int]]] = []
    for law in sparse_laws(grams, fold)[: 2 * MOST_LAWS]:
        chosen = list(law.chosen)
        share = _explained(channel, shapes.values[chosen], J[:, chosen], whole, fold)
        if share > LEAST_TERM_EXPLAINED:
            found.append((share, chosen))
    # A term more must be worth it on runs left out.
    found.sort(key=lambda item: -(item[0] - WORTH_OF_TERM * len(item[1])))
    texts, effects = [], []
    for share, chosen in found[:MOST_LAWS]:
        values = _coefficients(channel, J[:, chosen]) / shapes.size[chosen]
        texts.append(f"{_text(shapes, chosen, values)}  (explains {100 * share:.0f} %)")
        if kind in ("state", "input"):  # a law at an input is one at a port
            effects.append(_effect(shapes, chosen, values, location))
    return texts, effects


def evidence_of_law(channel: Channel) -> float:
    """Log likelihood of the best law at a place with a force for the rest, less the price of its terms."""
    run = np.arange(len(channel.record.starts))
    shapes = library(channel.Z, channel.names, channel.record.t)
    J = channel.respond(shapes.values)
    if not np.all(np.isfinite(J)):
        return -np.inf
    grams, _ = channel.D.gram_by_run(np.concatenate([channel.r[:, None], J], axis=1), channel.noise)
    best = -np.inf
    laws = sparse_laws(grams, run % min(len(run), 5))
    for chosen in [list(laws[0].chosen)] if laws else [[]]:
        noise = channel.settled(J[:, chosen])
        G, logdet = channel.D.gram(np.concatenate([channel.r[:, None], J[:, chosen]], axis=1), noise)
        fitted = G[1:, 0] @ np.linalg.lstsq(G[1:, 1:], G[1:, 0], rcond=1e-12)[0] if chosen else 0.0
        price = len(chosen) * (0.5 * np.log(channel.D.n_values) + np.log(len(shapes.terms)))
        best = max(best, float(-0.5 * (G[0, 0] - fitted + logdet) - price))
    return best


def _coefficients(channel: Channel, J: np.ndarray) -> np.ndarray:
    """By generalised least squares under the noise that is left."""
    G, _ = channel.D.gram(np.concatenate([channel.r[:, None], J], axis=1), channel.settled(J))
    return np.linalg.lstsq(G[1:, 1:], G[1:, 0], rcond=1e-12)[0]


def _text(shapes: Library, chosen: list[int], values: np.ndarray) -> str:
    """ "+0.5 - 0.3 * v^2"."""
    out = ""
    for k, c in zip(chosen, values):
        text = shapes.terms[k].text
        number = f"{abs(c):.3g}" + ("" if text == "1" else f" * {text}")
        sign = "-" if c < 0 else "+"
        out += f"{sign}{number}" if not out else f" {sign} {number}"
    return out


def _effect(shapes: Library, chosen: list[int], values: np.ndarray, location: str) -> LawEffect:
    """A law as an effect, ready for ``effects=``."""
    terms = tuple(shapes.terms[k] for k in chosen)
    names = sorted({name for term in terms for name in term.variables})
    return LawEffect(location, "*".join(names) or None, terms, tuple(float(c) for c in values))
