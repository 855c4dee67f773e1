"""Effects that only shape the curve of another are found by their intervals, or by what they move."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.decide import _one_curve
from sksurrogate.gap.decide._one_curve import redundant_effect
from sksurrogate.gap.unnamed._law_evidence import place_and_signal

V = np.linspace(0.5, 2.0, 80)


def named(*effects, theta, columns):
    """A set with one parameter for each effect, that moves one output by given columns."""
    J = np.stack(columns)[None]
    candidate = SimpleNamespace(
        effects=effects,
        columns=lambda: (None, J),
        slice_of=lambda i: slice(i, i + 1),
        theta_of=lambda i: theta[i : i + 1],
    )
    return SimpleNamespace(candidate=candidate, fit=SimpleNamespace(theta=np.array(theta)))


def sure(monkeypatch, theta, half):
    monkeypatch.setattr(_one_curve, "intervals", lambda final: (np.array(theta) - half, np.array(theta) + half))


LOSS, SQUARE, OTHER = (
    CATALOGUE[name]("x", v) for name, v in (("linear_loss", "x"), ("quadratic_loss", "x"), ("quadratic_loss", "y"))
)


def test_the_one_whose_interval_holds_zero_is_it_the_widest_first(monkeypatch):
    theta = [1.0, 0.4]
    final = named(LOSS, SQUARE, theta=theta, columns=[-V, -(V**2)])
    sure(monkeypatch, theta, np.array([0.1, 0.1]))
    assert redundant_effect(final) is None
    sure(monkeypatch, theta, np.array([0.1, 0.5]))
    assert redundant_effect(final) == 1
    sure(monkeypatch, theta, np.array([3.5, 0.5]))
    assert redundant_effect(final) == 0


def test_so_is_one_at_the_bound_where_it_does_nothing(monkeypatch):
    dead_zone, ramp = CATALOGUE["input_dead_zone"]("u"), CATALOGUE["rate_limit"]("u")
    final = named(LOSS, dead_zone, theta=[1.0, 0.0], columns=[-V, 0.0 * V])
    sure(monkeypatch, [1.0, 0.3], np.array([0.1, 0.3]))
    assert redundant_effect(final) == 1
    final = named(LOSS, ramp, theta=[1.0, 0.3], columns=[-V, -(V**2)])
    assert redundant_effect(final) is None  # nothing is limited at infinity


@pytest.mark.parametrize(("second", "answer"), [(-0.6, 1), (-0.75, 1), (-0.2, None), (0.6, None)])
def test_of_two_that_cancel_each_other_the_smaller_is_it(monkeypatch, second, answer):
    theta = [1.0, second]
    sure(monkeypatch, theta, np.array([0.01, 0.01]))
    final = named(LOSS, SQUARE, theta=theta, columns=[-V, -(V**2)])
    parts = np.array([-V, -second * V**2])
    sizes = np.linalg.norm(parts, axis=1)
    assert (np.linalg.norm(parts.sum(axis=0)) < sizes.min()) == (answer is not None)
    assert redundant_effect(final) == (None if answer is None else int(np.argmin(sizes)))


def test_effects_of_two_signals_may_cancel_each_other(monkeypatch):
    theta = [1.0, -0.6]
    sure(monkeypatch, theta, np.array([0.01, 0.01]))
    assert redundant_effect(named(LOSS, OTHER, theta=theta, columns=[-V, -(V**2)])) is None


def test_an_input_effect_is_driven_by_its_input():
    assert (
        place_and_signal(CATALOGUE["input_curve"]("u"))
        == ("u", "u")
        == place_and_signal(CATALOGUE["linear_loss"]("u", "u"))
    )
