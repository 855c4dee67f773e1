"""How a network is trained without torch: least squares by Levenberg-Marquardt, L-BFGS, drawn step layers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from sksurrogate.kernels.least_squares import (
    Evaluate,
    LeastSquaresFit,
    levenberg_marquardt,
    several_starts,
    with_memory,
)
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.neural._network import Layers, draw_layers
from sksurrogate.neural._problems import JACOBIAN_ROWS, Rows, normal_equations, projected, squares

#: Rows up to which variable projection holds the whole Jacobian.
WHOLE_JACOBIAN_ROWS = 20_000
#: Rows of the subsample on which a larger set is searched from several starts.
START_SUBSAMPLE = 5_000
#: Share of the variance at which a start counts as solved, and at which a search ends.
NET_SOLVED, NET_FLOOR = 1e-12, 1e-24


@dataclass(frozen=True)
class Plan:
    """What to train and how long."""

    sizes: tuple[int, ...]  #: Inputs, hidden units, outputs
    activations: tuple[str, ...]  #: One for each layer, the output layer included
    alpha: float  #: Weight of the sum of squared weights beside the mean squared error
    n_starts: int
    max_iter: int
    tol: float
    rng: np.random.Generator
    #: (n_theta,): weights and biases from which ``alpha`` counts, and at which the first start stands
    prior: np.ndarray | None = None

    def draw(self) -> Layers:
        """Random layers."""
        return draw_layers(self.sizes, self.activations, self.rng)

    def starts(self) -> Iterator[Layers]:
        """Layers to begin from: the prior, then random ones."""
        for k in range(self.n_starts):
            drawn = self.draw()
            yield drawn if k or self.prior is None else drawn.at(self.prior)


@dataclass(frozen=True)
class Outcome:
    """A trained network."""

    layers: Layers  #: For standardised inputs and outputs
    curve: list[float]  #: Penalised mean squared error, step by step (of the best start)
    n_iter: int
    validation: list[float]  #: Mean squared error on the validation rows, step by step
    settled: bool  #: False where the iterations were used up


def misfit(layers: Layers, rows: Rows) -> float:
    """Mean squared error (summed over outputs) of standardised rows."""
    cost = 0.0
    for first in range(0, len(rows), JACOBIAN_ROWS):
        x, y, weights = rows.part(slice(first, first + JACOBIAN_ROWS))
        square = np.sum((layers(x) - y) ** 2, axis=1)
        cost += float(square.sum() if weights is None else weights @ square)
    return cost / rows.total


class Validation:
    """Keeps the network of least validation loss and tells when to stop.

    ``rows``: None: nothing is validated, only the listener is asked.
    ``patience``: steps without a better one after which it is enough.
    ``listener``: layers -> whether to stop; asked after every step.
    """

    def __init__(self, rows: Rows | None, patience: int = 1, listener: Callable[[Layers], bool] | None = None):
        self.rows, self.patience, self.listener = rows, patience, listener
        self.curve: list[float] = []
        self.best: Layers | None = None

    def stop(self, layers: Layers) -> bool:
        """Note one step; True when it is time to stop."""
        enough = self.listener is not None and bool(self.listener(layers))
        if self.rows is None:
            return enough
        loss = misfit(layers, self.rows)
        if self.best is None or loss < min(self.curve):
            self.best = layers
        self.curve.append(loss)
        return enough or len(self.curve) - 1 - int(np.argmin(self.curve)) >= self.patience

    def fresh(self) -> Validation:
        """The same for another start."""
        return Validation(self.rows, self.patience, self.listener)

    def above(self, fixed: Layers) -> Validation:
        """The same for what stands above layers that are not trained."""
        listener = self.listener
        rows = None if self.rows is None else self.rows.through(fixed)
        return Validation(
            rows, self.patience, None if listener is None else lambda layers: listener(fixed.joined(layers))
        )

    def watch(self, layers: Callable[[np.ndarray], Layers]) -> Callable[[LeastSquaresFit], bool]:
        """The same as a watch of a least-squares search."""
        return lambda fit: self.stop(layers(fit.theta))


def objective(plan: Plan, template: Layers, rows: Rows) -> Evaluate:
    """Squares over all layers with the ridge, to zero (weights only) or to the prior (weights and biases)."""
    ridge = plan.alpha * rows.total
    if plan.prior is None:
        return normal_equations(template, rows, ridge)
    return with_memory(normal_equations(template, rows), plan.prior, ridge * np.eye(len(plan.prior)))


@dataclass(frozen=True)
class _Search:
    """One least-squares problem: its evaluations, its starts, and the way back to layers."""

    evaluate: Evaluate
    starts: Iterator[np.ndarray]
    layers: Callable[[np.ndarray], Layers]
    total: float
    n_outputs: int


def _projected_search(plan: Plan, rows: Rows) -> _Search:
    """Over the hidden layers; the output layer is solved for."""
    x, y, weights = rows.part(slice(None))
    template = plan.draw()
    n_hidden = len(plan.sizes) - 2
    problem = projected(template, x, y, weights, plan.alpha * rows.total, rows.smooth)

    def whole(omega: np.ndarray) -> Layers:
        theta = problem.solve(omega)
        top = Layers((theta[:-1],), (theta[-1],), plan.activations[-1:])
        return template.below(n_hidden).at(omega).joined(top)

    starts = (plan.draw().below(n_hidden).theta for _ in range(plan.n_starts))
    return _Search(problem, starts, whole, rows.total, plan.sizes[-1])


def _full_search(plan: Plan, rows: Rows) -> _Search:
    """Over all layers at once."""
    template = plan.draw()
    starts = (start.theta for start in plan.starts())
    return _Search(objective(plan, template, rows), starts, template.at, rows.total, plan.sizes[-1])


def _search(plan: Plan, rows: Rows) -> _Search:
    """Variable projection where the output layer is linear and well determined."""
    linear_on_top = plan.activations[-1] == "identity" and len(plan.sizes) > 2
    if linear_on_top and plan.prior is None and len(rows) > plan.sizes[-2] + 1:
        return _projected_search(plan, rows)
    return _full_search(plan, rows)


def _watched(plan: Plan, search: _Search, validation: Validation) -> tuple[LeastSquaresFit, Layers]:
    """Every start with its own early stopping; the one of least validation loss."""
    best: tuple[LeastSquaresFit, Layers] | None = None
    trail: list[float] = []
    for start in search.starts:
        one = validation.fresh()
        fit = levenberg_marquardt(search.evaluate, start, max_iter=plan.max_iter, watch=one.watch(search.layers))
        if one.best is not None and (not trail or min(one.curve) < min(trail)):
            best, trail = (fit, one.best), one.curve
        elif best is None:
            best = (fit, search.layers(fit.theta))
    validation.curve = trail
    assert best is not None
    return best


def _best_of(plan: Plan, search: _Search, listener: Validation | None) -> LeastSquaresFit:
    """Every start a little, the best one to its end."""
    watch = None if listener is None else listener.watch(search.layers)
    unit = search.total * search.n_outputs
    first = min(60, plan.max_iter)
    solved, floor = NET_SOLVED * unit, NET_FLOOR * unit
    return several_starts(
        search.evaluate, search.starts, first=first, max_iter=plan.max_iter, solved=solved, floor=floor, watch=watch
    )[0]


def _outcome(plan: Plan, rows: Rows, validation: Validation | None) -> Outcome:
    """Several starts on all rows given."""
    search = _search(plan, rows)
    if validation is not None and validation.rows is not None:
        fit, layers = _watched(plan, search, validation)
    else:
        fit = _best_of(plan, search, validation)
        if not np.isfinite(fit.cost):  # no start with a basis of full rank: repeated rows, constant inputs
            search = _full_search(plan, rows)
            fit = _best_of(plan, search, validation)
        layers = search.layers(fit.theta)
    curve = [cost / search.total for cost in fit.history]
    return Outcome(layers, curve, fit.n_iter, validation.curve if validation else [], fit.done)


def train_least_squares(
    plan: Plan,
    rows: Rows,
    validation: Validation | None = None,
    *,
    start: Layers | None = None,
    memory: tuple[np.ndarray, np.ndarray] | None = None,
) -> Outcome:
    """Levenberg-Marquardt and variable projection.

    Sets of more than 20000 rows are searched from several starts on a subsample; from the best one, all rows are then
    used, the normal equations added up in blocks.

    ``start``: go on from here: no other starts.
    ``memory``: a quadratic form that stands for rows seen before.
    """
    if start is None and len(rows) <= WHOLE_JACOBIAN_ROWS:
        return _outcome(plan, rows, validation)
    curve: list[float] = []
    if start is None:
        sample = rows.take(np.sort(plan.rng.choice(len(rows), START_SUBSAMPLE, replace=False)))
        first = _outcome(plan, sample, None)
        start, curve = first.layers, first.curve
    template = start
    evaluate = objective(plan, template, rows)
    if memory is not None:
        evaluate = with_memory(evaluate, *memory)
    fit = levenberg_marquardt(
        evaluate,
        template.theta,
        max_iter=plan.max_iter if memory is not None else min(plan.max_iter, 15),
        floor=NET_FLOOR * rows.total,
        window=4,
        least_gain=0.01,
        watch=None if validation is None else validation.watch(template.at),
    )
    layers = template.at(fit.theta)
    if validation is not None and validation.best is not None:
        layers = validation.best
    curve = curve + [cost / rows.total for cost in fit.history]
    return Outcome(layers, curve, fit.n_iter, validation.curve if validation else [], fit.done)


def train_linear(plan: Plan, rows: Rows, validation: Validation | None = None) -> Outcome:
    """The one layer left by plain least squares of minimum norm (with the ridge of ``alpha``)."""
    x, y, weights = rows.part(slice(None))
    root = np.ones((len(x), 1)) if weights is None else np.sqrt(weights)[:, None]
    mean = np.average(x, axis=0, weights=weights)
    level = np.average(y, axis=0, weights=weights)
    matrix, target = (x - mean) * root, (y - level) * root
    if plan.alpha:
        matrix = np.vstack([matrix, np.sqrt(plan.alpha * rows.total) * np.eye(x.shape[1])])
        target = np.vstack([target, np.zeros((x.shape[1], y.shape[1]))])
    theta = linear_least_squares(matrix, target)
    layers = Layers((theta,), (level - mean @ theta,), ("identity",))
    cost = misfit(layers, rows) + plan.alpha * float(np.sum(theta**2))
    if validation is not None:  # one step: nothing to stop, but something to see
        validation.stop(layers)
    return Outcome(layers, [cost], 1, validation.curve if validation else [], True)


def _follow(curve: list[float], validation: Validation | None, layers: Layers) -> Callable:
    """A callback for scipy that notes the loss and stops early."""

    def after(intermediate_result) -> None:
        curve.append(float(intermediate_result.fun))
        if validation is not None and validation.stop(layers.at(intermediate_result.x.copy())):
            raise StopIteration

    return after


def train_lbfgs(plan: Plan, rows: Rows, validation: Validation | None) -> Outcome:
    """Quasi-Newton with line search (SciPy's L-BFGS-B) on back-propagated gradients: Bishop's way."""
    best: Outcome | None = None
    score = np.inf
    for template in plan.starts():
        evaluate = squares(template, rows, plan.alpha * rows.total, plan.prior)
        one = None if validation is None else validation.fresh()
        curve: list[float] = []

        def mean_square(theta, evaluate=evaluate) -> tuple[float, np.ndarray]:
            cost, gradient = evaluate(theta)
            return cost / rows.total, gradient / rows.total

        options = {"maxiter": plan.max_iter, "maxfun": 15 * plan.max_iter, "ftol": 64 * np.finfo(float).eps}
        options["gtol"] = plan.tol
        found = minimize(
            mean_square,
            template.theta,
            jac=True,
            method="L-BFGS-B",
            callback=_follow(curve, one, template),
            options=options,
        )
        layers = template.at(found.x)
        value = float(found.fun)
        if one is not None and one.best is not None:
            layers, value = one.best, min(one.curve)
        if value < score or best is None:
            settled = bool(found.status != 1)
            best, score = Outcome(layers, curve, int(found.nit), one.curve if one else [], settled), value
    assert best is not None
    return best


def draw_steps(plan: Plan, rows: Rows) -> Layers:
    """Layers up to the last binary step, drawn and not trained: the slope of a step is zero everywhere.

    Units look in random directions (one input: along it); their thresholds stand at equal quantiles of what arrives.
    """
    n_fixed = max(i for i, kind in enumerate(plan.activations) if kind == "binary_step") + 1
    weights, biases = [], []
    value = rows.part(slice(None))[0]
    for n_in, n_out, kind in zip(plan.sizes[:n_fixed], plan.sizes[1:], plan.activations):
        w = plan.rng.normal(size=(n_in, n_out))
        w /= np.linalg.norm(w, axis=0)
        if n_in == 1:
            w = np.ones((1, n_out))
        shares = (np.arange(n_out) + 0.5) / n_out
        along = value @ w
        b = -np.array([np.quantile(along[:, j], share) for j, share in enumerate(shares)])
        weights.append(w)
        biases.append(b)
        value = Layers((w,), (b,), (kind,))(value)
    return Layers(tuple(weights), tuple(biases), plan.activations[:n_fixed])


def train_above_steps(
    plan: Plan, rows: Rows, validation: Validation | None, train: Callable[[Plan, Rows, Validation | None], Outcome]
) -> Outcome:
    """Draw the step layers, train what stands above them; the best of several draws."""
    best: Outcome | None = None
    for _ in range(1 if plan.sizes[0] == 1 else plan.n_starts):
        fixed = draw_steps(plan, rows)
        n_fixed = len(fixed.weights)
        rest = replace(plan, sizes=plan.sizes[n_fixed:], activations=plan.activations[n_fixed:], n_starts=1)
        found = train(rest, rows.through(fixed), None if validation is None else validation.above(fixed))
        found = replace(found, layers=fixed.joined(found.layers))
        if best is None or min(found.validation or found.curve[-1:]) < min(best.validation or best.curve[-1:]):
            best = found
    assert best is not None
    return best
