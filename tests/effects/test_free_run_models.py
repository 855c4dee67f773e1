"""A plant with free parameters, the plant with no effects and the plant with a term of size zero are one model."""

import pickle

import numpy as np
import pytest

from sksurrogate.compose._term import Basis, TermModel
from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._sampled import names_of_memory
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, ROWS, DT = 2, 30, 0.1
SCALE = np.array([0.7, 1.3])


def rhs(t, x, u, p):
    return x[1], u[0] * np.cos(t) - p["k"] * x[0] ** 3 - p["c"] * x[1]


def models(hold, output):
    plant = ODESimulator(
        rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={"k": 2.0, "c": 0.3}, dt=DT, hold=hold, output=output
    )  # fmt: skip
    rng = np.random.default_rng(0)
    U, Y = rng.normal(size=(RUNS, ROWS, 1)), rng.normal(size=(RUNS, ROWS, 1))
    record = Record.from_runs(list(U), list(Y), [DT * np.arange(ROWS)] * RUNS, DT)
    inner = PlantModel(describe(plant))
    inner.probe(np.zeros(1))
    fit = FitModel(inner, ["k"], record, 3, SCALE)
    bare = FitModel(inner, [], record, 3, SCALE)
    term = TermModel(bare, Basis(np.ones((4, 3))), (1,), np.ones(1), False)
    return fit, AugmentedModel(inner, (), ("k",), record, n_sub=3, scale=SCALE), term


@pytest.mark.parametrize("output", [None, lambda t, x, u, p: (p["k"] * x[0] + u[0],)], ids=["states", "function"])
@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_they_step_and_read_alike(hold, output):
    fit, augmented, term = models(hold, output)
    values = np.array([2.0, 2.5, 1.6])
    rng = np.random.default_rng(1)
    x, rows = rng.normal(size=(2, 3, RUNS * ROWS)), np.array([3, 31, 59])
    one, other = fit.bind(values[None]), augmented.bind(np.log(values / 2.0)[None])
    nought = term.bind(np.zeros((term.n_theta, 3)))
    # the layout of the arrays differs, and with it how numpy rounds a power or a cosine
    np.testing.assert_allclose(one(x), other(x), rtol=0, atol=1e-13)
    np.testing.assert_allclose(one(x)[:, 0], nought(x)[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(one.outputs(x), other.outputs(x), rtol=0, atol=1e-13)
    for bound in (one, other, nought):
        np.testing.assert_allclose(bound(x[:, :, rows], rows), bound(x)[:, :, rows], rtol=0, atol=1e-13)
        np.testing.assert_array_equal(bound.start(x[:, :, fit.record.starts]), x[:, :, fit.record.starts])


@pytest.mark.parametrize("output", [None, lambda t, x, u, p: (p["k"] * x[0] + u[0],)], ids=["states", "function"])
def test_the_kernels_learn_the_same_of_them(output):
    fit, augmented, term = models("zoh", output)
    sd = np.array([0.01])
    for model in (augmented, term):
        assert (model.n_states, model.n_nominal, model.plain_outputs) == (2, 2, fit.plain_outputs)
        assert model.free_states.all() and fit.free_states.all()
        np.testing.assert_array_equal(model.closing_weight(sd), fit.closing_weight(sd))
    x = np.random.default_rng(2).normal(size=(2, RUNS * ROWS))
    one = linearise(fit, np.array([2.0]), x, np.array([2.0]))
    other = linearise(augmented, np.zeros(1), x, np.ones(1))
    # dk = k dphi; forward differences of step 1e-4 agree to their own curvature
    np.testing.assert_allclose(other.J_theta, 2.0 * one.J_theta, rtol=0, atol=1e-3 * np.abs(one.J_theta).max())
    np.testing.assert_allclose(other.J_x, one.J_x, rtol=0, atol=1e-9 * np.abs(one.J_x).max())


def test_what_is_laid_out_again_is_not_stored():
    fit, _, _ = models("foh", None)
    fresh, theta, x = len(pickle.dumps(fit)), np.full((1, 3), 2.5), np.ones((2, 3, RUNS * ROWS))
    after = fit.bind(theta)(x)
    assert {"held", "_points"} <= set(fit.__dict__)
    stored = pickle.dumps(fit)
    assert len(stored) == fresh
    np.testing.assert_array_equal(pickle.loads(stored).bind(theta)(x), after)


class Settling(CATALOGUE["hidden_relaxation"]):
    """One whose own state begins anywhere."""

    at_rest = False


class Preloaded(CATALOGUE["hidden_relaxation"]):
    """One whose start depends on its parameters too."""

    def rest(self, v, theta):
        return [(1.0 + theta[0]) * v]


def test_sensitivities_beside_hidden_states_that_begin_at_rest_or_anywhere_are_those_of_free_runs():
    fit, _, _ = models("zoh", None)
    effects = [Preloaded("v", "v"), Settling("v", "q")]
    model = AugmentedModel(fit.inner, effects, ("k",), fit.record, n_sub=3, scale=SCALE)
    assert model.free_states.tolist() == [True, True, False, True]
    theta, first = np.array([0.4, 0.3, 0.2, 0.5, 0.1]), np.random.default_rng(4).normal(size=(4, RUNS))

    def run(theta, first):
        begun = model.bind(theta[:, None]).start(first[:2, None])[:, 0]
        return free_run(model, theta, np.where(model.free_states[:, None], first, begun))

    there = linearise(model, theta, run(theta, first), np.abs(theta))
    for found, count in ((there.Z_theta, len(theta)), (there.Z_x, 4)):
        for k in range(count):
            push = 1e-5 * (np.arange(count) == k)
            if count == 4:
                ends = [run(theta, first + sign * push[:, None]) for sign in (1, -1)]
            else:
                ends = [run(theta + sign * push, first) for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / 2e-5
            # forward differences of step 1e-4
            np.testing.assert_allclose(found[:, k], slope, rtol=0, atol=2e-3 * max(np.abs(slope).max(), 0.1))


def test_states_of_a_memory_are_numbered_where_there_are_several():
    lag = CATALOGUE["input_lag"]("u")
    assert names_of_memory(lag, 1) == ["input_lag_u"] and names_of_memory(lag, 0) == []
    assert names_of_memory(lag, 3) == ["input_lag_u_0", "input_lag_u_1", "input_lag_u_2"]
