"""Which lags? A scan of linear lag models on runs left out, all orders from one Gram matrix a fold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter, lfiltic
from sklearn.preprocessing import StandardScaler

from sksurrogate.exceptions import DataError
from sksurrogate.features._lag import lag_columns
from sksurrogate.runs import Run, cut_runs, resolve_runs


@dataclass(frozen=True, eq=False)
class OrderScan:
    """Errors of linear lag models on runs left out.

    Attributes
    ----------
    output_lags, input_lags : ndarray of int (n_orders,)
        As :class:`~sksurrogate.compose.RecursivePredictor` takes them.
    n_params : ndarray of int (n_orders,)
    one_step, free_run : ndarray (n_orders,)
        RMSE, each output divided by its standard deviation; inf where a free run diverges.
    free_run_error : ndarray (n_orders,)
        Standard error of ``free_run`` over the folds.
    best_output_lags, best_input_lags : int
        The smallest model whose free run is within one standard error of the best one.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.model_selection import scan_orders
    >>> X, y, runs = make_reactor_runs(4, 60, u_range=(0.1, 0.16), noise=0.02, random_state=0)
    >>> scan = scan_orders(X, y, groups=runs)
    >>> len(scan.free_run) == len(scan.n_params) == len(scan.output_lags)
    True
    """

    output_lags: np.ndarray
    input_lags: np.ndarray
    n_params: np.ndarray
    one_step: np.ndarray
    free_run: np.ndarray
    free_run_error: np.ndarray
    best_output_lags: int
    best_input_lags: int

    def __str__(self) -> str:
        order = np.argsort(self.free_run, kind="stable")[:8]
        lines = [f"best: output_lags={self.best_output_lags}, input_lags={self.best_input_lags}"]
        lines.append("output_lags  input_lags  one step  free run")
        for i in order:
            lines.append(
                f"{self.output_lags[i]:11d}  {self.input_lags[i]:10d}  {self.one_step[i]:8.4g}  {self.free_run[i]:8.4g}"
            )
        return "\n".join(lines)


def scan_orders(
    X: Any,
    y: Any,
    groups: Any = None,
    *,
    max_output_lags: int = 8,
    max_input_lags: int = 8,
    n_splits: int = 5,
    alpha: float = 1e-8,
    run: Any = None,
) -> OrderScan:
    """Score linear lag models of all orders, one step ahead and in free run, on runs left out.

    All orders are solved from one Gram matrix a fold, so that a scan costs about as much as one fit. A linear model is
    a guide to the lags that a network needs, not a proof: compare the best few in a search.

    Parameters
    ----------
    X : array-like (n_samples, n_inputs)
    y : array-like (n_samples,) or (n_samples, n_outputs)
    groups : array-like (n_samples,), optional
        A single record is cut into blocks, with a gap as long as the longest lag.
    max_output_lags, max_input_lags : int, default=8
        Orders 1, ..., and 0, ....
    n_splits : int, default=5
        Folds of runs.
    alpha : float, default=1e-8
        Ridge penalty, relative to the mean square of the features.
    run : None, column name, int or "index"
        Where X says which run a row belongs to.

    Returns
    -------
    OrderScan

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.model_selection import scan_orders
    >>> rng = np.random.default_rng(0)
    >>> X, y = rng.normal(size=(600, 1)), np.zeros(600)
    >>> for t in range(2, 600):
    ...     y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + X[t - 1, 0] + 0.1 * rng.normal()
    >>> scan = scan_orders(X, y, max_output_lags=4, max_input_lags=4)
    >>> scan.best_output_lags, scan.best_input_lags
    (2, 1)
    """
    if max_output_lags < 1 or max_input_lags < 0 or n_splits < 2:
        raise DataError(
            f"max_output_lags={max_output_lags}, max_input_lags={max_input_lags}, n_splits={n_splits}: expected "
            "ints of at least 1, 0 and 2."
        )
    longest = max(max_output_lags, max_input_lags)
    runs = resolve_runs(X, y, groups=groups, run=run, min_rows=longest + 2)
    if len(runs) < n_splits:
        labels = np.full(runs.n_samples, -1)
        for r, one in enumerate(runs):
            labels[one.start : one.stop] = r
        blocks = -(-n_splits // len(runs))
        runs = resolve_runs(X, y, groups=_cut(labels, blocks, longest), run=run, min_rows=longest + 2)
    scaled = _standardised(runs)
    o, m = scaled[0].y.shape[1], scaled[0].X.shape[1]
    fold = np.arange(len(scaled)) % n_splits
    parts = [_features(one, max_output_lags, max_input_lags) for one in scaled]
    grams = [sum(P.T @ P for P, of in zip(parts, fold) if of == k) for k in range(n_splits)]
    width = parts[0].shape[1]
    rows = []
    for ny in range(1, max_output_lags + 1):
        for nu in range(max_input_lags + 1):
            past = np.arange(ny * o)
            known = max_output_lags * o + np.arange((nu + 1) * m)
            chosen = np.concatenate([past, known, [width - o - 1]])
            one_step, free = _score(scaled, parts, grams, fold, chosen, ny, longest, alpha)
            error = float(np.std(free) / np.sqrt(n_splits)) if np.all(np.isfinite(free)) else np.inf
            rows.append((ny, nu, len(chosen) * o, one_step, float(np.sqrt(np.mean(np.square(free)))), error))
    ny_, nu_, size, one, free_run, free_error = (np.array(column) for column in zip(*rows))
    best = int(np.argmin(free_run))
    bar = free_run[best] + (free_error[best] if np.isfinite(free_error[best]) else 0.0)
    close = np.flatnonzero(free_run <= bar)
    pick = int(close[np.lexsort((free_run[close], size[close]))[0]])
    return OrderScan(ny_, nu_, size, one, free_run, free_error, int(ny_[pick]), int(nu_[pick]))


def _cut(labels: np.ndarray, blocks: int, gap: int) -> np.ndarray:
    """Runs cut into blocks; rows outside of runs stay outside."""
    inside = labels >= 0
    out = np.full(len(labels), -1)
    out[inside] = cut_runs(labels[inside], blocks, gap)
    return out


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A run without mean and unit: orders depend on neither."""

    X: np.ndarray  #: (n_samples, n_inputs)
    y: np.ndarray  #: (n_samples, n_outputs)


def _standardised(runs: Iterable[Run]) -> list[_Scaled]:
    """Every column by mean and standard deviation over all runs; one that never moves is 0."""
    X = StandardScaler().fit(np.concatenate([one.X for one in runs]))
    y = StandardScaler().fit(np.concatenate([one.y for one in runs]))
    return [_Scaled(X.transform(one.X), y.transform(one.y)) for one in runs]


def _features(run: _Scaled, ny: int, nu: int) -> np.ndarray:
    """Past outputs lag by lag, inputs lag by lag, one, then the outputs; rows with a whole past."""
    y, o, m = run.y, run.y.shape[1], run.X.shape[1]
    past = lag_columns(y, [(j, k) for k in range(1, ny + 1) for j in range(o)])
    known = lag_columns(run.X, [(j, k) for k in range(nu + 1) for j in range(m)])
    return np.concatenate([past, known, np.ones((len(y), 1)), y], axis=1)[max(ny, nu) :]


def _score(
    runs: list[_Scaled],
    parts: list[np.ndarray],
    grams: list[Any],
    fold: np.ndarray,
    chosen: np.ndarray,
    ny: int,
    longest: int,
    alpha: float,
) -> tuple[float, np.ndarray]:
    """One-step RMSE, and free-run RMSE of every fold, on the runs of the folds left out."""
    o = runs[0].y.shape[1]
    last = np.arange(len(grams[0]) - o, len(grams[0]))
    square, count, free = 0.0, 0, np.empty(len(grams))
    for k, held in enumerate(grams):
        G = sum(gram for j, gram in enumerate(grams) if j != k)
        normal = G[np.ix_(chosen, chosen)].copy()
        size = np.diag(normal).copy()
        normal[np.diag_indices_from(normal)] += alpha * size + 1e-300
        theta = np.linalg.solve(normal, G[np.ix_(chosen, last)])
        cross, tested = held[np.ix_(chosen, last)], held[np.ix_(chosen, chosen)]
        error = np.diag(held[np.ix_(last, last)] - 2 * theta.T @ cross + theta.T @ tested @ theta)
        members = [r for r in range(len(runs)) if fold[r] == k]
        square += float(np.maximum(error, 0).sum())
        count += sum(parts[r].shape[0] for r in members) * o
        free[k] = _free_run(runs, parts, members, chosen, theta, ny, longest)
    return float(np.sqrt(square / count)), free


def _free_run(
    runs: list[_Scaled],
    parts: list[np.ndarray],
    members: list[int],
    chosen: np.ndarray,
    theta: np.ndarray,
    ny: int,
    longest: int,
) -> float:
    """RMSE of linear free runs from the measured first rows; all members at once."""
    o = runs[0].y.shape[1]
    if o == 1:
        return _filtered(runs, parts, members, chosen, theta[:, 0], ny, longest)
    members = sorted(members, key=lambda r: -len(parts[r]))
    n, drive = len(parts[members[0]]), ny * o
    known = np.zeros((n, len(members), o))
    truth = np.full((n, len(members), o), np.nan)
    y = np.zeros((longest + n, len(members), o))
    for i, r in enumerate(members):
        rows = parts[r].shape[0]
        known[:rows, i] = parts[r][:, chosen[drive:]] @ theta[drive:]
        truth[:rows, i] = parts[r][:, -o:]
        y[:longest, i] = runs[r].y[:longest]
    # newest first in theta, oldest first in a window of y
    weights = theta[:drive].reshape(ny, o, o)[::-1].reshape(drive, o)
    with np.errstate(all="ignore"):
        for t in range(n):
            window = y[longest + t - ny : longest + t].transpose(1, 0, 2).reshape(len(members), drive)
            y[longest + t] = window @ weights + known[t]
        error = (y[longest:] - truth)[np.isfinite(truth)]
        value = float(np.sqrt(np.mean(error**2)))
    return value if np.isfinite(value) and value < 1e6 else float("inf")


def _filtered(
    runs: list[_Scaled],
    parts: list[np.ndarray],
    members: list[int],
    chosen: np.ndarray,
    theta: np.ndarray,
    ny: int,
    longest: int,
) -> float:
    """The same for one output: a free run is a recursive filter of what the inputs give."""
    denominator = np.r_[1.0, -theta[:ny]]
    square, count = 0.0, 0
    with np.errstate(all="ignore"):
        for r in members:
            past = runs[r].y[longest - ny : longest, 0][::-1]
            known = parts[r][:, chosen[ny:]] @ theta[ny:]
            free, _ = lfilter([1.0], denominator, known, zi=lfiltic([1.0], denominator, past))
            square += float(np.sum((free - parts[r][:, -1]) ** 2))
            count += len(free)
        value = float(np.sqrt(square / count))
    return value if np.isfinite(value) and value < 1e6 else float("inf")
