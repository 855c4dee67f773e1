"""A linearised set of effects: its likelihood from a Gram equals that of a least-squares fit."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.gap.fit._linear_set import LinearSet
from sksurrogate.gap.search._base import BaseSearch

PRECISION, PULL, LOGDET = np.array([0.5, 4.0]), np.array([1.0, -3.0]), 7.0


@pytest.fixture
def columns():
    """Residual, two sensitivities, three functions of 40 values."""
    rng = np.random.default_rng(0)
    return rng.normal(size=(6, 40))


def made(n=2, bounds=(-np.inf, np.inf)):
    low, high = (np.full(n, end) for end in bounds)
    base = SimpleNamespace(prior_square=2.0, fit=SimpleNamespace(theta=np.zeros(n)), effects=())
    base.problem = SimpleNamespace(bounds=lambda effects: (low, high))
    return LinearSet(np.zeros((1, 40)), np.zeros((1, n, 40)), PRECISION[:n], PULL[:n], base)


def least(r, J, precision, pull):
    """min |r - J theta|^2 + theta' P theta - 2 pull' theta, by rows that stand for the prior."""
    rows, targets = np.vstack([J.T, np.diag(np.sqrt(precision))]), np.r_[r, pull / np.sqrt(precision)]
    theta = np.linalg.lstsq(rows, targets, rcond=None)[0]
    return float(np.sum((targets - rows @ theta) ** 2) - np.sum(pull**2 / precision)), theta


def test_the_likelihood_at_the_best_parameters_is_that_of_least_squares(columns):
    G = columns @ columns.T
    cost, theta = least(columns[0], columns[1:3], PRECISION, PULL)
    wanted = -0.5 * (cost + LOGDET + 2.0)
    assert made().at_best(G, LOGDET) == pytest.approx(wanted)
    assert made().within_bounds(G[:3, :3], LOGDET) == pytest.approx(wanted)
    assert made(bounds=(theta - 1, theta + 1)).within_bounds(G[:3, :3], LOGDET) == pytest.approx(wanted)
    assert made(0).at_best(G[:1, :1], LOGDET) == made(0).within_bounds(G[:1, :1], LOGDET)
    assert made(0).at_best(G[:1, :1], LOGDET) == pytest.approx(-0.5 * (G[0, 0] + LOGDET + 2.0))


def test_a_parameter_at_its_bound_stays_there(columns):
    _, theta = least(columns[0], columns[1:3], PRECISION, PULL)
    low, high = np.array([theta[0] + 0.5, -np.inf]), np.full(2, np.inf)
    rest = columns[0] - low[0] * columns[1]
    cost, _ = least(rest, columns[2:3], PRECISION[1:], PULL[1:])
    wanted = -0.5 * (cost + PRECISION[0] * low[0] ** 2 - 2 * PULL[0] * low[0] + LOGDET + 2.0)
    found = made(bounds=(low, high)).within_bounds(columns[:3] @ columns[:3].T, LOGDET)
    assert found == pytest.approx(wanted)


def test_functions_beside_the_parameters_add_what_one_fit_of_all_gives(columns):
    H, g, power = made().beside_parameters(columns @ columns.T)
    alone, _ = least(columns[0], columns[1:3], PRECISION, PULL)
    assert power == pytest.approx(alone + 2.0)
    prior = np.array([1.0, 2.0, 0.25])
    together, theta = least(columns[0], columns[1:], np.r_[PRECISION, prior], np.r_[PULL, np.zeros(3)])
    weights = np.linalg.solve(H + np.diag(prior), g)
    np.testing.assert_allclose(weights, theta[2:])
    assert power - g @ weights == pytest.approx(together + 2.0)


@pytest.mark.parametrize(("cost", "wanted"), [(100.0, 100.0), (5000.0, 1600.0)])
def test_no_gap_counts_as_larger_than_what_the_outputs_do(cost, wanted):
    record = SimpleNamespace(counts=np.array([[60], [40]]), spread=np.array([[2.0]]))
    problem = SimpleNamespace(free=(), record=record, sd=np.array([[0.5]]))
    search = SimpleNamespace(
        fitted_null=SimpleNamespace(candidate="null"), problem=problem, nominal_costs={"null": cost}
    )
    assert BaseSearch.gap_cost.fget(search) == wanted
