"""Which names stand: the prior of names, the practical bar, the noise under which a smaller set is judged."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide import _posterior
from sksurrogate.gap.decide._contenders import Contender, log_prior, preferred
from sksurrogate.gap.decide._posterior import Posterior, _of_classes, law_left_beside
from sksurrogate.gap.fit._evidence import CERTAIN
from sksurrogate.physics import ODESimulator


def effect(name, location="speed", variable=None):
    return CATALOGUE[name](location, variable)


def test_the_priors_of_all_single_names_sum_to_one():
    library = [effect("coulomb_friction", variable="speed"), effect("hysteresis", variable="place"), effect("drift")]
    assert sum(np.exp(log_prior([one], library, ["place"])) for one in library) == pytest.approx(1.0)


def test_the_prior_of_a_set_is_the_product_of_its_names():
    library = [effect("coulomb_friction", variable="speed"), effect("drift"), effect("constant_bias")]
    one, two = log_prior(library[:1], library), log_prior(library[1:2], library)
    assert log_prior(library[:2], library) == pytest.approx(one + two)


@pytest.mark.parametrize(
    ("common", "special"),
    [
        (("linear_loss", "speed"), ("linear_loss", "flow")),  # a law of its own state
        (("cubic_stiffness", "place"), ("cubic_stiffness", "flow")),  # a spring at a position
        (("constant_bias", None), ("step_disturbance", None)),  # no clock
        (("coulomb_friction", "speed"), ("lugre_friction", "speed")),  # no state of its own
    ],
)
def test_common_effects_with_natural_drivers_are_more_probable(common, special):
    weights = [effect(name, variable=v).prior_weight(["place"]) for name, v in (common, special)]
    assert weights[0] == pytest.approx(10.0 * weights[1])


def _falling(t, x, u, p):
    return x[1], -9.81 - p["drag"] * x[1] * np.abs(x[1]) - p["linear"] * x[1] + 0.0 * x[0]


@pytest.fixture(scope="module")
def ball():
    """A light ball whose drag is not a form of the catalogue (power 1.7), filmed at 15 Hz."""

    def plant(t, x, u, p):
        return x[1], -9.81 - 0.12 * np.sign(x[1]) * np.abs(x[1]) ** 1.7 + 0.0 * x[0]

    names = {"states": ["height", "velocity"], "inputs": [], "outputs": ["height"], "dt": 1 / 15}
    real = ODESimulator(plant, params={}, x0=[48.0, 0.0], **names)
    nominal = ODESimulator(_falling, params={"drag": 0.0, "linear": 0.0}, x0=[48.0, 0.0], **names)
    X = np.zeros((60, 0))
    y = real.simulate(X) + 0.05 * np.random.default_rng(4).normal(size=(60, 1))
    return nominal, X, y


@pytest.mark.slow
def test_few_readings_of_an_inexact_drag_are_named_by_a_loss_of_the_velocity(ball):
    nominal, X, y = ball
    report = GapDiagnoser(nominal, random_state=0, n_jobs=1).fit(X, y).report_
    assert report.verdict in ("explained", "partial")
    (named,) = report.effects
    assert named.location == "velocity" and named.variable == "velocity"
    assert named.name in ("linear_loss", "quadratic_drag", "power_law", "quadratic_loss")


def _tank(t, x, u, p):
    return (u[0] - p["k"] * np.sqrt(np.maximum(x[0], 0.0)),)


@pytest.fixture(scope="module")
def nearly():
    """A level whose loss has nearly the catalogue's form (power 1.9) beside the simulator's outflow, four runs."""

    def plant(t, x, u, p):
        return (u[0] - np.sqrt(np.maximum(x[0], 0.0)) - 0.05 * np.abs(x[0]) ** 1.9,)

    names = {"states": ["level"], "inputs": ["flow"], "outputs": ["level"], "dt": 0.2}
    real = ODESimulator(plant, params={}, x0=[1.0], **names)
    rng = np.random.default_rng(8)
    X = np.repeat(rng.uniform(0.5, 4.0, 80), 10)[:, None]
    runs = np.repeat(np.arange(4), 200)
    y = np.concatenate([real.simulate(X[runs == k]) for k in range(4)]) + 0.003 * rng.normal(size=(800, 1))
    return ODESimulator(_tank, params={"k": 1.0}, x0=[1.0], **names), X, y, runs


@pytest.mark.slow
def test_a_name_of_nearly_the_right_form_stands_alone_and_closes_the_gap(nearly):
    simulator, X, y, runs = nearly
    diagnoser = GapDiagnoser(simulator, random_state=0, n_jobs=1).fit(X, y, groups=runs)
    report = diagnoser.report_
    assert report.verdict == "explained"
    (named,) = report.effects
    assert (named.location, named.variable) == ("level", "level")
    assert named.probability > 0.9 and report.shrink.fraction > 0.9
    assert report.shrink.same_names == 1.0  # a set under a noise that was not its own lost to others in single folds


def contender(net, before, *keys, cost=100.0):
    """A set of effects with these keys, its log evidence and what of it is known before any data; what it leaves by itself."""
    return Contender(net, before, SimpleNamespace(keys=keys, fit=SimpleNamespace(cost=cost)), None)


def test_of_sets_that_data_do_not_separate_the_likelier_before_any_data_is_named():
    own = contender(10.0, -9.0, "hysteresis")
    simple, rare = contender(9.0, -5.0, "loss"), contender(9.5, -12.0, "lag")
    assert preferred(own, [simple, rare]) is simple
    assert preferred(own, [contender(6.5, -5.0, "loss"), rare]) is own  # three nats separate
    assert preferred(own, [contender(11.0, -9.0, "twin")]) is own  # as likely as before: what stands stays
    assert preferred(own, [better := contender(14.0, -12.0, "lag")]) is better
    assert preferred(own, [contender(11.0, -9.0, "twin", cost=30.0)]) is own
    alike = [contender(9.5, -8.0, "gain"), likelier := contender(11.0, -8.0, "loss")]
    assert preferred(own, alike) is likelier  # of those as likely before, the likeliest with the data
    assert preferred(own, [near := contender(9.0, -9.0, "twin", cost=20.0)]) is near  # the law beside it does much less


def test_members_of_a_class_count_for_its_probability():
    own = contender(10.0, -5.0, "bias", "gain")
    others = [contender(9.0, -5.0, "bias", "drift"), contender(8.0, -5.0, "loss", "gain")]
    found = _of_classes(Posterior((0.6, 0.9), None), own, others)
    odds = [p / (1.0 - p) for p in found.probabilities]
    assert odds == pytest.approx([1.5 * (1.0 + np.exp(-2.0)), 9.0 * (1.0 + np.exp(-1.0))])
    assert [one.keys for one in found.as_likely] == [("bias", "drift"), ("loss", "gain")]


@pytest.mark.slow
def test_an_exact_name_does_not_fall_to_another_form_far_from_the_data_with_a_law():
    """Drag to the power 1.85: about the measured path, a law beside a cubic spring makes up for what no simulation reaches."""

    def speeds(c, d):
        def rhs(t, x, u, p):
            return x[1], u[0] - c * x[1] - d * np.sign(x[1]) * np.abs(x[1]) ** 1.85

        return ODESimulator(rhs, states=["s", "v"], inputs=["thrust"], outputs=["s", "v"], params={}, dt=0.1)

    rng, runs = np.random.default_rng(2), []
    for _ in range(4):
        u = np.repeat(rng.uniform(-1, 3, 15), 20)[:, None]
        runs.append((u, speeds(0.1, 0.15).simulate(u, x0=[0.0, rng.normal()])))
    X, y = (np.concatenate(one) for one in zip(*runs))
    y = y + 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    names = ["power_law", "quadratic_drag", "cubic_stiffness"]
    diagnoser = GapDiagnoser(speeds(0.1, 0.0), effects=names, random_state=0, n_jobs=1)
    report = diagnoser.fit(X, y, groups=np.repeat(np.arange(4), 300)).report_
    assert report.verdict == "explained" and [e.name for e in report.effects] == ["power_law"]
    assert report.effects[0].params["exponent"] == pytest.approx(1.85, abs=0.02)


@pytest.mark.parametrize(
    ("measured", "free", "counts"),
    [
        (None, None, None),
        (0.5, 2.0, "measured"),  # not certain: the free run is not asked
        (2.0, 3.0, "measured"),
        (2.0, None, "measured"),
        (2.0, 0.5, "free"),  # a law of the disturbance, which the free run does not hold
    ],
)
def test_a_law_that_is_certain_along_the_measured_path_must_be_so_along_the_free_run(
    measured, free, counts, monkeypatch
):
    gains, asked = {"measured": measured, "free": free}, []

    def law_along(search, question):
        asked.append("free" if question.path is None else "measured")
        gain = gains[asked[-1]]
        return None if gain is None else SimpleNamespace(left=SimpleNamespace(gain=gain * CERTAIN, path=asked[-1]))

    monkeypatch.setattr(_posterior, "law_along", law_along)
    problem = SimpleNamespace(plant=SimpleNamespace(states=["x"]), quiet=lambda noise: noise)
    null = SimpleNamespace(candidate=SimpleNamespace(problem=problem), noise=None)
    search = SimpleNamespace(fitted_null=null, x=np.zeros((2, 5)))
    found = law_left_beside(search, SimpleNamespace(effects=()))
    assert (found and found.path) == counts
    assert asked == (["measured", "free"] if measured and measured > 1.0 else ["measured"])
