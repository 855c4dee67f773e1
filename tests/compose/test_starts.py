"""Initial states from the first rows: exact for exact rows, left alone where the simulator's own are right."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._starts import Starts, fitted_starts
from sksurrogate.physics import ODESimulator


def oscillator(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - 0.2 * x[1]


def plant(k=1.0):
    return ODESimulator(oscillator, states=["q", "v"], inputs=["f"], outputs=["q"], params={"k": k}, dt=0.1)


def record(speeds, n=120, seed=0, k=1.0, noise=0.0):
    """Runs that start at these speeds, which no sensor shows."""
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.normal(size=n // 10), 10)[:, None] for _ in speeds]
    y = [plant(k).simulate(u, x0=[rng.normal(), v]) for u, v in zip(U, speeds)]
    return U, [part + noise * rng.normal(size=part.shape) for part in y]


def test_exact_rows_show_the_unmeasured_speed():
    U, y = record([-3.0, 0.5, 2.0])
    starts = Starts(np.array([1e-4, 5.0]), np.array([1e-4]))
    found = starts(plant(), U, [part[:5] for part in y])
    np.testing.assert_allclose([x0[1] for x0 in found], [-3.0, 0.5, 2.0], atol=5e-3)


def test_the_likeliest_start_is_that_of_the_normal_equations():
    """Linear plant: the most probable state is the posterior mean, found here from its matrices."""
    U, y = record([1.5], noise=0.05)
    starts = Starts(np.array([0.05, 2.0]), np.array([0.05]))
    first = y[0][:6]
    found = starts(plant(), U, [first])[0]
    mean = np.array([first[0, 0], 0.0])
    base = plant().simulate(U[0][:6], x0=mean)[:, 0]
    J = np.stack([plant().simulate(U[0][:6], x0=mean + np.eye(2)[i])[:, 0] - base for i in range(2)], axis=1)
    precision = np.diag(1.0 / starts.prior**2)
    expected = mean + np.linalg.solve(J.T @ J / 0.05**2 + precision, J.T @ (first[:, 0] - base) / 0.05**2)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_runs_that_start_as_the_simulator_does_keep_its_start():
    U, y = record(np.zeros(6), noise=0.02)
    assert fitted_starts(plant(), U, y, 5) is None


def test_a_correction_does_not_learn_initial_states():
    """The simulator is right but for the speeds at the start of the training runs; test runs start at rest."""
    U, y = record([3.0, -2.0, 2.5, -3.0, 1.5, 2.0], noise=0.01)
    groups = np.repeat(np.arange(6), 120)
    hybrid = HybridRegressor(plant(), LinearRegression(), "static").fit(
        np.concatenate(U), np.concatenate(y)[:, 0], groups
    )
    assert hybrid.correction_.starts is not None
    V, z = record([0.0], seed=5, noise=0.01)
    predicted = hybrid.predict(V[0], y0=z[0][:5])
    assert np.std(predicted - z[0][:, 0]) < 0.05
    moving, w = record([2.5], seed=6, noise=0.01)
    alone = plant().simulate(moving[0], x0=[w[0][0, 0], 0.0])[:, 0]
    assert np.std(hybrid.predict(moving[0], y0=w[0][:5]) - w[0][:, 0]) < 0.2 * np.std(alone - w[0][:, 0])


@pytest.mark.slow
@pytest.mark.parametrize("speeds", [[2.0, -2.0, 3.0, -1.5]])
def test_the_graph_begins_where_the_prediction_does(speeds):
    U, y = record(speeds, k=1.3, noise=0.01)
    groups = np.repeat(np.arange(4), 120)
    hybrid = HybridRegressor(plant()).fit(np.concatenate(U), np.concatenate(y)[:, 0], groups=groups)
    predicted = hybrid.predict(U[0], y0=y[0][:5])
    state, graph, found = hybrid.graph_state(U[0], y0=y[0][:5], n_sub=8), hybrid.to_graph(n_sub=8), []
    for row in U[0][5:]:
        at = graph(x=state, u=row)
        state = at["x_next"]
        found.append(at["y"][0])
    np.testing.assert_allclose(found, predicted[5:], atol=1e-4)
