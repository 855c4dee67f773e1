"""Functions of one point that make vectors and matrices: called for many points, each entry of these holds the points."""

import pickle
import warnings
from functools import partial

import numpy as np
import pytest

from sksurrogate.physics import ODESimulator
from sksurrogate.physics._branches import Branches
from sksurrogate.physics._rhs import PointwiseFunction

B = np.array([[0.0], [1.0]])


def filled(t, x, u, p):
    """As in a lecture: zeros, then one entry after the other."""
    dx = np.zeros(2)
    dx[0] = x[1]
    dx[1] = u[0] - p["k"] * x[0]
    dx[1] -= p["c"] * x[1]
    return dx


def matrix(t, x, u, p):
    """A matrix of parameters."""
    A = np.array([[0.0, 1.0], [-p["k"], -p["c"]]])
    return A @ x + B @ u


def matrix_that_is_filled(t, x, u, p):
    A = np.zeros((2, 2))
    A[0, 1], A[1] = 1.0, [-p["k"], -p["c"]]
    return np.dot(A, x) + B.dot(u)


def branching(t, x, u, p):
    dx = np.empty(2)
    dx[:] = x[1], u[0] - p["k"] * x[0]
    if x[1] > 0:
        dx[1] -= p["c"]
    else:
        dx[1] += p["c"]
    return dx


def arm(t, x, u, p):
    """Two joints: the accelerations solve the mass matrix."""
    q, v = np.array([x[0], 2.0 * x[0]]), np.array([x[1], x[1] ** 2])
    c, s = np.cos(q[1]), np.sin(q[1])
    M = np.array([[3.0 + 2.0 * c * p["k"], 1.0 + c], [1.0 + c, 1.5]])
    turned = np.array([-s * v[1] * (2.0 * v[0] + v[1]), s * v[0] ** 2])
    return np.linalg.solve(M, np.array([u[0], 0.0]) - turned)


def inverse(t, x, u, p):
    return np.linalg.inv(np.array([[2.0 + x[0] ** 2, p["c"]], [0.0, 1.0]])) @ np.array([u[0], x[1]])


def solved_for_columns(t, x, u, p):
    both = np.linalg.solve(np.array([[2.0 + x[0] ** 2, 0.1], [0.1, p["k"]]]), np.array([[u[0], 0.0], [x[1], 1.0]]))
    return [both[0, 0] + both[1, 1], both[1, 0]]


def times_a_column(t, x, u, p):
    """Numbers times a column, a row of a matrix, a matrix of ones."""
    A = np.array([[0.0, 1.0], [-4.0, -0.3]])
    return A @ np.asarray(x) + B[:, 0] * u[0] + p["c"] * (np.eye(2) * x[0])[1] + np.ones(2) * p["k"]


def table(t, x, u, p):
    """What numpy gives of points without their kind, beside vectors of as many numbers as there are points in a test."""
    weights = np.linspace(0.0, 1.0, 200)
    bent = np.interp(x[0], [-1.0, 0.0, 1.0], [0.0, 0.2, 1.0]) + np.where(x[1] > 0, x[1], 0.5 * x[1])
    return np.array([np.sum(weights * bent), bent]) + np.zeros(2)


def joined(t, x, u, p):
    """Parts of vectors, a diagonal, points among numbers."""
    D = np.diag([p["k"], p["c"]])
    whole = np.concatenate([[x[1]], D @ x, np.hstack([u[0], x[:1], 2.0])])
    return whole[1:3] + np.hstack((x[1:], u)) * whole[-1]


def functions_of_vectors(t, x, u, p):
    """Functions of numpy at vectors of points."""
    v = np.array([x[0], x[1] + u[0]])
    dx = np.sin(v) * np.tanh(v / 0.1) + np.sqrt(np.abs(v)) - np.exp(-(v**2)) + np.log1p(v**2) * np.maximum(v, 0.1)
    dx[0] += np.arctan2(v[1], v[0]) + np.sign(v)[1] + np.hypot(*v) + np.mean(v) + v.max() + np.clip(v, -1.0, 1.0).sum()
    return np.where(v > 0.5, dx, dx - p["c"] * v)


class Filling:
    """A plant as an object."""

    def __init__(self, gain):
        self.gain = gain

    def __call__(self, t, x, u, p):
        return self.gain * filled(t, x, u, p)

    def rates(self, t, x, u, p):
        dx = np.zeros(2)
        dx[:] = x[1], self.gain * u[0]
        return dx


def scaled(gain, t, x, u, p):
    dx = np.ones(2)
    dx[1] = gain * x[0]
    return dx


ALL = [
    Filling(2.0),
    Filling(3.0).rates,
    partial(scaled, 0.5),
    functions_of_vectors,
    joined,
    times_a_column,
    table,
    filled,
    matrix,
    matrix_that_is_filled,
    branching,
    arm,
    inverse,
    solved_for_columns,
]


def points(n, varied):
    rng = np.random.default_rng(0)
    k = rng.uniform(0.5, 1.0, n) if varied else 0.8
    return rng.normal(size=(2, n)), rng.normal(size=(1, n)), {"k": k, "c": 0.3}


def one_by_one(function, x, u, p):
    each = [{name: float(np.broadcast_to(v, x.shape[1])[m]) for name, v in p.items()} for m in range(x.shape[1])]
    return np.stack([np.array(function(0.0, x[:, m], u[:, m], each[m]), float) for m in range(x.shape[1])], axis=1)


@pytest.mark.parametrize("varied", [False, True])
@pytest.mark.parametrize("n", [1, 2, 7, 200])
@pytest.mark.parametrize("function", ALL)
def test_the_values_of_single_points(function, n, varied):
    x, u, p = points(n, varied)
    found = Branches(function, 2, vectors=True)(0.0, x, u, p)
    np.testing.assert_allclose(found, one_by_one(function, x, u, p), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    "function", [one for one in ALL[1:] if one is not functions_of_vectors]
)  # it splits points often
def test_a_probe_finds_the_way_and_few_calls_follow(function):
    calls = []

    def counted(t, x, u, p):
        calls.append(1)
        return function(t, x, u, p)

    asked = PointwiseFunction(counted, 2, "rhs", ["q", "v"])
    for varied in (False, True):
        x, u, p = points(400, varied)
        asked(0.0, x, u, p)
        calls.clear()
        found = asked(0.0, x, u, p)
        assert len(calls) <= 3
        np.testing.assert_allclose(found, one_by_one(function, x, u, p), rtol=1e-12, atol=1e-14)


def determinant(t, x, u, p):
    return [np.linalg.det(np.array([[x[0], x[1]], [u[0], 1.0]])), x[0]]


def test_what_has_no_way_is_said_to_be_slow():
    x, u, p = points(50, True)
    with pytest.raises((TypeError, ValueError)):
        Branches(determinant, 2, vectors=True)(0.0, x, u, p)
    with pytest.warns(UserWarning, match="point by point"):
        found = PointwiseFunction(determinant, 2, "rhs", ["q", "v"])(0.0, x, u, p)
    np.testing.assert_allclose(found, one_by_one(determinant, x, u, p), rtol=1e-12)


def test_a_copy_is_as_patient():
    asked = Branches(filled, 2, vectors=True)
    asked.patient = True
    copy = pickle.loads(pickle.dumps(asked))
    assert (copy.function, copy.size, copy.vectors, copy.patient) == (filled, 2, True, True)


def test_a_branch_that_no_probe_met_is_asked_point_by_point():
    def rare(t, x, u, p):
        dx = np.zeros(2)
        dx[0] = x[1]
        return determinant(t, x, u, p) if x[0] > 50 else dx

    asked, (x, u, p) = PointwiseFunction(rare, 2, "rhs", ["q", "v"]), points(200, True)
    asked(0.0, x, u, p)
    x[0, :100] += 100.0
    np.testing.assert_allclose(asked(0.0, x, u, p), one_by_one(rare, x, u, p), rtol=1e-12)


def test_a_simulator_runs_it_without_a_warning_and_as_the_array_form():
    names = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"], "params": {"k": 4.0, "c": 0.3}, "dt": 0.05}
    U = np.random.default_rng(1).normal(size=(60, 1))
    plain = ODESimulator(lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]), **names)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(ODESimulator(filled, **names).simulate(U), plain.simulate(U), rtol=1e-12, atol=1e-14)
