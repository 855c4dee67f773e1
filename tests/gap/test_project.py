"""Projections on a Gram equal those on the columns themselves."""

import numpy as np
import pytest

from sksurrogate.gap.fit._normal_equations import eliminate, eliminate_rows, project_starts


@pytest.fixture
def columns():
    """Residual, two nuisance columns, three candidates."""
    return np.random.default_rng(0).normal(size=(6, 50))


def test_the_gram_without_nuisance_is_that_of_what_a_least_squares_fit_leaves(columns):
    fitted, *_ = np.linalg.lstsq(columns[1:3].T, columns.T, rcond=None)
    left = columns - fitted.T @ columns[1:3]
    wanted = (left @ left.T)[np.ix_([0, 3, 4, 5], [0, 3, 4, 5])]
    G = columns @ columns.T
    found = eliminate(G, 2, np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(found, wanted, atol=1e-10)
    cross, size = eliminate_rows(G[:3], np.diag(G), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(cross[-3:], wanted[0, 1:], atol=1e-10)
    np.testing.assert_allclose(size[-3:], np.diag(wanted)[1:], atol=1e-10)


def test_initial_states_of_every_run_leave_what_a_fit_run_by_run_leaves():
    rng = np.random.default_rng(1)
    signals, J = rng.normal(size=(3, 2, 40)), rng.normal(size=(2, 2, 40))
    found = project_starts(signals, J, np.array([0, 25]))
    for run in (slice(0, 25), slice(25, 40)):
        basis = J[:, :, run].transpose(1, 0, 2).reshape(2, -1).T
        rows = signals[:, :, run].reshape(3, -1).T
        left = rows - basis @ np.linalg.lstsq(basis, rows, rcond=None)[0]
        np.testing.assert_allclose(found[:, :, run].reshape(3, -1), left.T, atol=1e-10)


def test_a_trajectory_that_left_the_finite_numbers_is_refused(columns):
    G = columns @ columns.T
    G[1, 2] = np.inf
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        eliminate_rows(G[:3], np.diag(G), np.zeros(2), np.zeros(2))
