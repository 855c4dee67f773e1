"""A set of effects contains its subsets: its evidence is at least theirs less the price of what is added."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.physics import ODESimulator


def searched(monkeypatch, simulator, X, y, **options):
    """The search of a diagnosis, and its report."""
    kept, look_for_one = [], OdeSearch.look_for_one

    def remembered(self):
        kept.append(self)
        return look_for_one(self)

    monkeypatch.setattr(OdeSearch, "look_for_one", remembered)
    report = GapDiagnoser(simulator, random_state=0, n_jobs=1, **options).fit(X, y).report_
    return kept[-1], report


def shortfalls(search):
    """What sets, each by its likeliest candidate, lack to their subsets, price included.

    Those far from the data are left out: no noise model holds there.
    """
    best = {frozenset(): search.fitted_null.candidate}
    for candidate in search.judged:
        key = frozenset(candidate.keys)
        if not search.is_far(candidate) and (
            key not in best or search.evidence(candidate) > search.evidence(best[key])
        ):
            best[key] = candidate
    for key, larger in best.items():
        for part in (part for part in best if part < key):
            added = sum(len(effect.parameters) for effect in larger.effects if effect.key not in part)
            yield search.evidence(best[part]) - 0.5 * search.threshold(added) - search.evidence(larger)


def leaking(t):
    """Level of a tank that runs out through an orifice: its root falls at one rate."""
    return np.maximum(1.0 - 0.015 * t, 0.0) ** 2


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_interpolated_readings_of_a_tank_that_leaks_by_a_root_law(monkeypatch, noise):
    """45 rows interpolated from 15 readings look as if they had no noise; the one free parameter belongs to a term that the
    plant does not have."""
    rng = np.random.default_rng(1)
    read = np.linspace(0, 44, 15)
    y = np.interp(np.arange(45), read, leaking(read) + noise * rng.normal(size=15))
    tank = ODESimulator(
        lambda t, x, u, p: (-p["k"] * x[0],),
        states=["h"],
        inputs=[],
        outputs=["h"],
        params={"k": 0.01},
        dt=1.0,
        x0=[1.0],
    )
    options = {"effects": ["linear_loss", "sqrt_leak", "power_law", "coulomb_friction", "sensor_bias", "drift"]}
    search, report = searched(monkeypatch, tank, None, y, free_params=["k"], **options)
    evidence = {row["name"]: row["evidence"] for row in report.ranking}
    assert evidence["sqrt_leak"] > 10.0 and evidence["power_law"] > 10.0
    assert report.effects[0].name in ("sqrt_leak", "power_law")
    assert "shift" not in report.data.kinds  # without an input a shift is another initial state
    assert max(shortfalls(search), default=0.0) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_plants_with_a_parameter_far_off(monkeypatch, seed):
    rng = np.random.default_rng(seed)
    stiff, drag = rng.uniform(1.0, 4.0), rng.uniform(0.0, 1.0)
    params = {"k": stiff * np.exp(rng.normal()), "c": 0.3, "d": 0.0}

    def plant(**changed):
        def rhs(t, x, u, p):
            return x[1], u[0] - p["k"] * x[0] - p["c"] * x[1] - p["d"] * x[1] * abs(x[1])

        names = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"]}
        return ODESimulator(rhs, **names, params={**params, **changed}, dt=0.1)

    U = np.repeat(rng.normal(size=30), 8)[:, None]
    y = plant(k=stiff, d=drag).simulate(U) + rng.choice([1e-5, 1e-2]) * rng.normal(size=(240, 1))
    options = {"effects": ["linear_loss", "quadratic_drag", "cubic_stiffness", "input_gain", "sensor_bias"]}
    search, _ = searched(monkeypatch, plant(), U, y, free_params=["k"], **options)
    assert max(shortfalls(search), default=0.0) < 0.5
