"""One of several effects taken out: the others stay as they are, and its exact twin is found from there."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._ode import OdeBackend
from sksurrogate.gap.screen._twins import Twin
from sksurrogate.gap.search._met_twins import about_as_much, twins_of, with_twin
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N = 0.1, 200
TANK = ODESimulator(
    lambda t, x, u, p: [p["lift"] * u[0] - 0.5 * x[0]],
    dt=DT, x0=[1.0], states=["level"], inputs=["pump"], outputs=["level"], params={"lift": 1.0},
)  # fmt: skip
EFFECTS = (CATALOGUE["quadratic_loss"]("level", "level"), CATALOGUE["input_gain"]("pump"))
TRUTH = (0.2, 0.15)


@pytest.fixture(scope="module")
def fitted():
    """The problem, and the candidate with both effects fitted."""
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(0.5, 2.0, N // 20), 20)[:, None] for _ in range(2)]
    whole = AugmentedSimulator(TANK, EFFECTS, [(value,) for value in TRUTH])
    Y = [whole.simulate(u).reshape(N, 1) + 0.005 * rng.normal(size=(N, 1)) for u in U]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * 2, DT)
    plant = describe(TANK, n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("level",))
    return problem, problem.fit(EFFECTS, np.array(TRUTH), smoothed.x)


@pytest.mark.parametrize("i", [0, 1])
def test_the_others_keep_their_values_and_the_cost_rises(fitted, i):
    _problem, candidate = fitted
    rest = candidate.taken_out(i)
    assert rest.effects == (EFFECTS[1 - i],)
    assert np.array_equal(rest.fit.theta, candidate.fit.theta[[1 - i]])
    assert rest.fit.cost > 3.0 * candidate.fit.cost


def test_the_exact_twin_is_found_from_there(fitted):
    problem, candidate = fitted
    search = OdeSearch(problem, [EFFECTS[1], CATALOGUE["parameter_error"]("lift")], candidate.fit.x)
    search.fit_null()
    search.judge(estimate_noise(candidate, search.fitted_null.noise))
    found = next(with_twin(search, candidate, twin) for twin in twins_of(search, candidate) if twin.places == (1,))
    assert found.effects[-1].name == "parameter_error"
    assert found.fit.cost == pytest.approx(candidate.fit.cost, rel=1e-6)
    assert found.fit.theta == pytest.approx(candidate.fit.theta, rel=1e-3)


def test_a_twin_that_cannot_come_near_is_abandoned(fitted):
    problem, candidate = fitted
    search = OdeSearch(problem, list(EFFECTS), candidate.fit.x)
    twin = Twin((0, 1), CATALOGUE["input_lag"]("pump"), np.array([1.0]), 0.0)
    found = with_twin(search, candidate, twin)
    whole = problem.fit((twin.effect,), twin.theta, candidate.states, open_steps=0)
    assert whole.fit.cost > 3.0 * about_as_much(candidate.fit.cost)
    assert found.fit.n_iterations < whole.fit.n_iterations


def test_a_set_that_is_fitted_again_is_as_near_to_the_data_as_it_was(fitted, monkeypatch):
    """Of a quantizer a refit may end at another step; the set was fitted before."""
    problem, candidate = fitted
    search = OdeSearch(problem, list(EFFECTS), candidate.fit.x)
    near, astray, fit = search.refitted_without(candidate, 1), candidate.taken_out(1), OdeBackend.fit
    assert astray.fit.cost > 1.5 * near.fit.cost
    monkeypatch.setattr(
        OdeBackend,
        "fit",
        lambda self, effects, theta, x, **options: fit(self, effects, theta, x, **options) if options else astray,
    )
    search.smaller.clear()  # what was fitted before is not fitted again
    assert search.refitted_without(candidate, 1).fit.cost == astray.fit.cost
    search.remember([near])
    assert search.refitted_without(candidate, 1).fit.cost == pytest.approx(near.fit.cost, rel=1e-3)


def test_a_refit_on_some_runs_that_went_astray_begins_where_all_runs_ended(fitted, monkeypatch):
    """One Gauss-Newton step may lead to where the free run goes another way."""
    problem, candidate = fitted
    some, rows = problem.on([1]), problem.record.run_of_row == 1
    near, fit = candidate.on_some(some, rows), OdeBackend.fit
    starts = []

    def followed(self, effects, theta, x, **how):
        starts.append(theta)
        found = fit(self, effects, theta, x, **how)
        return replace(found, fit=replace(found.fit, cost=1e4 * found.fit.cost)) if len(starts) == 1 else found

    monkeypatch.setattr(OdeBackend, "fit", followed)
    again = candidate.on_some(some, rows)
    assert len(starts) == 2 and np.array_equal(starts[1], candidate.fit.theta)
    assert again.fit.theta == pytest.approx(near.fit.theta, rel=1e-3)
