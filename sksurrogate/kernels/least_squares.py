"""Nonlinear least squares: Levenberg-Marquardt, variable projection, several starts.

A problem is a function ``evaluate(theta)`` that returns the sum of squares ``r'r``, ``J'r`` and ``J'J`` of its residual
``r(theta)``; it may add them up over blocks of rows, so that the Jacobian of a large data set is never whole in memory.
A value that is not finite says that theta is not admissible, and the step is taken back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.lapack import dposv

from sksurrogate.kernels.clock import check_time

#: theta -> (r'r, J'r, J'J). A problem may also have ``probe``: theta -> (r'r, a function that gives J'r and J'J), so that
#: steps taken back cost no slopes.
Evaluate = Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]]
#: () -> (J'r, J'J).
Slopes = Callable[[], tuple[np.ndarray, np.ndarray]]

#: Steps over which the descent is measured before a search counts as settled.
SETTLING_WINDOW = 20
#: Part of the column scale that is kept from step to step: between Marquardt's (0) and More's (1) choice. Weights that
#: run away (a step function) want a short memory, valleys a long one; 0.8 was best over Bishop's four functions.
SCALE_MEMORY = 0.8
#: A start is left when so many times its rate of descent over so many steps will not do, or changes the cost by so little
#: (the logarithm). On 16 problems and 24 seeds: three quarters of the evaluations, no larger cost (0.98, geometric mean).
HOPE, LOOK_BACK, HARDLY_CHANGED = 2.0, 6, 0.26


@dataclass
class LeastSquaresFit:
    """Where a search stands; it can be continued."""

    theta: np.ndarray  #: (n_theta,)
    cost: float  #: Sum of squares r'r
    #: gradient, gram: J'r (n_theta,) and J'J (n_theta, n_theta) at ``theta``
    gradient: np.ndarray
    gram: np.ndarray
    damping: float = 1e-2
    scale: np.ndarray = field(default_factory=lambda: np.zeros(1))
    n_iter: int = 1  #: Evaluations since the start, steps taken back included
    history: list[float] = field(default_factory=list)  #: Cost at the start and after every accepted step
    done: bool = False  #: Nothing more to gain: the floor is reached, the descent has settled, or no step helps
    message: str = "the number of iterations is used up"  #: Why the search ended, in words


def begin(evaluate: Evaluate, theta: np.ndarray) -> LeastSquaresFit:
    """A search at its start."""
    cost, gradient, gram = evaluate(theta)
    fit = LeastSquaresFit(theta, cost, gradient, gram, history=[cost])
    if not np.isfinite(cost):
        fit.cost, fit.done, fit.message = np.inf, True, "the start is not admissible"
    return fit


def levenberg_marquardt(
    evaluate: Evaluate,
    start: np.ndarray | LeastSquaresFit,
    *,
    max_iter: int = 200,
    floor: float = 0.0,
    window: int = SETTLING_WINDOW,
    least_gain: float = 5e-3,
    watch: Callable[[LeastSquaresFit], bool] | None = None,
    pause: Callable[[LeastSquaresFit], bool] | None = None,
) -> LeastSquaresFit:
    """Minimise a sum of squares by Levenberg-Marquardt, the damping steered by the gain ratio (Nielsen 1999).

    Each step solves ``(J'J + damping * diag(scale)) step = -J'r``.

    ``evaluate``: theta -> (r'r, J'r, J'J).
    ``start`` ndarray (n_theta,) or LeastSquaresFit: where to begin, or the search to go on with (it is changed in
        place).
    ``max_iter``: evaluations to spend.
    ``floor``: cost at which the search ends.
    ``window, least_gain``: the search has settled when the last ``window`` accepted steps lowered the cost by less than
        this share.
    ``watch``: called after each accepted step; True ends the search (early stopping).
    ``pause``: the same; True leaves the search as it is, to be continued or not.

    See K. Madsen, H. B. Nielsen, O. Tingleff, *Methods for non-linear least squares problems*, 2004, section 3.2.

    >>> import numpy as np
    >>> from sksurrogate.kernels.least_squares import dense, levenberg_marquardt
    >>> rosenbrock = dense(lambda t: (np.array([10 * (t[1] - t[0] ** 2), 1 - t[0]]),
    ...                               np.array([[-20 * t[0], 10.0], [-1.0, 0.0]])))
    >>> levenberg_marquardt(rosenbrock, np.array([-1.2, 1.0]), floor=1e-24).theta.round(6)
    array([1., 1.])
    """
    fit = start if isinstance(start, LeastSquaresFit) else begin(evaluate, np.asarray(start, dtype=float))
    last = fit.n_iter + max_iter
    while fit.n_iter < last and not fit.done:
        check_time()
        if fit.cost <= floor:
            return _end(fit, "the sum of squares reached its floor")
        if not _descend(evaluate, fit, last):
            break
        if watch is not None and watch(fit):
            return _end(fit, "stopped: the validation loss no longer falls, or a callback wants it")
        if len(fit.history) > window and fit.history[-1] > fit.history[-1 - window] * (1.0 - least_gain):
            return _end(fit, "the sum of squares has settled")
        if pause is not None and pause(fit):
            break
    if not fit.done and fit.cost <= floor:
        return _end(fit, "the sum of squares reached its floor")
    return fit


def _end(fit: LeastSquaresFit, message: str) -> LeastSquaresFit:
    fit.done, fit.message = True, message
    return fit


def _descend(evaluate: Evaluate, fit: LeastSquaresFit, last: int) -> bool:
    """One accepted step, with as many trials as that takes; False where none helps."""
    fit.scale = np.maximum(fit.scale * SCALE_MEMORY + 1e-250, fit.gram.diagonal())
    growth, downhill = 2.0, -fit.gradient
    probe = getattr(evaluate, "probe", None)
    while fit.n_iter < last:
        damping = fit.damping * fit.scale
        matrix = fit.gram.copy()
        matrix.ravel()[:: len(damping) + 1] += damping
        _, step, info = dposv(matrix.T, downhill, overwrite_a=1)
        if info == 0:
            fit.n_iter += 1
            theta = fit.theta + step
            if probe is None:
                cost, gradient, gram = evaluate(theta)
            else:
                cost, slopes = probe(theta)
            # gain predicted by the quadratic model: s'(damping s - J'r)
            damping *= step
            damping += downhill
            ratio = (fit.cost - cost) / max(float(np.dot(step, damping)), 1e-300)
            if ratio > 1e-4 and math.isfinite(cost):
                if probe is not None:
                    gradient, gram = slopes()
                fit.theta, fit.cost, fit.gradient, fit.gram = theta, cost, gradient, gram
                fit.damping = max(fit.damping * max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3), 1e-15)
                fit.history.append(cost)
                return True
        fit.damping *= growth
        growth *= 2.0
        if fit.damping > 1e10:
            _end(fit, "no step lowers the sum of squares any more")
            return False
    return False


def several_starts(
    evaluate: Evaluate,
    starts: Iterable[np.ndarray],
    *,
    first: int = 60,
    max_iter: int = 200,
    solved: float = 0.0,
    floor: float = 0.0,
    watch: Callable[[LeastSquaresFit], bool] | None = None,
) -> tuple[LeastSquaresFit, list[float]]:
    """Search from several starts a little, then from the best one on: the cure for local minima.

    A start is left early where twice its present rate of descent would not bring it to the best one, nor matter by itself.

    ``evaluate``: theta -> (r'r, J'r, J'J).
    ``starts`` iterable of (n_theta,).
    ``first``: evaluations from each start.
    ``max_iter``: further evaluations from the best one.
    ``solved``: a cost so small that no other start is tried, and only a fast descent goes on.
    ``floor``: cost at which a search ends.
    ``watch``: as in :func:`levenberg_marquardt`, for the search from the best start.
    Returns ``fit``.
    Returns ``costs``: cost after the first evaluations from every start tried.
    """
    best: LeastSquaresFit | None = None
    costs, spent = [], 0
    for start in starts:
        pause = _hopeless(first, np.inf if best is None else best.cost)
        fit = levenberg_marquardt(evaluate, start, max_iter=first, floor=floor, pause=pause)
        costs.append(fit.cost)
        spent += fit.n_iter
        if best is None or fit.cost < best.cost:
            best = fit
        if best.cost <= solved:
            break
    if best is None:
        raise ValueError("starts is empty: give at least one start.")
    spent -= best.n_iter
    if best.cost <= solved:
        levenberg_marquardt(evaluate, best, max_iter=max_iter, floor=floor, window=8, least_gain=0.6, watch=watch)
    else:
        levenberg_marquardt(evaluate, best, max_iter=max_iter, floor=floor, watch=watch)
    best.n_iter += spent
    return best, costs


def _hopeless(first: int, best: float) -> Callable[[LeastSquaresFit], bool]:
    """Whether the evaluations that are left, at ``HOPE`` times the rate of the last steps, lead to nothing."""
    goal = math.log(best) if best > 0 else -math.inf

    def hopeless(fit: LeastSquaresFit) -> bool:
        if fit.n_iter < 2 * LOOK_BACK or len(fit.history) <= LOOK_BACK or fit.cost <= 0:
            return False
        rate = math.log(fit.history[-1 - LOOK_BACK] / fit.cost) / LOOK_BACK
        hope = HOPE * rate * (first - fit.n_iter)
        return hope < HARDLY_CHANGED or math.log(fit.cost) - hope > goal

    return hopeless


def dense(residual: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Evaluate:
    """A problem from a function ``theta -> (r (n_rows,), J (n_rows, n_theta))``."""

    def evaluate(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        r, jacobian = residual(theta)
        return float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

    return evaluate


def with_memory(evaluate: Evaluate, mean: np.ndarray, information: np.ndarray) -> Evaluate:
    """Add ``(theta - mean)' information (theta - mean)``: a ridge to a prior, or rows that were seen before."""

    def remembered(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        cost, gradient, gram = evaluate(theta)
        pull = information @ (theta - mean)
        return cost + float((theta - mean) @ pull), gradient + pull, gram + information

    return remembered


def merge_rows(
    X: np.ndarray, Y: np.ndarray, weights: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Rows in a fixed order, repeated ones once with the sum of their weights (None where all are 1).

    A search that is bent by rounding then takes the same path for integer weights and for repeated rows.

    >>> import numpy as np
    >>> merge_rows(np.array([[2.0], [1.0], [2.0]]), np.zeros((3, 1)), None)[2]
    array([1., 2.])
    """
    both = np.hstack([X, Y])
    order = np.lexsort(both.T)
    both = both[order]
    first = np.flatnonzero(np.append(True, np.any(both[1:] != both[:-1], axis=1)))
    given = np.ones(len(X)) if weights is None else weights[order]
    summed = np.add.reduceat(given, first)
    return both[first, : X.shape[1]], both[first, X.shape[1] :], None if np.all(summed == 1.0) else summed
