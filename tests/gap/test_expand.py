"""Which fits are made, and which are known already."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate import GapDiagnoser
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._ode import Numerics
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._set_moves import SetMoves
from sksurrogate.physics import ODESimulator

PROBLEM = SimpleNamespace(record=SimpleNamespace(y=np.zeros((1, 10)), n_values=0), numerics=Numerics(1))
BASE = SimpleNamespace(effects=(), keys=(), fit=SimpleNamespace(cost=1000.0), problem=PROBLEM)


def lag(variable):
    return CATALOGUE["hidden_relaxation"]("v", variable)


def candidate(effect, cost, n_sub=1):
    return SimpleNamespace(
        effects=(effect,), keys=(effect.key,), fit=SimpleNamespace(cost=cost),
        problem=SimpleNamespace(numerics=Numerics(n_sub)), theta_of=lambda i: np.array([1.0, 2.0]),
    )  # fmt: skip


@pytest.fixture
def expander(monkeypatch):
    monkeypatch.setattr(OdeSearch, "searching", lambda self, base: PROBLEM)
    return OdeSearch(
        PROBLEM, [lag("q"), lag("v"), lag("f"), lag("w"), CATALOGUE["linear_loss"]("v", "v")], np.zeros((2, 10))
    )


def test_siblings_that_were_fitted_with_these_numerics_are_not_fitted_again(monkeypatch, expander):
    asked = []
    monkeypatch.setattr(OdeSearch, "shaped", lambda self, *given: asked.append(given) or [])
    known, coarse = candidate(lag("v"), 300.0), candidate(lag("f"), 400.0, n_sub=2)
    expander.remember([known, coarse])
    found = expander.siblings([candidate(lag("q"), 20.0)], BASE)
    assert found == [known]
    ((_, others, shape, best),) = asked
    assert [e.variable for e in others] == ["f", "w"]
    assert (shape, best) == ((2.0,), 20.0)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_every_effect_has_the_cheapest_of_its_starts_and_the_first_is_what_others_must_come_near_to(monkeypatch, n):
    """Of few effects, and of the first of many, every start is fitted apart."""
    asked = []

    def fit_apart(self, base, chosen, best):
        asked.extend((len(starts), best) for starts in chosen)
        return [candidate(starts[0].effect, min(start.cost for start in starts)) for starts in chosen]

    monkeypatch.setattr(OdeSearch, "fit_apart", fit_apart)
    monkeypatch.setattr(OdeSearch, "plausible", lambda self, candidate: True)
    effects = [lag(f"x{k}") for k in range(n)]
    chosen = [[SimpleNamespace(effect=e, cost=10.0 * k + c) for c in (3, 1, 2)] for k, e in enumerate(effects)]
    found = OdeSearch(PROBLEM, effects, np.zeros((2, 10))).fit_all(BASE, chosen)
    assert [(r.effects[0], r.fit.cost) for r in found] == [(e, 10.0 * k + 1.0) for k, e in enumerate(effects)]
    apart = 3 * (n if n <= 2 else 1)
    assert asked == [(1, 1000.0)] * apart + [(3, 1.0)] * (n - apart // 3)


@pytest.mark.parametrize(
    ("expected", "fitted"),
    [
        ({"first": 5.0, "near": 49.0, "far": 51.0, "shown": 900.0}, ["first", "near", "shown"]),
        # The screen expected the first to leave forty times the noise: it may be as wrong about others, up to twice that.
        ({"first": 400.0, "near": 799.0, "far": 801.0}, ["first", "near"]),
    ],
)
def test_beside_one_at_the_noise_those_far_from_the_data_are_not_fitted(monkeypatch, expected, fitted):
    """Of ten values a cost of 1 is at the noise; what the screen expects to leave 50 or more is far, but for what readings show."""
    asked = []

    def fit_apart(self, base, chosen, best):
        asked.extend(starts[0].effect.variable for starts in chosen)
        return [candidate(starts[0].effect, 1.0) for starts in chosen]

    monkeypatch.setattr(OdeSearch, "fit_apart", fit_apart)
    monkeypatch.setattr(OdeSearch, "plausible", lambda self, candidate: True)
    effects = [lag(name) for name in expected]
    chosen = [
        [SimpleNamespace(effect=e, left=left, evident=e.variable == "shown")]
        for e, left in zip(effects, expected.values())
    ]
    record = SimpleNamespace(y=np.zeros((1, 10)), n_values=10)
    search = OdeSearch(SimpleNamespace(record=record, numerics=Numerics(1)), effects, np.zeros((2, 10)))
    search.fit_all(BASE, chosen)
    assert asked == fitted


@pytest.mark.slow
def test_a_large_error_of_one_parameter_is_named_where_a_richer_form_reached_the_noise_first():
    """The rate is 60 for 100: the screen expects thirty times the noise from its error, and from its step in time as well."""
    X, y, runs = make_reactor_runs(3, 60, noise=0.02, random_state=0)
    report = GapDiagnoser(make_reactor(second=60.0), random_state=0).fit(X, y, groups=runs).report_
    assert [(effect.name, effect.location) for effect in report.effects] == [("parameter_error", "second")]
    assert report.effects[0].params["relative_error"] == pytest.approx(2 / 3, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_form_that_is_not_plausible_keeps_no_other_out(seed):
    """A dry friction that is no larger at rest, measured by its position: Stribeck's curve is fitted first, and comes to the noise."""

    def spring(level):
        return ODESimulator(
            lambda t, x, u, p: [x[1], u[0] - x[0] - 0.3 * x[1] - level * np.tanh(x[1] / 1e-3)],
            states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=0.01 if level else 0.1,
        )  # fmt: skip

    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-2, 2, (6, 30)), 10, axis=1)
    Y = np.concatenate([spring(0.3).simulate(np.repeat(u, 10)[:, None])[::10] for u in U])
    Y = Y + 0.005 * rng.normal(size=Y.shape)
    report = (
        GapDiagnoser(spring(0.0), random_state=0, n_jobs=1)
        .fit(U.reshape(-1, 1), Y, groups=np.repeat(np.arange(6), 300))
        .report_
    )
    assert report.verdict == "explained"
    assert [effect.name for effect in report.effects] == ["coulomb_friction"]
    assert report.effects[0].params["level"] == pytest.approx(0.3, abs=0.005)


@pytest.mark.parametrize(
    ("costs", "far", "leads"),
    [
        ({"delay": 2646.0, "lag": 12449.0}, False, True),
        ({"delay": 2646.0}, False, True),  # the own one ran away
        ({"delay": 2646.0, "lag": 3000.0}, False, False),
        ({"lag": 1300.0, "delay": 2646.0}, False, False),
        ({"delay": 2646.0, "lag": 12449.0}, True, False),
    ],
)
def test_what_comes_nearer_in_the_same_few_steps_is_fitted_to_the_end(costs, far, leads):
    """Few steps do not tell a set from one that was fitted to the end; they tell it from that one fitted again in as many."""
    trial = [SimpleNamespace(keys=(name,), fit=SimpleNamespace(cost=cost)) for name, cost in costs.items()]
    named = SimpleNamespace(keys=("lag",), fit=SimpleNamespace(cost=1260.0))
    search = SimpleNamespace(is_far=lambda candidate: far)
    assert SetMoves.leads_its_place(search, trial, named) is leads


def test_effects_without_any_fit_are_known_by_name_where_the_simulator_raised():
    search = SimpleNamespace(lost={}, unfitted={}, fitted={})
    for variable in ("u", "w"):
        assert OdeSearch.from_message(search, BASE, [lag(variable)], "ValueError: the level is negative") is None
    assert OdeSearch.from_message(search, BASE, [lag("x")], None) is None  # it diverged by itself
    search.fitted[frozenset([lag("w").key])] = None  # from another start
    assert OdeSearch.never_fitted(search) == ["hidden relaxation at v, driven by u"]
