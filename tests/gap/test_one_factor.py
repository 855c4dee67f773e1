"""Parameters that act alike are one factor: a curved factor is not two parameters."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._one_factor import is_same_factor, parts_of_one_factor
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, RUNS, N = 1.0, 4, 200


def tank(**params):
    """A vessel that loses heat over ``UA``, with a heat capacity ``C`` and a gain ``k`` of the heater."""
    rhs = lambda t, x, u, p: [(p["k"] * u[0] - p["UA"] * x[0]) / p["C"]]  # noqa: E731
    known = {"UA": 2.0, "C": 20.0, "k": 10.0}
    return ODESimulator(rhs, states=["T"], inputs=["u"], outputs=["T"], params={**known, **params}, dt=DT)


def exchanger(**params):
    """A stream whose temperature follows ``UA / cp`` alone."""
    rhs = lambda t, x, u, p: [u[0] - p["UA"] / p["cp"] * x[0]]  # noqa: E731
    return ODESimulator(rhs, states=["T"], inputs=["u"], outputs=["T"], params={"UA": 2.0, "cp": 20.0, **params}, dt=DT)


def inputs():
    return np.repeat(np.random.default_rng(0).uniform(0.5, 3.0, (RUNS, N // 10)), 10, axis=1)


def recorded(factor):
    """Runs of an exchanger whose ``UA`` is multiplied by a function of time, fine steps."""
    rng, out = np.random.default_rng(1), []
    for u in inputs():
        x = [10.0]
        for k in range(N - 1):
            z = x[-1]
            for j in range(20):
                z += DT / 20 * (u[k] - 0.1 * factor(DT * (k + j / 20)) * z)
            x.append(z)
        out.append(np.array(x) + 0.05 * rng.normal(size=N))
    return inputs().reshape(-1, 1), np.concatenate(out), np.repeat(np.arange(RUNS), N)


def fitted(simulator, *effects):
    U, y, groups = recorded(lambda t: 1.0 - 1e-3 * t)
    runs = [groups == k for k in range(RUNS)]
    record = Record.from_runs([U[k] for k in runs], [y[k, None] for k in runs], [DT * np.arange(N)] * RUNS, DT)
    plant = describe(simulator, n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("T",))
    start = np.concatenate([np.full(len(effect.parameters), 1e-4) for effect in effects])
    return problem.fit(effects, start, smoothed.x)


def test_drifts_of_a_quotient_are_one_factor():
    drift = CATALOGUE["parameter_drift"]
    both = fitted(exchanger(), drift("UA"), drift("cp"))
    assert parts_of_one_factor(both, 0.1) == [0, 1]
    one, other = fitted(exchanger(), drift("UA")), fitted(exchanger(), drift("cp"))
    assert is_same_factor(one, other, 0, 0.1) and is_same_factor(other, one, 0, 0.1)


@pytest.mark.parametrize("names", [("parameter_drift", "parameter_error"), ("parameter_error", "parameter_error")])
def test_errors_that_stay_are_two(names):
    """A drift and an error that stays follow no common signal, nor do two errors: they are not parts of a curve."""
    both = fitted(exchanger(), *(CATALOGUE[name](place) for name, place in zip(names, ("UA", "cp"))))
    assert parts_of_one_factor(both, 0.1) == []


def test_drifts_that_act_otherwise_are_two():
    """The loss and the gain of a heater move its temperature in other ways."""
    drift = CATALOGUE["parameter_drift"]
    assert parts_of_one_factor(fitted(tank(), drift("UA"), drift("k")), 0.1) == []
    assert not is_same_factor(fitted(tank(), drift("UA")), fitted(tank(), drift("k")), 0, 0.1)


@pytest.mark.slow
def test_a_curved_factor_is_one_name():
    """A factor that falls and settles, as fouling does: two drifts of a quotient would follow it to the noise."""
    U, y, groups = recorded(lambda t: 1.0 / (1.0 + 0.2 * (1.0 - np.exp(-t / 90.0))))
    report = GapDiagnoser(exchanger(), random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
    drifts = [effect for effect in report.effects if effect.name == "parameter_drift"]
    assert len(drifts) < 2
    for effect in drifts:
        other = "cp" if effect.location == "UA" else "UA"
        assert ("parameter_drift", other, None) in effect.equivalents
