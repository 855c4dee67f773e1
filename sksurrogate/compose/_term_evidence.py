"""Coefficients of a term inside a plant, their prior and the noise, by the evidence of its free runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.compose._term import TermModel
from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.evidence import Evidence, by_run, correlation_length, weigh
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.output_error import output_error

#: Size of a coefficient, for differences near 0: terms are in units of the spread of what they are added to.
COEFFICIENT_UNIT = 0.1
#: Rounds in which the penalty follows the evidence; the factor it changes by at most, and the nats between rounds
#: at which it has settled: no choice hangs on fewer.
TERM_ROUNDS, LARGEST_MOVE, NATS_AT_REST = 10, 20.0, 0.5
#: Steps of the first fit and of those that follow it.
FIRST_STEPS, MORE_STEPS = 30, 8
#: Least noise, as a share of an output's deviation: what differences and integration leave.
LEAST_NOISE_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class TermFit:
    """A fitted term."""

    theta: np.ndarray  #: (n_theta,)
    penalty: np.ndarray  #: (n_groups,): of the coefficients of each group, in units of the squares over ``sd``
    sd: np.ndarray  #: (n_outputs,): noise
    log_evidence: float  #: Of white noise, up to a constant of the data; nan where the penalty was given


def fit_term(term: TermModel, x: np.ndarray, sd: np.ndarray, known: TermFit | None = None) -> TermFit | None:
    """Fit through the free run, initial states free.

    ``x`` (n_states, n_samples): trajectory to start from.
    ``sd`` (n_outputs,): guess of the noise; its size follows the evidence.
    ``known``: its penalty and noise are taken as they are.
    Returns None where no finite free run was found.
    """
    record = term.record
    groups = np.tile(term.basis.group, len(term.targets))
    penalty, sd = (np.ones(2), sd) if known is None else (known.penalty, known.sd)
    theta, free = np.zeros(len(groups)), np.full(len(groups), np.inf)
    least = np.max(LEAST_NOISE_SHARE * np.nanstd(record.y, axis=1) / sd)  # of the factor of the noise
    unit, best, larger = np.full(len(groups), COEFFICIENT_UNIT), None, 0.0
    for k in range(TERM_ROUNDS):
        fit = output_error(
            term, theta, x, sd, unit=unit, bounds=(-free, free), prior=1.0 / np.sqrt(penalty[groups]),
            open_steps=0 if k else 2, max_steps=MORE_STEPS if k else FIRST_STEPS,
        )  # fmt: skip
        if fit is None:
            break
        theta, x = fit.theta, fit.x
        if known is not None:
            return TermFit(theta, penalty, sd, np.nan)
        moved, log_evidence = _weighed(term, theta, x, fit.y, sd, groups, penalty)
        log_evidence -= larger * np.count_nonzero(np.isfinite(record.y))
        settled = best is not None and abs(log_evidence - best.log_evidence) < NATS_AT_REST
        best = TermFit(theta, penalty, sd, log_evidence)
        if settled:
            break
        change = np.clip(moved.penalty / penalty, 1.0 / LARGEST_MOVE, LARGEST_MOVE)
        factor = max(np.sqrt(moved.noise), least / np.exp(larger))
        # the noise is the unit of the squares: descents end by the size of the squares
        penalty, sd, larger = penalty * change / factor**2, sd * factor, larger + np.log(factor)
    return best


def _weighed(
    term: TermModel, theta: np.ndarray, x: np.ndarray, y: np.ndarray, sd: np.ndarray, groups: np.ndarray, penalty: np.ndarray
) -> tuple[Evidence, float]:  # fmt: skip
    """Where the evidence moves penalty and noise, initial states eliminated; and its logarithm for white noise."""
    record, none = term.record, np.zeros(len(theta))
    lin = linearise(term, theta, x, np.full(len(theta), COEFFICIENT_UNIT))
    error = record.residual(y)
    gram = Arrow.build(lin.J_theta, lin.J_x, error, sd, record.starts, none, none).information()
    error = error / sd[:, None]
    given = gram, theta, groups, penalty, float(np.sum(error**2)), float(np.isfinite(record.y).sum())
    return weigh(*given, correlation_length(by_run(error.T, record.lengths))), weigh(*given).log_evidence
