"""The probability of a name among its candidates, none, and a law without a name."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.blind import draw
from sksurrogate.effects._balance import ConstantBias, LinearLoss
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._equivalence import EquivalenceClass, Twin, probabilities
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.search._base import EQUAL
from sksurrogate.physics import ODESimulator


def candidate(*effects, value):
    keys = tuple(effect.key for effect in effects)
    return SimpleNamespace(effects=effects, keys=keys, n_parameters=len(effects), value=value)


def chance(twins=(), rejected=(), null=-500.0, posterior=1.0, elsewhere=()):
    final = candidate(ConstantBias("speed"), value=0.0)
    fitted = {frozenset(one.keys): one for one in (final, *twins, *rejected)}
    null = SimpleNamespace(candidate=candidate(value=null))
    search = SimpleNamespace(score=lambda one: one.value, own=lambda one: one, null=null, fitted=fitted, n_values=100)
    asked = Posterior((posterior,), None, elsewhere=tuple(elsewhere))
    (found,) = probabilities(search, final, [EquivalenceClass(0, [Twin(one, True) for one in twins])], asked)
    return found


def test_alone_it_is_certain_and_a_twin_counts_for_its_class():
    assert chance() == pytest.approx(1.0)
    assert chance([candidate(LinearLoss("speed", "speed"), value=np.log(0.25))]) == pytest.approx(1.0)


def test_none_and_a_law_without_a_name_count_against_it():
    assert chance(posterior=0.25) == pytest.approx(0.25)
    other = candidate(LinearLoss("speed", "speed"), value=100.0)
    assert chance(rejected=[other], posterior=0.6) == pytest.approx(0.6 / (1.0 + np.exp(-EQUAL)))


def test_a_rejected_candidate_counts_as_little_as_its_finer_fit_said():
    other = candidate(LinearLoss("speed", "speed"), value=100.0)
    assert chance(rejected=[other]) == pytest.approx(1.0 / (1.0 + np.exp(-EQUAL)))
    two = candidate(LinearLoss("speed", "speed"), LinearLoss("speed", "load"), value=100.0)
    assert chance(rejected=[two]) == pytest.approx(1.0)


def test_sets_of_other_effects_count_by_their_evidence():
    others = frozenset({("linear_loss", "load", "load"), ("sensor_gain", "speed", None)})
    assert chance(elsewhere=[(others, 0.0)]) == pytest.approx(0.5)
    assert chance(elsewhere=[(others, np.log(3.0))]) == pytest.approx(0.25)
    assert chance(elsewhere=[(others, -1.0), (others, -2.0)]) == pytest.approx(1.0 / (1.0 + np.exp(-1) + np.exp(-2)))


def test_sets_that_hold_the_effect_or_one_of_its_class_do_not_count_against_it():
    twin = candidate(LinearLoss("speed", "speed"), value=0.0)
    own, of_class = ConstantBias("speed").key, LinearLoss("speed", "speed").key
    load = ("linear_loss", "load", "load")
    assert chance(elsewhere=[(frozenset({own, load}), 5.0)]) == pytest.approx(1.0)
    assert chance([twin], elsewhere=[(frozenset({of_class, load}), 5.0)]) == pytest.approx(1.0)


@pytest.mark.slow
def test_of_three_effects_that_others_imitate_those_that_are_certain_stand_alone():
    """A leak at the temperature, a dead zone of the flow, a delay: other sets of three do as well, all of them with the delay."""
    case = draw("three", 10744914760864393896)
    asked = case.question
    diagnoser = GapDiagnoser(asked.simulator, effects=asked.effects, free_params=asked.free_params, random_state=0)
    report = diagnoser.fit(asked.X, asked.y, groups=asked.groups).report_
    assert report.reasons.features["probability"] > 0.9  # the evidence that each, or one of its class, acts
    (other,) = (effect for effect in report.effects if effect.name != "input_delay")
    assert len(report.effects) == 2 and other.probability < 0.9  # beside a rest that something else makes
    # The temperature hardly moves, and the flow is always beyond its dead zone: both are constants.
    constants = {("input_bias", "flow", None), ("constant_bias", "temperature", None)}
    assert constants & {(other.name, other.location, other.variable), *other.equivalents}


@pytest.mark.slow
def test_a_name_in_an_inexact_form_is_compared_with_two_others_each_beside_its_law():
    """A gain c x/(K + x) for a linear one: a constant and a wrong drain bend as it does, and without a law are 30 nats likelier."""
    asked = draw("inexact", 2913836764855415906).question
    diagnoser = GapDiagnoser(asked.simulator, free_params=asked.free_params, random_state=0, n_jobs=1)
    report = diagnoser.fit(asked.X, asked.y, groups=asked.groups).report_
    (named,) = report.effects
    assert (named.name, named.location) == ("linear_loss", "lower") and report.verdict == "explained"
    assert named.probability > 0.9


@pytest.mark.slow
def test_of_two_exact_effects_of_one_signal_a_curve_of_it_takes_none():
    """Dry friction and drag of a pendulum: a curve of the speed in the place of the drag is the drag."""

    def pendulum(dry, drag):
        def rhs(t, x, u, p):
            w = x[1]
            return w, u[0] - 12 * np.sin(x[0]) - 0.05 * w - drag * w * np.abs(w) - dry * np.tanh(w / 0.03)

        return ODESimulator(rhs, states=["th", "w"], inputs=["tau"], outputs=["th"], params={}, dt=0.02)

    rng, runs = np.random.default_rng(1), []
    for _ in range(4):
        u = np.repeat(rng.uniform(-5, 5, 15), 20)[:, None]
        runs.append((u, pendulum(0.5, 0.12).simulate(u, x0=0.6 * rng.normal(size=2))))
    X, y = (np.concatenate(one) for one in zip(*runs))
    y = y + 0.004 * y.std() * rng.normal(size=y.shape)
    names = ["coulomb_friction", "quadratic_drag", "linear_loss"]
    diagnoser = GapDiagnoser(pendulum(0.0, 0.0), effects=names, random_state=0, n_jobs=1)
    report = diagnoser.fit(X, y, groups=np.repeat(np.arange(4), 300)).report_
    found = {effect.name: effect for effect in report.effects}
    assert set(found) == {"coulomb_friction", "quadratic_drag"} and report.verdict == "explained"
    assert report.reasons.features["probability"] > 0.99 and min(effect.probability for effect in report.effects) > 0.9
    assert found["quadratic_drag"].params["coefficient"] == pytest.approx(0.12, rel=0.02)
