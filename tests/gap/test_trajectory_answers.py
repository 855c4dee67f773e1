"""What a simulator with ``simulate`` alone is told when work is cut short, when nothing fits, and when effects are tied."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap._around_questions import AroundQuestions
from sksurrogate.gap._verdict import decide


class FirstOrder:
    """A callable plant without names, states or right-hand side."""

    inputs, outputs, dt = ("u",), ("y",), 0.1

    def simulate(self, U, x0=None, t=None):
        y = np.zeros(len(U))
        for k in range(len(U) - 1):
            y[k + 1] = y[k] + (1 - np.exp(-0.1)) * (U[k, 0] - y[k])
        return y[:, None]


def measured(seen, seed=0):
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-1, 1, 80), 5)[:, None]
    groups = np.repeat([0, 1], 200)
    Y = np.concatenate([FirstOrder().simulate(U[groups == run]) for run in (0, 1)])
    return U, seen(Y) + 0.005 * rng.normal(size=Y.shape), groups


def test_an_interrupt_before_the_certificate_names_nothing_for_certain(monkeypatch):
    def stopped(self, final):
        raise KeyboardInterrupt

    monkeypatch.setattr(AroundQuestions, "held_out", stopped)
    X, y, groups = measured(lambda y: y + 0.2)
    with pytest.warns(UserWarning, match="interrupted"):
        report = (
            GapDiagnoser(FirstOrder(), effects=["sensor_bias", "sensor_lag"], random_state=0)
            .fit(X, y, groups=groups)
            .report_
        )
    assert (report.verdict, report.complete) == ("unknown", False)


def test_a_law_that_is_not_asked_for_is_unknown():
    X, y, groups = measured(lambda y: y + 0.5 * y**3)
    report = (
        GapDiagnoser(FirstOrder(), effects=["sensor_bias", "sensor_drift"], random_state=0)
        .fit(X, y, groups=groups)
        .report_
    )
    assert report.verdict == "unknown"
    assert report.where.location in {"u", "y"}


def test_gains_of_the_input_and_the_sensor_of_a_linear_plant_are_tied_and_it_says_so():
    X, y, groups = measured(lambda y: 1.3 * y)
    report = (
        GapDiagnoser(FirstOrder(), effects=["sensor_gain", "input_gain"], random_state=0)
        .fit(X, y, groups=groups)
        .report_
    )
    (effect,) = report.effects
    assert report.verdict == "explained" and len(effect.equivalents) == 1
    assert "they part in none of the experiments tried here" in effect.why
    assert effect.probability == pytest.approx(0.5, abs=0.05)
    assert report.next_experiment.parted == ()


def test_the_verdict_knows_how_many_effects_are_named(monkeypatch):
    asked = []

    def spy(facts):
        asked.append(facts)
        return decide(facts)

    monkeypatch.setattr("sksurrogate.gap._trajectory.decide", spy)
    X, y, groups = measured(lambda y: 1.3 * y + 0.4)
    diagnoser = GapDiagnoser(FirstOrder(), effects=["sensor_gain", "sensor_bias"], random_state=0)
    report = diagnoser.fit(X, y, groups=groups).report_
    assert {effect.name for effect in report.effects} == {"sensor_gain", "sensor_bias"}
    assert {facts.names for facts in asked} == {2}
