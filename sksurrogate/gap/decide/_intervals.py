"""Intervals of the parameters of what is named: noise, disturbance and numerics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._problem import Candidate, Numerics
from sksurrogate.gap.fit._project import project_starts
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._table import Table

__all__ = ["intervals", "parameter_errors"]

#: Share of a parameter that integrators and the smoothing of kinks may always move.
NUMERICS = 5e-4
#: What is said of parameters that close the gap, and where they would hide effects as large.
RETUNED = "Re-tuning alone closes the gap."
HIDES = " It would hide these effects: they part from it where parameters are measured or fewer are free (free_params)."


def covariance(found: Evidence) -> np.ndarray:
    """Covariance of the output-error parameters when the residual has the rival's own noise.

    The sandwich ``H^-1 J' W S W J H^-1`` with W the white weights of the fit and S the covariance of white noise, forces
    and coloured sensor noise; initial states are projected out.
    """
    rival = found.candidate
    problem, lin = rival.problem, rival.linearised
    k = lin.J_theta.shape[1]
    if k == 0:
        return np.zeros((0, 0))
    white = 1.0 / problem.sd[:, None, None]
    J = project_starts(
        (lin.J_theta * white).transpose(1, 0, 2), lin.J_x[:, rival.model.free_states] * white, problem.record.starts
    )
    flat = J.reshape(k, -1)
    H = flat @ flat.T + np.diag(1.0 / problem.prior(rival.effects, rival.fit.theta) ** 2)
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    seen = values > 1e-10 * values[-1]
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(scale, scale)
    pull = rival.disturbance.spread((J * white.transpose(1, 0, 2)).transpose(1, 0, 2), found.noise)
    out = inverse @ pull @ inverse
    blind = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
    out[blind, blind] = np.inf
    return out


def numerical_change(rival: Candidate) -> np.ndarray:
    """How far the parameters move when the steps are halved and kinks made sharper."""
    problem, numerics = rival.problem, rival.problem.numerics
    finer = problem.at(Numerics(2 * numerics.n_sub, 2 * numerics.sharpness))
    fit = finer.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, settled=True, max_steps=6)
    coarse = problem.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, settled=True, max_steps=6)
    if fit is None or coarse is None:
        return np.zeros(len(rival.fit.theta))
    return np.abs(fit.fit.theta - coarse.fit.theta)


def intervals(found: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """90 % intervals of all parameters: noise and disturbance, and what steps and kinks may have moved."""
    rival, theta = found.candidate, found.fit.theta
    spread = np.sqrt(np.maximum(np.diag(covariance(found)), 0.0))
    numerical = numerical_change(rival)
    half = np.sqrt((1.645 * spread) ** 2 + numerical**2 + (NUMERICS * theta) ** 2)
    low, high = rival.problem.bounds(rival.effects)
    return np.maximum(theta - half, low), np.minimum(theta + half, high)


def parameter_errors(
    retuned: Table, share: float, hidden: Sequence[tuple[str, str, str | None]] = ()
) -> list[EffectEstimate]:
    """Re-tuning alone closes the gap: one parameter_error for each parameter that moved, with equal parts of the share.

    The effects ``hidden`` by the re-tuning are equivalents of all of them together.
    """
    rows = [row for row in retuned if row["moved"]]
    out = []
    for row in rows:
        p0 = row["nominal"]
        value, *ends = [(row[k] / p0 - 1.0) if p0 != 0 else row[k] for k in ("value", "low", "high")]
        out.append(
            EffectEstimate(
                "parameter_error",
                row["parameter"],
                None,
                share / len(rows),
                {"relative_error": value},
                {"relative_error": (min(ends), max(ends))},
                1.0,
                list(hidden),
                RETUNED + HIDES if hidden else RETUNED,
            )
        )
    return out
