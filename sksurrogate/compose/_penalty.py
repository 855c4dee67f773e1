"""The penalty of a shooting fit, chosen on runs left out and on what the model forgets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.compose._evidence_fit import Posterior, shoot_by_evidence
from sksurrogate.compose._free_fit import Scaling, shoot
from sksurrogate.kernels.net import LagNet
from sksurrogate.kernels.rollout import free_run
from sksurrogate.runs import Run

#: Penalties that are tried, largest first.
ALPHAS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
#: A smaller penalty must not leave more than this multiple of what a larger one leaves of the first rows, and this
#: much of the outputs' spread.
_TIMES, _AT_LEAST = 3.0, 0.1


def shoot_with(
    alpha: Any, model: LagNet, runs: Sequence[Run], **settings: Any
) -> tuple[LagNet, float, float, Posterior | None]:
    """Fit on free runs.

    ``alpha``: None: 0.1 for networks, 0 for linear models.
    ``**settings``: of :func:`shoot`.
    Returns ``model``, ``loss``, ``alpha``.
    Returns ``posterior``: with "evidence".
    """
    if alpha == "evidence":
        model, posterior = shoot_by_evidence(model, runs, **settings)
        fit = posterior.fit
        return model, fit.loss.value(fit.model, fit.y), fit.loss.alpha, posterior
    if alpha is None:
        alpha = 0.1 if model.net.activations else 0.0
    if not isinstance(alpha, str):
        return *shoot(model, runs, alpha=alpha, **settings), float(alpha), None
    scaling = Scaling(runs)
    place = ALPHAS.index(_held_out(model, runs, scaling, settings))
    here = shoot(model, runs, alpha=ALPHAS[place], **settings)
    # a model that no longer forgets where it began is not a better one, however well the runs left out are met
    while place:
        above = shoot(model, runs, alpha=ALPHAS[place - 1], **settings)
        left = [forgetting(found, runs, scaling, settings["n_first"]) for found, _ in (here, above)]
        if left[0] <= _TIMES * left[1] + _AT_LEAST:
            break
        place, here = place - 1, above
    return *here, ALPHAS[place], None


def _held_out(model: LagNet, runs: Sequence[Run], scaling: Scaling, settings: dict[str, Any]) -> float:
    """The largest penalty within one standard error of the best free run on the half of the runs left out."""
    n = settings["n_first"]
    pieces = list(runs) if len(runs) > 1 else _quarters(runs[0], n)
    squares = np.full((len(ALPHAS), len(pieces)), np.inf)
    for i, alpha in enumerate(ALPHAS):
        for fold in range(2):
            rest = [piece for k, piece in enumerate(pieces) if k % 2 != fold]
            if not rest:
                continue
            found, _ = shoot(model, rest, alpha=alpha, **settings)
            for k in range(fold, len(pieces), 2):
                y = np.asarray(pieces[k].y)
                error = (_run(found, pieces[k].X, y[:n]) - y)[n:] / scaling.y_std
                squares[i, k] = np.mean(error**2) if np.isfinite(error).all() else np.inf
    mean = squares.mean(axis=1)
    best = int(np.argmin(mean))
    if not np.isfinite(mean[best]):
        return 0.1
    limit = mean[best] + squares[best].std(ddof=1) / np.sqrt(len(pieces))
    return ALPHAS[int(np.flatnonzero(mean <= limit)[0])]


def _quarters(run: Run, n_first: int) -> list[Run]:
    """Four parts of one run (fewer where they would be too short to learn from)."""
    count = int(np.clip(len(run) // (4 * (n_first + 1)), 1, 4))
    cuts = np.linspace(0, len(run), count + 1).astype(int).tolist()
    y = np.asarray(run.y)
    return [
        Run(run.label, run.start + a, run.start + b, run.X[a:b], y[a:b], run.t[a:b]) for a, b in zip(cuts, cuts[1:])
    ]


def forgetting(model: LagNet, runs: Sequence[Run], scaling: Scaling, n_first: int) -> float:
    """What is left, in the second half of a run, of first rows at the ends and in the middle of the outputs' range.

    Root mean square in standard deviations of the outputs, of the run where it is largest; inf where a run diverges.
    """
    y = np.concatenate([run.y for run in runs])  # type: ignore[misc]
    worst = 0.0
    for run in runs:
        own = _run(model, run.X, np.asarray(run.y)[:n_first])
        for level in np.quantile(y, [0.0, 0.5, 1.0], axis=0):
            away = (_run(model, run.X, np.tile(level, (n_first, 1))) - own)[len(own) // 2 :] / scaling.y_std
            size = float(np.sqrt(np.mean(away**2)))
            worst = max(worst, size if np.isfinite(size) else np.inf)
    return worst


def _run(model: LagNet, X: np.ndarray, first: np.ndarray) -> np.ndarray:
    """One free run (n_samples, n_outputs); it may become infinite or nan."""
    with np.errstate(all="ignore"):
        return free_run(model, X[None], first[None])[0]
