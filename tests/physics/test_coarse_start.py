"""Where a calibration begins: thinned records, nominal runs that burst, points in blocks."""

import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

import sksurrogate.physics._coarse_start as coarse
import sksurrogate.physics._fit_model as fit_model
from sksurrogate.kernels.integrate import march
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CalibratedSimulator, ODESimulator
from sksurrogate.physics._coarse_start import thinned
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._prepare import fastest
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import stack_runs

TRUE = {"mu": 0.5, "K": 0.3, "S": 4.0}


def monod(t, x, u, p):
    grown = p["mu"] * x[1] / (p["K"] + x[1]) * x[0]
    return grown - u[0] * x[0], u[0] * (p["S"] - x[1]) - 2 * grown


def reactor(**params):
    return ODESimulator(
        monod, states=["b", "s"], inputs=["D"], outputs=["b"], params={**TRUE, **params}, dt=0.5, x0=[0.5, 1.0]
    )


def oscillator(t, x, u, p):
    return x[1], p["g"] * u[0] - p["d"] * x[1] - p["a"] * x[0] - p["b"] * x[0] ** 3


def _long(n_runs, n, every=20):
    plant = ODESimulator(
        oscillator,
        states=["q", "v"],
        inputs=["f"],
        outputs=["q"],
        params={"d": 0.3, "a": 1.0, "b": 0.5, "g": 1.2},
        dt=0.05,
    )
    rng, X, Y = np.random.default_rng(3), [], []
    for k in range(n_runs):
        u = np.repeat(rng.normal(size=n // every + 1), every)[: n + k, None]  # lengths that no step divides
        clean = plant.simulate(u, rng.normal(scale=0.5, size=2))[:, 0]
        X.append(u)
        Y.append(clean + 0.01 * rng.normal(size=len(clean)))
    return plant, *stack_runs(X, Y)


@pytest.mark.parametrize("every", [1, 20])
def test_a_long_record_begun_thinned_ends_where_it_would_at_once(monkeypatch, every):
    plant, X, y, groups = _long(3, 2500, every)
    model = CalibratedSimulator(plant.set_params(params__d=0.6, params__a=1.6, params__b=0.3, params__g=1.0))
    started = []
    quick = coarse.coarse_start
    monkeypatch.setattr(
        "sksurrogate.physics._lifted_fit.coarse_start", lambda *a: started.append(quick(*a) is not None) or quick(*a)
    )
    short = model.fit(X, y, groups=groups)
    found, ends = short.params_, short.intervals_
    monkeypatch.setattr("sksurrogate.physics._lifted_fit.coarse_start", lambda *a: None)
    at_once = model.fit(X, y, groups=groups)
    assert started == [True]
    for name, value in at_once.params_.items():
        width = at_once.intervals_[name][1] - at_once.intervals_[name][0]
        assert abs(found[name] - value) < 0.02 * width  # both stop well within the noise
        assert np.allclose(ends[name], at_once.intervals_[name], atol=0.02 * width)


def test_thinned_rows_are_those_of_each_run_and_held_inputs_are_averaged():
    u = np.arange(11.0)[None]
    record = Record(u, 10 * u, np.arange(11.0), np.array([0, 5]), 0.5)
    few = thinned(record, 2, held=True)
    np.testing.assert_array_equal(few.y[0], [0, 20, 50, 70, 90])
    np.testing.assert_array_equal(few.u[0], [0.5, 2.5, 5.5, 7.5, 9.5])
    np.testing.assert_array_equal(few.starts, [0, 2])
    assert few.dt == 1.0


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_the_map_of_a_record_is_the_march_from_row_to_row(monkeypatch, hold):
    monkeypatch.setattr(fit_model, "_POINTS_IN_BLOCK", 7)  # many blocks
    plant = reactor().set_params(hold=hold)
    rng = np.random.default_rng(0)
    u, x = rng.uniform(0.05, 0.3, size=(1, 40)), rng.uniform(0.5, 2.0, size=(2, 40))
    record = Record(u, x[:1], np.arange(40) * 0.5, np.array([0]), 0.5)
    model = FitModel(PlantModel(describe(plant)), ["mu", "S"], record, 3, np.ones(2))
    theta = np.array([[0.5, 0.6], [4.0, 3.0]])
    after = model.bind(theta)(np.repeat(x[:, None], 2, axis=1))
    for column, (mu, S) in enumerate(theta.T):
        for k in (0, 17, 38):
            mean, half = model.held
            one = march(
                lambda t, z, v, q={"mu": mu, "K": 0.3, "S": S}: np.stack(monod(t, z, v, q)), x[:, [k]], np.array([0.5 * k]),
                np.repeat(mean[..., [k]], 2, axis=-1).reshape(3, 1, 1, 2),
                None if half is None else np.repeat(half[..., [k]], 2, axis=-1).reshape(3, 1, 1, 2),
                0.5 / 3,
            )  # fmt: skip
            np.testing.assert_allclose(after[:, column, k], one[:, 0, 1], rtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 7])
def test_a_nominal_run_that_bursts_leads_no_fit_astray(seed):
    # Off by a tenth to a third, the substrate is used up: there steps of one sample are unstable, and the run bursts.
    rng, X, Y = np.random.default_rng(100 + seed), [], []
    for _ in range(2):
        u = np.repeat(rng.uniform(0.05, 0.3, size=11), 20)[:200, None]
        clean = reactor().simulate(u)[:, 0]
        X.append(u)
        Y.append(clean + 0.02 * clean.std() * rng.normal(size=200))
    X, y, groups = stack_runs(X, Y)
    model = CalibratedSimulator(reactor(mu=0.53, K=0.28, S=5.5))
    with warnings.catch_warnings():  # the way it went is given in a warning
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(X, y, groups=groups)
    for name, value in TRUE.items():
        assert model.params_[name] == pytest.approx(value, rel=0.1)
    assert model.noise_[0] < 0.03 * y.std()


def test_a_fit_that_is_worse_than_a_constant_says_so():
    def unstable(t, x, u, p):
        return (p["a"] * x[0] ** 2 + 1.0,)

    plant = ODESimulator(unstable, states=["x"], inputs=["u"], outputs=["x"], params={"a": 0.01}, dt=0.1)
    y = np.tile([5.0, -5.0], 50) + np.random.default_rng(0).normal(size=100)
    model = CalibratedSimulator(plant, bounds={"a": (0.005, 0.05)}, fit_x0=False)
    with pytest.warns(ConvergenceWarning, match="much farther from y than the mean of y"):
        model.fit(np.zeros((100, 1)), y)


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_the_bound_of_the_speed_is_that_of_the_eigenvalues_in_any_unit(unit):
    def lag(t, x, u, p):  # x[1] in other units
        return -p["a"] * x[0] + 0.5 * x[1] / unit, 0.5 * unit * x[0] - 2.0 * x[1]

    plant = ODESimulator(lag, states=["x", "z"], inputs=[], outputs=["x"], params={"a": 3.0}, dt=0.1)
    record = Record(np.zeros((0, 30)), np.ones((1, 30)), np.arange(30) * 0.1, np.array([0]), 0.1)
    model = FitModel(PlantModel(describe(plant)), ["a"], record, 1, np.ones(2))
    found = fastest(model, np.array([3.0]), np.stack([np.ones(30), np.zeros(30)]))
    assert found == pytest.approx(0.1 * max(np.linalg.eigvals([[3.0, 0.5], [0.5, 2.0]])), rel=1e-6)


def test_a_plant_without_inputs_is_calibrated():
    decay = ODESimulator(lambda t, x, u, p: (-p["k"] * x[0],), states=["x"], inputs=[], outputs=["x"], params={"k": 1.0}, dt=0.1)  # fmt: skip
    y = decay.set_params(params__k=0.6).simulate(np.zeros((50, 0)), x0=[2.0])[:, 0]
    found = CalibratedSimulator(decay.set_params(params__k=1.0)).fit(np.zeros((50, 0)), y)
    assert found.params_["k"] == pytest.approx(0.6, rel=1e-4)


@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_which_rows_tell_does_not_depend_on_the_unit_of_the_outputs(unit):
    t = 0.01 * np.arange(4000)
    u, y = np.sin(t)[:, None], np.cos(3 * t)[:, None]
    one, other = (Record.from_runs([u], [size * y], [t], 0.01) for size in (1.0, unit))
    _, every = coarse._telling_rows(one, np.array([1e-9]), True)
    assert every > 1 and coarse._telling_rows(other, unit * np.array([1e-9]), True)[1] == every
