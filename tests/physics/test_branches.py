"""A function for one point gives the same for many, run in groups that take the same branches."""

import math
import pickle
import warnings
from math import sqrt as root

import numpy as np
import pytest

from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._branches import Branches
from sksurrogate.physics._rhs import PointwiseFunction

GAIN = 2.0


def signed_root(h):
    return root(h) if h > 0 else -root(-h)


def nested(t, x, u, p):
    h, v = x
    flow = p["k"] * signed_root(h)
    if 0 < v < 1 or not h > -0.5:
        flow += math.exp(-abs(v))
    return v - flow, max(-1, min(float(u[0]), 1)) * GAIN - math.atan2(h, v)


def looped(t, x, u, p):
    total = 0.0
    for k in range(1, 6):
        if x[0] * k > 1.5:
            break
        total += x[1] / k
    return total, (x[0] if t > 1 else -x[0]) - u[0]


def aliased(t, x, u, p):
    force = lag = x[0] * p["k"]
    force += 1 if u[0] > 0.3 else 0
    return force, lag


def closing(k, shape):
    def rhs(t, x, u, p):
        return [k * shape(x[0]) if x[0] > 0 else 0, math.log(2 + math.fabs(x[1]), 10) - u[0]]

    return rhs


class Machine:
    level = 0.4

    def rhs(self, t, x, u, p):
        return (x[1], u[0] - self.level * math.copysign(1.0, x[1]))


FUNCTIONS = [nested, looped, aliased, closing(0.7, math.tanh), closing(1.3, signed_root), Machine().rhs]


def points(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 2, n), rng.normal(size=(2, n)), rng.normal(size=(1, n)), {"k": rng.uniform(0.5, 2, n)}


def one_by_one(function, t, x, u, p):
    return np.array(
        [function(t[k], x[:, k], u[:, k], {name: v[k] for name, v in p.items()}) for k in range(len(t))], float
    ).T


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("n", [1, 7, 500])
def test_the_values_of_single_points(function, n):
    given = points(n)
    kept = [np.copy(a) for a in given[:3]]
    np.testing.assert_allclose(Branches(function, 2)(*given), one_by_one(function, *given), rtol=1e-13, atol=1e-14)
    for now, before in zip(given, kept):
        np.testing.assert_array_equal(now, before)


def test_any_shape_of_points_and_numbers_for_time_and_parameters():
    _, x, u, _ = points(60)
    flat = np.array(Branches(nested, 2)(0.5, x, u, {"k": 1.5}))
    folded = Branches(nested, 2)(0.5, x.reshape(2, 3, 20), u.reshape(1, 3, 20), {"k": 1.5})
    np.testing.assert_array_equal(np.array(folded).reshape(2, -1), flat)


def test_few_calls_for_many_points():
    calls = []

    def rhs(t, x, u, p):
        calls.append(np.shape(x[0]))
        return (-math.sqrt(x[0]) if x[0] > 0 else u[0],)

    Branches(rhs, 1)(0.0, *points(5000)[1:3], {})
    assert len(calls) == 3  # undecided, and each side of the branch


def test_a_global_is_read_when_the_function_is_called(monkeypatch):
    _, x, u, _ = points(40)
    branches = Branches(nested, 2)
    before = branches(0.0, x, u, {"k": 1.0})[1]
    monkeypatch.setitem(globals(), "GAIN", 3.0)
    np.testing.assert_allclose(branches(0.0, x, u, {"k": 1.0})[1] - before, np.clip(u[0], -1, 1), atol=1e-14)


def test_math_refuses_in_its_own_words():
    def rhs(t, x, u, p):
        return (math.sqrt(x[0]),)

    with pytest.raises(ValueError) as alone:
        rhs(0.0, np.array([-1.0]), np.zeros(1), {})
    with pytest.raises(ValueError) as many:
        Branches(rhs, 1)(0.0, np.array([[1.0, 4.0, -1.0]]), np.zeros((1, 3)), {})
    assert str(many.value) == str(alone.value)
    function = PointwiseFunction(rhs, 1, "rhs", ["h"])
    out = function(0.0, np.array([[1.0, 4.0, -1.0]]), np.zeros((1, 3)), {})
    np.testing.assert_array_equal(out, [[1.0, 2.0, np.nan]])
    assert str(alone.value) in function.refusal


def test_it_is_copied_with_what_it_calls():
    given = points(50)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(Branches(nested, 2)))(*given), Branches(nested, 2)(*given))


def test_a_try_of_the_function_does_not_stop_the_splitting():
    def rhs(t, x, u, p):
        try:
            return (1.0 if x[0] > 0 else 2.0,)
        except Exception:
            return (3.0,)

    assert set(Branches(rhs, 1)(0.0, *points(200)[1:3], {})[0]) == {1.0, 2.0}


@pytest.mark.parametrize("make", [ODESimulator, StepSimulator])
def test_a_simulator_runs_it_without_a_warning_and_as_the_array_form(make):
    def scalar(t, x, u, p, *dt):
        return (0.9 * max(x[0], 0.0) ** 0.5 + (u[0] if u[0] > 0 else 0.0) - x[0],)

    def array(t, x, u, p, *dt):
        return (0.9 * np.maximum(x[0], 0.0) ** 0.5 + np.maximum(u[0], 0.0) - x[0],)

    U = np.random.default_rng(1).normal(size=(60, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, wanted = (
            make(f, states=["h"], inputs=["u"], outputs=["h"], params={}, dt=0.1).simulate(U, [0.5])
            for f in (scalar, array)
        )
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
