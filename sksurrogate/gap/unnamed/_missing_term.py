"""The shape of a missing term: estimated through the dynamics, not read off a smoothed force.

``r = sum_j c_j G phi_j(z) + C dx + noise``: a function of the states and inputs enters one balance, input or sensor and G
carries it to the outputs. Generalised least squares under the noise model with a free force at that place gives the
function with honest bands; the force takes what other variables add.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.fit._normal_equations import solve
from sksurrogate.gap.fit._record_parts import run_folds
from sksurrogate.gap.results._effect_estimate import BAND
from sksurrogate.gap.results._missing_term import Curve, MissingTerm
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_regression import Draft
from sksurrogate.gap.unnamed._law_shapes import hats_at

#: Knots of a curve; rows that each must see.
KNOTS_OF_TERM, FEWEST_ROWS = 14, 8
#: Formulae that are listed.
MOST_LAWS = 4
#: Share that a further parameter must explain for a formula to be listed before a shorter one.
WORTH_OF_PARAMETER = 0.01
#: Formulae that explain less are not worth telling.
LEAST_TERM_EXPLAINED = 0.05


def shape_of(drivers: Drivers, drafts: Sequence[Draft]) -> MissingTerm:
    """The term at a place against each variable with 90 % bands, and the formulae that come close to it.

    ``drivers``: signals that the formulae hold, and the place.
    ``drafts``: formulae at the place, the best first.
    """
    channel = drivers.channel
    fold, whole = run_folds(channel.record), channel.force()
    curves = []
    for name, z in channel.signals.items():
        if np.std(z) > 1e-12 * max(np.abs(z).max(), 1e-300):
            try:
                curves.append(_curve(channel, name, z, whole, fold))
            except np.linalg.LinAlgError:  # what a curve of this signal does to the outputs is not finite
                continue
    curves.sort(key=lambda curve: -curve.explained)
    listed = []
    for draft in [draft for draft in drafts if draft.worth > 0.0][: 2 * MOST_LAWS]:
        values = drivers.values(draft.terms)
        share = _explained(channel, values, channel.respond(values), whole, fold)
        if share > LEAST_TERM_EXPLAINED:
            listed.append((share, draft))
    # A parameter more must be worth it on runs left out.
    listed.sort(key=lambda item: -(item[0] - WORTH_OF_PARAMETER * len(item[1].values)))
    laws = [drivers.effect(draft.terms, draft.coefficients_alone, False) for _, draft in listed[:MOST_LAWS]]
    texts = tuple(f"{law.text()}  (explains {100 * share:.0f} %)" for (share, _), law in zip(listed, laws))
    effects = () if channel.kind == "output" else tuple(laws)
    return MissingTerm(channel.location, channel.kind, tuple(curves), texts, effects)


def _curve(channel: Channel, name: str, z: np.ndarray, whole: np.ndarray, fold: np.ndarray) -> Curve:
    """A piecewise linear function of one variable."""
    knots = np.unique(np.r_[z.min(), np.quantile(z, np.linspace(0, 1, KNOTS_OF_TERM + 2)[1:-1]), z.max()])
    phi = hats_at(z, knots)
    enough = (phi > 0.25).sum(axis=1) >= FEWEST_ROWS
    if not enough.all() and enough.sum() >= 2:
        knots = knots[enough]
        phi = hats_at(z, knots)
    J = channel.respond(phi)
    noise = channel.settled(J)
    columns = np.concatenate([channel.r[:, None], J], axis=1)
    G, _ = channel.D.gram(columns, noise)
    H = G[1:, 1:] + 1e-9 * np.trace(G[1:, 1:]) / len(phi) * np.eye(len(phi))
    covariance = np.linalg.pinv(H, rcond=1e-12, hermitian=True)
    value = covariance @ G[1:, 0]
    fine = np.unique(np.r_[knots, 0.5 * (knots[1:] + knots[:-1])])
    mix = hats_at(fine, knots)
    variance = np.maximum(np.einsum("kf,kl,lf->f", mix, covariance, mix), 0.0)
    # Straight pieces miss a bend by up to an eighth of its second difference.
    bend = np.zeros(len(knots))
    bend[1:-1] = np.abs(value[:-2] - 2 * value[1:-1] + value[2:]) / 8
    if len(bend) > 2:
        bend[0], bend[-1] = bend[1], bend[-2]
    spread = np.sqrt(BAND**2 * variance + (mix.T @ bend) ** 2)
    explained = _explained(channel, phi, J, whole, fold)
    return Curve(name, fine, mix.T @ value, mix.T @ value - spread, mix.T @ value + spread, explained)


def _explained(channel: Channel, phi: np.ndarray, J: np.ndarray, whole: np.ndarray, fold: np.ndarray) -> float:
    """Share of the smoothed force's variance that functions phi explain on runs left out."""
    grams, _ = channel.D.gram_by_run(np.concatenate([channel.r[:, None], J], axis=1), channel.noise)
    total = grams.sum(axis=0)
    fold_of_row = fold[channel.record.run_of_row]
    r = channel.r.copy()
    folds = np.unique(fold)
    for k in folds:
        train = total - grams[fold == k].sum(axis=0) if len(folds) > 1 else total
        H = train[1:, 1:] + 1e-6 * np.trace(train[1:, 1:]) / len(phi) * np.eye(len(phi))
        c = solve(H, train[1:, 0])
        rows = fold_of_row == k
        r[:, rows] -= np.einsum("k,okt->ot", c, J[:, :, rows])
    left = channel.force(r)
    spread = float(np.sum((whole - whole.mean()) ** 2))
    level = max(spread, 0.05 * float(np.sum(whole**2)), 1e-300)  # a constant has no variance to explain
    return float(1.0 - np.sum(left**2) / level)
