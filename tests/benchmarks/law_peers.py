"""Peers for missing terms: sparse regression (pysindy), symbolic regression (gplearn) and a small network (a generic correction) of the
derivative that a simulator leaves.

All see the same residual: the smoothed derivative of noisy runs less what the simulator without the term says at the smoothed states.
Of the thresholds the one that suits the truth is taken, more than a user can choose.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np
from published_systems import System
from scipy.signal import savgol_filter

__all__ = ["PEERS", "best_of", "r2", "residual"]

#: Rows over which states are smoothed before they are differentiated.
WINDOW = 11
THRESHOLDS, BAGS = (0.02, 0.05, 0.1, 0.2), 20

#: A term as a function of the states (n_samples, n_states).
Term = Callable[[np.ndarray], np.ndarray]


def residual(system: System, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed states (n_samples, n_states) and what the simulator without the term leaves of the derivative (n_samples,)."""
    place = system.states.index(system.place)
    smooth = savgol_filter(runs, WINDOW, 3, axis=1)
    rate = savgol_filter(runs, WINDOW, 3, deriv=1, delta=system.dt, axis=1)
    Z = smooth.reshape(-1, runs.shape[2])
    known = np.broadcast_to(np.asarray(system.rest(Z.T)[place]), len(Z))
    return Z, rate.reshape(Z.shape)[:, place] - known


def sparse(Z: np.ndarray, left: np.ndarray, bagged: bool) -> Iterator[Term]:
    """STLSQ on polynomials of degree three and sines, a model a threshold; bagged: the median of models of drawn rows."""
    import pysindy

    library = pysindy.PolynomialLibrary(degree=3) + pysindy.FourierLibrary(n_frequencies=1)
    features = np.asarray(library.fit_transform(Z))
    for threshold in THRESHOLDS:
        model = pysindy.STLSQ(threshold=threshold)
        if bagged:
            model = pysindy.EnsembleOptimizer(model, bagging=True, n_models=BAGS)
        coefficients = np.ravel(model.fit(features, left[:, None]).coef_)
        yield lambda z, coefficients=coefficients: np.asarray(library.transform(z)) @ coefficients


def symbolic(Z: np.ndarray, left: np.ndarray) -> Iterator[Term]:
    """Genetic programming with gplearn's own population, generations and penalty on length."""
    from gplearn.genetic import SymbolicRegressor

    functions = ("add", "sub", "mul", "div", "sin", "sqrt", "inv")
    yield SymbolicRegressor(function_set=functions, random_state=0).fit(Z, left).predict


def generic(Z: np.ndarray, left: np.ndarray) -> Iterator[Term]:
    """A generic correction: the package's own network of 20 nodes, its penalty by evidence."""
    from sksurrogate.neural import FNNRegressor

    yield FNNRegressor(20, alpha="evidence", random_state=0).fit(Z, left).predict


#: Name -> (states, residual) -> terms, one a setting.
PEERS: dict[str, Callable[[np.ndarray, np.ndarray], Iterator[Term]]] = {
    "STLSQ": lambda Z, left: sparse(Z, left, bagged=False),
    "STLSQ, bagged": lambda Z, left: sparse(Z, left, bagged=True),
    "gplearn": symbolic,
    "generic correction": generic,
}


def r2(found: np.ndarray, truth: np.ndarray) -> float:
    """Of a term along fresh runs."""
    spread = float(np.sum((truth - truth.mean()) ** 2))
    return 1.0 - float(np.sum((truth - found) ** 2)) / spread if np.isfinite(found).all() else -np.inf


def best_of(peer: str, Z: np.ndarray, left: np.ndarray, fresh: np.ndarray, truth: np.ndarray) -> float:
    """The best R2 over a peer's settings, along fresh states; nan where its package is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return max(r2(np.asarray(term(fresh)), truth) for term in PEERS[peer](Z, left))
    except ImportError:
        return float("nan")
