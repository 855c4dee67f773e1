"""The paper's plant, Eq. (9), as simulator and as a source of data."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq
from sklearn.utils import check_random_state

from sksurrogate.exceptions import DataError
from sksurrogate.physics import ODESimulator

#: Levels of the input of :func:`make_reactor_experiments`.
PAPER_LEVELS = (0.22, 0.12, 0.25, 0.08, 0.18, 0.05, 0.20, 0.10, 0.16, 0.14)


def reactor_rhs(t: Any, x: Any, u: Any, p: Any) -> list[Any]:
    """Eq. (9): ``dy/dt = 2 (4 - y) - 1e2 exp(-1/u) y^2 + 1e3 exp(-1/u) y``; y a concentration, u a scaled temperature.

    Parameters
    ----------
    t : float
    x : sequence of one float or ndarray
        y.
    u : sequence of one float or ndarray
    p : dict
        flow 2, feed 4, second 100, first 1000.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor, reactor_rhs
    >>> dydt = reactor_rhs(0.0, [4.0], [0.15], make_reactor().params)
    >>> round(float(dydt[0]), 3)
    3.054
    """
    rate = np.exp(-1.0 / u[0])
    return [p["flow"] * (p["feed"] - x[0]) - p["second"] * rate * x[0] ** 2 + p["first"] * rate * x[0]]


def linear_rhs(t: Any, x: Any, u: Any, p: Any) -> list[Any]:
    """Linearisation about a steady state: ``dy/dt = a (y - y0) + b (u - u0)``."""
    return [p["a"] * (x[0] - p["y0"]) + p["b"] * (u[0] - p["u0"])]


def make_reactor(dt: float = 0.02, **params: float) -> ODESimulator:
    """Simulator of the paper's plant, Eq. (9).

    Parameters
    ----------
    dt : float, default=0.02
        Sample time.
    **params : float
        Other values of ``flow`` (2), ``feed`` (4), ``second`` (1e2), ``first`` (1e3).

    Returns
    -------
    ODESimulator
        State and output "y", input "u".

    Examples
    --------
    >>> import numpy as np
    >>> make_reactor().simulate(np.full((3, 1), 0.15), x0=[15.0]).round(3).ravel()
    array([15.   , 14.397, 13.844])
    """
    nominal = {"flow": 2.0, "feed": 4.0, "second": 1e2, "first": 1e3}
    return ODESimulator(
        reactor_rhs, states=["y"], inputs=["u"], outputs=["y"], params={**nominal, **params}, dt=dt, x0=[4.0]
    )


def linear_reactor(u0: float = 0.15, dt: float = 0.02) -> ODESimulator:
    """The linear approximation of Eq. (9) at the steady state of ``u0`` (paper section 4.4, Figure 8).

    Parameters
    ----------
    u0 : float, default=0.15
    dt : float, default=0.02

    Returns
    -------
    ODESimulator

    Examples
    --------
    >>> round(linear_reactor().params["y0"], 4)
    5.5701
    """
    rate = np.exp(-1.0 / u0)
    y0 = brentq(lambda y: 2 * (4 - y) - 1e2 * rate * y**2 + 1e3 * rate * y, 0.0, 50.0)
    slope = rate / u0**2
    params = {
        "a": -2.0 - 2e2 * rate * y0 + 1e3 * rate,
        "b": -1e2 * slope * y0**2 + 1e3 * slope * y0,
        "y0": float(y0),
        "u0": u0,
    }
    return ODESimulator(linear_rhs, states=["y"], inputs=["u"], outputs=["y"], params=params, dt=dt, x0=[float(y0)])


def reactor_inputs(rng: np.random.RandomState, n_samples: int, low: float, high: float) -> np.ndarray:
    """Levels held 10 to 40 samples, lightly smoothed, (n_samples,)."""
    levels: list[np.ndarray] = []
    while sum(map(len, levels)) < n_samples + 8:
        levels.append(np.full(rng.randint(10, 41), rng.uniform(low, high)))
    return np.convolve(np.concatenate(levels), np.full(5, 0.2), mode="valid")[:n_samples]


def make_reactor_runs(
    n_runs: int = 8,
    n_samples: int = 200,
    *,
    u_range: tuple[float, float] = (0.05, 0.25),
    y0_range: tuple[float, float] = (0.5, 15.0),
    noise: float = 0.0,
    dt: float = 0.02,
    return_derivative: bool = False,
    random_state: Any = None,
) -> tuple[np.ndarray, ...]:
    """Experiments with the paper's plant: many initial states over a varying input (paper section 4.2).

    Parameters
    ----------
    n_runs, n_samples : int, default=8, 200
    u_range : (float, float), default=(0.05, 0.25)
        Range of the input; above 0.3 the plant is stiff for this dt.
    y0_range : (float, float), default=(0.5, 15)
        Initial states are spread over it; the last run starts at its upper end.
    noise : float, default=0
        Standard deviation of white measurement noise, units of y.
    dt : float, default=0.02
    return_derivative : bool, default=False
        Whether dy/dt is returned too.
    random_state : int, RandomState or None

    Returns
    -------
    X : ndarray (n_runs * n_samples, 1)
    y : ndarray (n_runs * n_samples,)
    groups : ndarray of int (n_runs * n_samples,)
    dydt : ndarray, with ``return_derivative``

    Examples
    --------
    >>> X, y, groups = make_reactor_runs(2, 5, random_state=0)
    >>> X.shape, y.shape, groups.tolist()
    ((10, 1), (10,), [0, 0, 0, 0, 0, 1, 1, 1, 1, 1])
    """
    for name, count in (("n_runs", n_runs), ("n_samples", n_samples)):
        if not isinstance(count, (int, np.integer)) or count < 1:
            raise DataError(f"{name}={count!r} must be an int of at least 1.")
    for name, pair, least in (("u_range", u_range, 0.0), ("y0_range", y0_range, -np.inf)):
        if np.shape(pair) != (2,) or not least < pair[0] <= pair[1] < np.inf:
            above = "" if least else ", above 0"
            raise DataError(f"{name}={pair!r} must be two numbers{above}, low before high.")
    if not noise >= 0:
        raise DataError(f"noise={noise!r} must be a standard deviation, at least 0.")
    rng = check_random_state(random_state)
    plant = make_reactor(dt)
    U = np.stack([reactor_inputs(rng, n_samples, *u_range) for _ in range(n_runs)])[:, :, None]
    start = rng.uniform(*y0_range, n_runs)
    start[-1] = y0_range[1]
    Y = plant.simulate_batch(U, start[:, None])
    X, clean = U.reshape(-1, 1), Y.reshape(-1)
    y = clean + noise * rng.normal(size=clean.shape)
    groups = np.repeat(np.arange(n_runs), n_samples)
    if not return_derivative:
        return X, y, groups
    return X, y, groups, np.asarray(reactor_rhs(0.0, [clean], [X[:, 0]], plant.params)[0])


def make_reactor_experiments(
    y0: Any = (15.0, 12.0, 9.0, 7.0, 5.0, 3.0, 1.5, 0.5),
    n_samples: int = 100,
    *,
    noise: float = 0.0,
    dt: float = 0.02,
    random_state: Any = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Experiments in the manner of the paper's Figures 3 and 4: one input, runs from many y(0).

    Parameters
    ----------
    y0 : sequence of float, optional
        Initial state of each run; by default eight from 15 down to 0.5.
    n_samples : int, default=100
        Rows of a run; the input goes through ten held levels between 0.05 and 0.25.
    noise : float, default=0
        Standard deviation of white measurement noise, units of y.
    dt : float, default=0.02
    random_state : int, RandomState or None

    Returns
    -------
    X : ndarray (n_runs * n_samples, 1)
    y : ndarray (n_runs * n_samples,)
    groups : ndarray of int (n_runs * n_samples,)
    dydt : ndarray (n_runs * n_samples,)
        The plant's own derivatives, without noise.

    Examples
    --------
    >>> X, y, groups, dydt = make_reactor_experiments(n_samples=50)
    >>> y[:3].round(2)
    array([15.  , 13.36, 12.25])
    """
    rng = check_random_state(random_state)
    plant, start = make_reactor(dt), np.atleast_1d(np.asarray(y0, dtype=float))
    levels = np.asarray(PAPER_LEVELS)[np.arange(n_samples) * len(PAPER_LEVELS) // n_samples]
    U = np.repeat(levels[None, :, None], len(start), axis=0)
    X, clean = U.reshape(-1, 1), plant.simulate_batch(U, start[:, None]).reshape(-1)
    dydt = np.asarray(reactor_rhs(0.0, [clean], [X[:, 0]], plant.params)[0])
    return X, clean + noise * rng.normal(size=clean.shape), np.repeat(np.arange(len(start)), n_samples), dydt
