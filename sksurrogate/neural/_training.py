"""From checked data to a trained network: scaling, the choice of solver, blocks that arrive one by one."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from sksurrogate.kernels.least_squares import merge_rows, with_memory
from sksurrogate.kernels.rows import RowSource
from sksurrogate.neural._network import Layers
from sksurrogate.neural._problems import JACOBIAN_ROWS, Rows
from sksurrogate.neural._settings import read_batch
from sksurrogate.neural._solvers import (
    Outcome,
    Plan,
    Validation,
    objective,
    train_above_steps,
    train_lbfgs,
    train_least_squares,
    train_linear,
)

#: Solvers that run in torch, through skorch, with their learning rates (paper, Table 2).
GRADIENT = {
    "gd": 0.01, "line_search": 1.0, "momentum": 0.01, "nesterov": 0.01, "adam": 0.001, "adamw": 0.001, "rmsprop": 0.01
}  # fmt: skip
#: Weights up to which ``solver="auto"`` takes Levenberg-Marquardt, and rows up to which it takes L-BFGS beyond.
SMALL_NET, FEW_ROWS = 300, 20_000
#: Weights up to which partial_fit remembers the rows before as a square matrix.
MEMORY = 2_000
#: Rows up to which rows that repeat are merged, so that weights and repetitions give the same bits.
TRAINING_MERGE_ROWS = 5_000
#: Scale of a column that never moved in training: later changes of it have no effect.
SCALE_OF_CONSTANTS = 1e12


@dataclass(frozen=True)
class Torch:
    """What only the solvers in torch ask for."""

    learning_rate: float | None
    batch_size: int | None
    dtype: str
    device: str
    loss: str
    options: dict[str, Any]


@dataclass
class Trained:
    """A network for standardised data, and what is needed to go on with further blocks of rows.

    ``n_fixed`` layers at the bottom are not trained; ``memory`` (theta, information) stands for the rows that
    Levenberg-Marquardt has seen; ``net`` is the skorch net of the solvers in torch, with their momenta.
    """

    outcome: Outcome
    n_fixed: int = 0
    memory: tuple[np.ndarray, np.ndarray] | None = None
    net: Any = field(default=None, repr=False)


def prepare(X: np.ndarray | RowSource, Y: np.ndarray, weights: np.ndarray | None, linear_output: bool) -> Rows:
    """Rows of weight zero left out, repeated ones merged, with the means and scales of inputs and outputs."""
    if weights is not None and not weights.all():
        kept = weights > 0
        X, Y, weights = X[kept], Y[kept], weights[kept]
    if len(X) <= TRAINING_MERGE_ROWS:
        X, Y, weights = merge_rows(X[:], Y, weights)
    mean, scale = _moments(X, weights, SCALE_OF_CONSTANTS)
    shift, gain = _moments(Y, weights, 1.0) if linear_output else (np.zeros(Y.shape[1]), np.ones(Y.shape[1]))
    return Rows(X, Y, weights, mean, scale, shift, gain)


def _moments(
    values: np.ndarray | RowSource, weights: np.ndarray | None, constant: float
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means and standard deviations of the columns, block by block; ``constant`` for columns that never move."""
    total = float(len(values)) if weights is None else float(weights.sum())
    mean, square = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    blocks = [slice(first, first + JACOBIAN_ROWS) for first in range(0, len(values), JACOBIAN_ROWS)]
    for block in blocks:
        mean += values[block].sum(axis=0) if weights is None else weights[block] @ values[block]
    mean /= total
    for block in blocks:
        away = (values[block] - mean) ** 2
        square += away.sum(axis=0) if weights is None else weights[block] @ away
    scale = np.sqrt(square / total)
    scale[~(scale > 1e-13 * np.abs(mean))] = constant
    return mean, scale


def split(rows: Rows, fraction: float, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Rows to train on and rows to validate on, drawn at random."""
    n_held = min(max(1, round(fraction * len(rows))), len(rows) - 1)
    order = rng.permutation(len(rows))
    return rows.take(np.sort(order[n_held:])), rows.take(np.sort(order[:n_held]))


def choose(solver: str, sizes: tuple[int, ...], n_rows: int) -> str:
    """The solver that "auto" stands for."""
    if solver != "auto":
        return solver
    n_weights = sum((n_in + 1) * n_out for n_in, n_out in zip(sizes[:-1], sizes[1:]))
    if n_weights <= SMALL_NET:
        return "lm"
    return "lbfgs" if n_rows <= FEW_ROWS else "adam"


def train(solver: str, plan: Plan, rows: Rows, validation: Validation | None, torch: Torch) -> Trained:
    """Train from random starts."""
    if "binary_step" in plan.activations:

        def above(rest: Plan, values: Rows, watch: Validation | None) -> Outcome:
            return train(solver, rest, values, watch, torch).outcome

        outcome = train_above_steps(plan, rows, validation, above)
        n_fixed = max(i for i, kind in enumerate(plan.activations) if kind == "binary_step") + 1
        return Trained(outcome, n_fixed)
    plain = rows.smooth is None and plan.prior is None
    if len(plan.sizes) == 2 and plan.activations == ("identity",) and solver in ("lm", "lbfgs") and plain:
        return Trained(train_linear(plan, rows, validation))
    if solver == "lm":
        return Trained(train_least_squares(plan, rows, validation))
    if solver == "lbfgs":
        return Trained(train_lbfgs(plan, rows, validation))
    runs = [_train_in_torch(solver, plan, start, rows, validation, torch) for start in plan.starts()]
    best = min(runs, key=lambda run: min(run.outcome.validation or run.outcome.curve[-1:]))
    if validation is not None:
        validation.curve = best.outcome.validation
    return best


def _train_in_torch(
    solver: str, plan: Plan, start: Layers, rows: Rows, validation: Validation | None, torch: Torch
) -> Trained:
    from sksurrogate.neural._torch import read_layers, train_net, write_layers

    net = _net(solver, plan, start, torch, 0, rows)
    x, y, weights = rows.part(slice(None))
    one = None if validation is None else validation.fresh()

    def after(net: Any) -> bool:
        if one is not None and one.stop(read_layers(net, plan.activations)):
            return True
        losses = [row["train_loss"] for row in net.history[-11:]]
        return plan.tol > 0 and len(losses) > 10 and abs(losses[0] - losses[-1]) < plan.tol * abs(losses[0])

    curve = train_net(net, x, y, weights, after)
    layers = read_layers(net, plan.activations)
    if one is not None and one.best is not None:
        layers = one.best
        write_layers(net, layers)
    outcome = Outcome(layers, curve, len(curve), one.curve if one else [], True)
    return Trained(outcome, net=net)


def _net(solver: str, plan: Plan, layers: Layers, torch: Torch, n_fixed: int, rows: Rows) -> Any:
    from sksurrogate.neural._torch import build_net

    smooth = rows.smooth
    return build_net(
        layers,
        solver=solver,
        dtype=torch.dtype,
        device=torch.device,
        alpha=plan.alpha,
        theta0=plan.prior,
        slope=0.0 if smooth is None else smooth.slope,
        curvature=0.0 if smooth is None else smooth.curvature,
        loss=torch.loss,
        learning_rate=torch.learning_rate or GRADIENT[solver],
        batch_size=read_batch(torch.batch_size, len(rows)),
        max_epochs=plan.max_iter,
        fixed=n_fixed,
        seed=int(plan.rng.integers(2**31)),
        options=torch.options,
    )


def train_more(solver: str, plan: Plan, rows: Rows, so_far: Trained, torch: Torch) -> Trained:
    """Go on with a further block of rows.

    The solvers in torch make one epoch over the block. The others keep what they have seen as a quadratic form around
    the weights (an extended Kalman filter in information form): each block is fitted together with it.
    """
    layers, k = so_far.outcome.layers, so_far.n_fixed
    if solver in GRADIENT:
        from sksurrogate.neural._torch import read_layers, train_net

        net = so_far.net if so_far.net is not None else _net(solver, plan, layers, torch, k, rows)
        net.set_params(max_epochs=1)
        curve = train_net(net, *rows.part(slice(None)))
        outcome = Outcome(read_layers(net, plan.activations), so_far.outcome.curve + curve, len(curve), [], True)
        return replace(so_far, outcome=outcome, net=net)
    block = rows.through(layers.below(k)) if k else rows
    top = layers.above(k)
    rest = replace(plan, sizes=plan.sizes[k:], activations=plan.activations[k:], alpha=0.0, prior=None)
    assert so_far.memory is not None
    found = train_least_squares(rest, block, start=top, memory=so_far.memory)
    curve = so_far.outcome.curve + found.curve
    outcome = replace(found, layers=layers.below(k).joined(found.layers), curve=curve)
    return replace(so_far, outcome=outcome, memory=remember(rest, block, found.layers, so_far.memory))


def remember(
    plan: Plan, rows: Rows, top: Layers, before: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The weights and the information about them that a block leaves, added to what was known before."""
    evaluate = objective(plan, top, rows)
    if before is not None:
        evaluate = with_memory(evaluate, *before)
    return top.theta, evaluate(top.theta)[2]


def memory_of(solver: str, trained: Trained, rows: Rows, plan: Plan) -> tuple[np.ndarray, np.ndarray] | None:
    """What partial_fit needs to know of the rows seen so far."""
    k, layers = trained.n_fixed, trained.outcome.layers
    if solver in GRADIENT or len(layers.theta) > MEMORY:
        return None
    rest = replace(plan, sizes=plan.sizes[k:], activations=plan.activations[k:])
    return remember(rest, rows.through(layers.below(k)) if k else rows, layers.above(k))


def warn_if_falling(curve: list[float], max_epochs: int | None) -> None:
    """Say so where the iterations ended on a slope."""
    if len(curve) > 20 and curve[-1] > 1e-6 and curve[-1] < 0.5 * curve[-21]:
        warnings.warn(
            f"The loss still fell from {curve[-21]:.3g} to {curve[-1]:.3g} in the last 20 steps: raise max_epochs "
            f"(now {max_epochs}, {len(curve) - 1} steps made).",
            ConvergenceWarning,
            stacklevel=4,
        )
