"""What a residual is fitted on: pieces of runs, rows that choose its form."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.model_selection import PredefinedSplit, cross_val_score

from sksurrogate.compose._hybrid_output import OutputCorrection, _defaults
from sksurrogate.compose._residual_fit import FreeRunCorrection, OneStepCorrection, cut, features, weighed
from sksurrogate.compose._skip_net import SkipNet
from sksurrogate.kernels.shooting import levenberg_marquardt


@pytest.mark.parametrize(("most_rows", "n_pieces"), [(1000, 8), (80, 8), (40, 4), (20, 2)])
def test_pieces_begin_with_measured_rows_and_have_as_many_others_in_all_as_are_asked_for(most_rows, n_pieces):
    y = np.arange(90.0)[:, None]
    pieces = cut([np.hstack([y, -y])], [y], n_lags=10, longest=10, most_rows=most_rows)
    assert pieces.target.shape == (20, n_pieces, 1) and pieces.known.shape == (20, n_pieces, 2)
    begins = np.arange(n_pieces) * 80 // n_pieces
    np.testing.assert_array_equal(pieces.target[:, :, 0], begins + np.arange(20)[:, None])
    np.testing.assert_array_equal(pieces.known[..., 1:], -pieces.target)


@pytest.mark.parametrize("n_runs", [1, 5])
@pytest.mark.parametrize("seed", range(4))
def test_the_default_residual_is_that_of_a_search_on_every_fourth_run_or_row(seed, n_runs):
    rng, n_lags, n = np.random.default_rng(seed), 2, 40 // n_runs
    deviation = [np.zeros((n + n_lags, 1)) for _ in range(n_runs)]
    phi = rng.normal(size=(n * n_runs, 2))
    wanted = phi[:, 0] + 0.4 * phi[:, 1] ** 2 + rng.normal(size=n * n_runs)
    number = np.arange(n * n_runs) // n if n_runs > 1 else np.arange(n)
    split = PredefinedSplit(np.where(number % 4 == 1, 0, -1))
    scores = [
        cross_val_score(candidate, phi, wanted, cv=split, scoring="neg_mean_squared_error")[0]
        for candidate in _defaults(2)
    ]
    correction = OutputCorrection(None, None, "output", "one_step", n_lags, 0.5, 0.0, None)
    chosen = correction._chosen(deviation, phi, wanted)
    assert repr(chosen) == repr(_defaults(2)[int(np.argmax(scores))])


def _net(n_features, n_outputs, rng, units=3):
    """A map whose free runs stay small."""
    shapes = [(n_features, n_outputs), (n_features, units), (units,), (units, n_outputs), (n_outputs,)]
    skip, hidden, hidden_bias, out, bias = (0.2 * rng.normal(size=shape) for shape in shapes)
    return SkipNet(rng.normal(size=n_features), 1.0 + rng.random(n_features), skip, hidden, hidden_bias, out, bias)


def _pieces(rng, n_outputs=2, n_lags=2):
    known = [rng.normal(size=(n, 3)) for n in (40, 25)]
    return cut(known, [rng.normal(size=(len(k), n_outputs)) for k in known], n_lags, 18, 1000)


@pytest.mark.parametrize("kind", [FreeRunCorrection, OneStepCorrection])
def test_the_slopes_of_a_correction_are_differences_of_its_errors(kind):
    rng = np.random.default_rng(0)
    pieces = _pieces(rng)
    pieces.target[7, 1, 0] = np.nan  # not measured
    net = _net(7, 2, rng)
    held = np.zeros(net.theta.size, bool)
    held[3] = True
    loss = kind(pieces, np.full(net.theta.size, 0.3), rng.normal(size=net.theta.size), held)

    def errors(theta):
        at = net.at(theta)
        return loss.errors(loss.run(at))

    by_difference = np.stack([(errors(net.theta + h) - errors(net.theta - h)) / 2e-6 for h in 1e-6 * np.eye(len(held))])
    by_difference[held] = 0.0
    np.testing.assert_allclose(loss.jacobian(net, loss.run(net)), by_difference.T, rtol=1e-6, atol=1e-8)


def test_a_number_that_is_held_stays_and_the_others_go_to_the_minimum_without_it():
    rng = np.random.default_rng(1)
    net = replace(_net(7, 2, rng, units=0), mean=np.zeros(7))
    held = np.zeros(net.theta.size, bool)
    held[-2:] = True
    loss = OneStepCorrection(_pieces(rng), np.where(held, 0.0, 0.5), np.zeros(net.theta.size), held)
    found, _ = levenberg_marquardt(loss, net, 100, 1e-14)
    phi, wanted = loss._rows
    z = phi / net.scale
    ridge = np.linalg.solve(z.T @ z + 0.5 * np.eye(7), z.T @ (wanted - net.bias))
    np.testing.assert_array_equal(found.bias, net.bias)
    np.testing.assert_allclose(found.skip, ridge, atol=1e-6)


def test_the_evidence_holds_the_map_of_a_linear_plant_straight_and_finds_its_noise():
    rng = np.random.default_rng(2)
    known, d = [rng.normal(size=(400, 3))], np.zeros((400, 1))
    for t in range(1, 400):
        d[t] = 0.7 * d[t - 1] + known[0][t] @ [[1.0], [-0.5], [0.2]]
    pieces = cut(known, [d + 0.05 * rng.normal(size=d.shape)], 1, 50, 1000)
    net = _net(4, 1, rng)
    loss = FreeRunCorrection(pieces, np.where(net.groups >= 0, 1e-2, 0.0), np.zeros(net.theta.size))
    for _ in range(6):
        net, _ = levenberg_marquardt(loss, net, 20, 1e-6)
        loss = replace(loss, weight=weighed(loss, net))
    phi = features(pieces.target, pieces.known, 1)[:, 0]
    straight = np.column_stack([phi, np.ones(len(phi))])
    bent = net(phi) - straight @ np.linalg.lstsq(straight, net(phi), rcond=None)[0]
    assert np.std(bent) < 0.01 * np.std(net(phi))
    assert np.all(loss.weight[net.groups < 0] == 0.0)
    # the noise is found, too: a penalty is its variance over the variance of the weights
    linear = loss.weight[net.groups == 0][0]
    assert linear == pytest.approx(0.05**2 / np.mean(net.skip**2), rel=0.3)
