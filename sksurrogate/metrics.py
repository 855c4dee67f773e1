"""Errors of free runs, and tests of residuals."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2

from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.linear_fit import linear_least_squares

__all__ = ["ResidualTest", "cross_correlation_test", "fit_percent", "whiteness_test"]

#: An autoregression of the residual has at most one lag for so many rows.
SAMPLES_AN_ORDER = 10


class ResidualTest(NamedTuple):
    """Correlations of a residual test.

    Attributes
    ----------
    lags : ndarray of int
    correlation : ndarray
    bound : float
        99 % bound of one correlation.
    statistic, p_value : float
        Of all lags together.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.metrics import whiteness_test
    >>> test = whiteness_test(np.random.default_rng(0).normal(size=500))
    >>> bool(test.p_value > 0.01)   # nothing left in white noise
    True
    """

    lags: np.ndarray
    correlation: np.ndarray
    bound: float
    statistic: float
    p_value: float


def fit_percent(y_true: Any, y_pred: Any) -> np.ndarray:
    """Fit per cent of each output, ``100 (1 - |y - y_hat| / |y - mean(y)|)``; 100 is perfect, 0 the mean.

    Parameters
    ----------
    y_true, y_pred : array-like (n_samples,) or (n_samples, n_outputs)

    Returns
    -------
    ndarray (n_outputs,)
        nan where a value is missing (nan, or masked).

    Examples
    --------
    >>> fit_percent([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    array([100.])
    """
    truth, found = np.asarray(unmasked(y_true), float), np.asarray(unmasked(y_pred), float)
    if truth.shape != found.shape:
        raise DataError(
            f"y_true has shape {truth.shape} and y_pred {found.shape}: give one prediction per measurement."
        )
    truth, found = truth.reshape(len(truth), -1), found.reshape(len(found), -1)
    spread = np.linalg.norm(truth - truth.mean(axis=0), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return 100.0 * (1.0 - np.linalg.norm(truth - found, axis=0) / spread)


def whiteness_test(residual: Any, n_lags: int = 20) -> ResidualTest:
    """Ljung-Box test: is the one-step residual of one run white?

    Parameters
    ----------
    residual : array-like (n_samples,)
    n_lags : int, default=20

    Returns
    -------
    ResidualTest
        A small ``p_value`` says that the past still predicts the residual.

    Examples
    --------
    >>> import numpy as np
    >>> whiteness_test(np.random.default_rng(0).normal(size=500)).p_value > 0.01
    True
    """
    e = _centred(residual, n_lags, "residual", least=1)
    n = len(e)
    lags = np.arange(1, n_lags + 1)
    r = np.array([e[k:] @ e[: n - k] for k in lags]) / (e @ e)
    statistic = float(n * (n + 2) * np.sum(r**2 / (n - lags)))
    return ResidualTest(lags, r, 2.576 / np.sqrt(n), statistic, float(chi2.sf(statistic, n_lags)))


def cross_correlation_test(residual: Any, u: Any, n_lags: int = 20) -> ResidualTest:
    """Does the past of an input still predict the residual of one run?

    Both signals are filtered by the autoregression that makes the residual white (Box and Jenkins' prewhitening; its order has the
    least BIC), so that a coloured residual, as that of a free run, is not taken for one that depends on the input. The covariance
    of the correlations under independence is then that of the filtered input.

    Parameters
    ----------
    residual, u : array-like (n_samples,)
    n_lags : int, default=20
        Lags 0, ..., n_lags of u.

    Returns
    -------
    ResidualTest

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> u, noise = rng.normal(size=(2, 400))
    >>> cross_correlation_test(noise, u).p_value > 0.01, cross_correlation_test(noise + 0.5 * u, u).p_value < 1e-6
    (True, True)
    """
    e, v = _centred(residual, n_lags, "residual"), _centred(u, n_lags, "u")
    if len(e) != len(v):
        raise DataError(f"residual has {len(e)} rows and u has {len(v)}: give one input per residual.")
    e, v = _prewhitened(e, v, min(n_lags, len(e) // SAMPLES_AN_ORDER))
    n, lags = len(e), np.arange(n_lags + 1)
    cross = np.array([e[k:] @ v[: n - k] for k in lags]) / n
    auto = np.array([v[k:] @ v[: n - k] for k in lags]) / n
    covariance = auto[np.abs(lags[:, None] - lags)] * (e @ e / n)
    statistic = float(n * cross @ linear_least_squares(covariance, cross, rcond=1e-10))
    correlation = cross / np.sqrt(auto[0] * (e @ e / n))
    return ResidualTest(lags, correlation, 2.576 / np.sqrt(n), statistic, float(chi2.sf(statistic, n_lags + 1)))


def _prewhitened(e: np.ndarray, v: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Both signals, less what an autoregression of at most ``most`` lags tells of the first."""
    n = len(e)
    lagged = (
        np.stack([np.r_[np.zeros(k), e[: n - k]] for k in range(1, most + 1)], axis=1) if most else np.empty((n, 0))
    )
    fits = [linear_least_squares(lagged[most:, :k], e[most:]) if k else np.empty(0) for k in range(most + 1)]
    left = np.array([np.sum((e[most:] - lagged[most:, : len(a)] @ a) ** 2) for a in fits])
    bic = (n - most) * np.log(np.maximum(left, np.finfo(float).tiny)) + np.log(n) * np.arange(most + 1)
    order = int(np.argmin(bic))
    whitening = np.r_[1.0, -fits[order]]
    return lfilter(whitening, [1.0], e)[order:], lfilter(whitening, [1.0], v)[order:]


def _centred(values: Any, n_lags: int, name: str, least: int = 0) -> np.ndarray:
    """One signal without its mean; it must move and be longer than the lags."""
    try:
        e = np.asarray(unmasked(values), float)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} holds something that is not a number ({error}).") from None
    if e.ndim != 1 and e.size != len(e):
        raise DataError(f"{name} has shape {e.shape}, expected (n_samples,): test one column at a time.")
    if not isinstance(n_lags, (int, np.integer)) or n_lags < least:
        raise DataError(f"n_lags={n_lags!r} must be an int of at least {least}.")
    e = e.ravel()
    if len(e) <= n_lags + 1 or not np.all(np.isfinite(e)):
        raise DataError(
            f"{name} has {len(e)} rows, {int(np.isfinite(e).sum())} finite: it needs more than n_lags + 1 = {n_lags + 1} "
            "finite rows; leave out the first rows of the run or lower n_lags."
        )
    e = e - e.mean()
    if not np.any(e):
        raise DataError(f"{name} never moves, so that nothing can be correlated with it.")
    return e
