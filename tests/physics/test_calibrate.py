"""Calibration: planted parameters come back, initial states known or not; what the data do not fix is said."""

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ODESimulator, StepSimulator
from sksurrogate.runs import stack_runs

TRUE = {"d": 0.3, "a": 1.0, "b": 0.5, "g": 1.2, "w": 0.1}


def duffing(t, x, u, p):
    q, v = x
    return v, p["g"] * u[0] - p["d"] * v - p["a"] * q - p["b"] * q**3 + p["w"]


def _plant(**changes):
    return ODESimulator(duffing, states=["q", "v"], inputs=["f"], outputs=["q"], params={**TRUE, **changes}, dt=0.05)


def _data(n_runs=4, n=300, noise=0.01, seed=0):
    rng, plant, X, y = np.random.default_rng(seed), _plant(), [], []
    starts = rng.normal(scale=0.5, size=(n_runs, 2))
    for x0 in starts:
        u = np.repeat(rng.normal(size=n // 20 + 1), 20)[:n, None]
        clean = plant.simulate(u, x0)[:, 0]
        X.append(u)
        y.append(clean + noise * np.std(clean) * rng.normal(size=n))
    return (*stack_runs(X, y), starts)


@pytest.mark.parametrize("known", [False, True])
def test_planted_parameters_come_back(known):
    X, y, groups, starts = _data()
    model = CalibratedSimulator(_plant(d=0.5, a=1.5, b=0.3, g=1.0, w=0.0), fit_x0=not known)
    model.fit(X, y, groups=groups, x0=starts if known else None)
    assert model.converged_ and model.method_ == "lifted"
    for name, value in TRUE.items():
        assert model.params_[name] == pytest.approx(value, rel=0.03, abs=3e-3)
        low, high = model.intervals_[name]
        assert low < model.params_[name] < high and high - low < 0.2
    np.testing.assert_allclose(model.x0_, starts, atol=0.05)
    assert model.score(X, y, groups=groups) > 0.999


@pytest.mark.slow
def test_intervals_hold_what_they_promise():
    inside = []
    for seed in range(12):
        X, y, groups, _ = _data(n_runs=2, n=200, noise=0.03, seed=seed)
        model = CalibratedSimulator(_plant(a=1.2)).fit(X, y, groups=groups)
        inside += [model.intervals_[k][0] <= v <= model.intervals_[k][1] for k, v in TRUE.items()]
    # 60 intervals of 90 %: fewer than 45 inside has a chance below 1e-4, correlation within a fit apart.
    assert sum(inside) >= 45


def test_a_product_that_only_acts_as_a_product_is_named():
    plant = StepSimulator(
        lambda t, x, u, p, dt: [0.9 * x[0] + p["a"] * p["b"] * u[0]],
        states=["x"],
        inputs=["u"],
        outputs=["x"],
        params={"a": 1.0, "b": 2.0},
    )
    U = np.random.default_rng(0).normal(size=(80, 1))
    y = plant.simulate(U)[:, 0] + 1e-3 * np.random.default_rng(1).normal(size=80)
    model = CalibratedSimulator(plant).fit(U, y)
    assert model.identifiable_ == {"a": False, "b": False}
    (combination,) = model.unidentified_
    assert combination["a"] == pytest.approx(-combination["b"], rel=1e-3)
    assert model.intervals_["a"] == (-np.inf, np.inf)


def test_bounds_hold_and_the_simulator_is_not_written():
    X, y, groups, _ = _data(n_runs=1)
    plant = _plant(d=0.5)
    model = CalibratedSimulator(plant, ["d"], bounds={"d": (0.4, 1.0)}).fit(X, y, groups=groups)
    assert model.params_["d"] == pytest.approx(0.4)
    assert plant.params["d"] == 0.5 and clone(model).simulator.params["d"] == 0.5


@pytest.mark.parametrize(
    ("model", "error", "message"),
    [
        (CalibratedSimulator(_plant(), ["nope"]), SimulatorError, "no parameter 'nope'"),
        (CalibratedSimulator(_plant(), ["d"], bounds={"a": (0, 1)}), DataError, "not fitted"),
        (CalibratedSimulator(_plant(), ["d"], bounds={"d": (1, 0)}), DataError, "low < high"),
        (CalibratedSimulator(CallableSimulator(np.sin)), SimulatorError, "trajectories only"),
    ],
)
def test_mistakes_speak(model, error, message):
    with pytest.raises(error, match=message):
        model.fit(np.ones((10, 1)), np.ones(10))
