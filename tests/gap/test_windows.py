"""Errors of parameters that end, limits that set in, effects within a window: named with their times."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.render._values import change_of
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.search._nested import richer
from sksurrogate.physics import ODESimulator

RUNS, N = 2, 300
EFFECTS = [
    "parameter_error", "parameter_step", "parameter_drift", "input_bias", "sensor_bias", "sensor_gain", "state_saturation",
    "overflow", "coulomb_friction", "linear_loss",
]  # fmt: skip


def oscillator(t, x, u, p):
    return x[1], p["gain"] * u[0] - 9.0 * x[0] - 0.6 * x[1]


def tanks(t, x, u, p):
    return u[0] - p["out"] * x[0], p["out"] * x[0] - 0.8 * x[1]


OSCILLATOR = ODESimulator(oscillator, states=["q", "v"], inputs=["F"], outputs=["q"], params={"gain": 1.0}, dt=0.05)
TANKS = ODESimulator(
    tanks, states=["h", "g"], inputs=["F"], outputs=["h", "g"], params={"out": 0.5}, dt=0.2, x0=[1.0, 0.7]
)


def diagnosed(simulator, effect, values):
    rng = np.random.default_rng(0)
    low, high, held = (-4.0, 4.0, 10) if simulator is OSCILLATOR else (0.0, 2.0, 15)
    U = np.repeat(rng.uniform(low, high, size=(RUNS, N // held, 1)), held, axis=1)
    plant = AugmentedSimulator(simulator, [effect], [values])
    Y = np.stack([plant.simulate(u) for u in U])
    Y = Y + 0.005 * np.std(Y, axis=(0, 1)) * rng.normal(size=Y.shape)
    diagnoser = GapDiagnoser(simulator, effects=EFFECTS, n_jobs=1, random_state=0)
    return diagnoser.fit(U.reshape(-1, 1), Y.reshape(-1, Y.shape[2]), groups=np.repeat(np.arange(RUNS), N)).report_


@pytest.mark.parametrize(
    ("simulator", "name", "place", "values"),
    [
        (OSCILLATOR, "parameter_error", ("gain",), {"relative_error": 0.3, "end": 8.33}),
        (OSCILLATOR, "parameter_error", ("gain",), {"relative_error": 0.3, "onset": 4.2, "end": 8.33}),
        (TANKS, "state_saturation", ("h",), {"limit": 2.0, "onset": 28.3}),
        pytest.param(
            OSCILLATOR, "coulomb_friction", ("v", "v"), {"level": 0.5, "onset": 4.2, "end": 8.33}, marks=pytest.mark.slow
        ),
        pytest.param(
            TANKS,
            "overflow",
            ("h", "g"),
            {"limit": 2.0, "share": 0.8, "onset": 28.3},
            # both levels jump where the overflow begins, as where runs are joined
            marks=[pytest.mark.slow, pytest.mark.filterwarnings("ignore:The readings of")],
        ),
    ],
)  # fmt: skip
def test_it_is_named_with_its_times(simulator, name, place, values):
    span = [key for key in values if key in ("onset", "end")]
    report = diagnosed(simulator, starting(CATALOGUE[name](*place), span), values)
    assert report.verdict == "explained"
    (effect,) = report.effects
    assert (effect.name, effect.location) == (name, place[0]) and list(effect.params) == list(values)
    for key in span:
        low, high = effect.intervals[key]
        assert low <= values[key] <= high and high - low < 0.02 * N * simulator.dt
    size = next(iter(values))
    assert effect.params[size] == pytest.approx(values[size], rel=0.01)
    assert ("from t = " in report.sentence) == ("onset" in span)
    assert ("until t = " in report.sentence) == ("end" in span)


def test_the_change_of_a_parameter_is_told_with_its_times():
    values, ends = {"relative_error": 0.25, "end": 3.0}, {"relative_error": (0.2, 0.3), "end": (2.9, 3.1)}
    effect = EffectEstimate("parameter_error", "length", None, 1.0, values, ends, 1.0)
    lines = change_of(effect, {"length": 2.0}, {"length": "m"})
    assert lines == ["length: 2 -> 2.5 m [2.4, 2.6]", "end: 3 [2.9, 3.1]"]


def test_an_error_that_ends_says_nothing_of_the_prior_of_its_parameter():
    known = KnownParameters(priors={"length": (2.0, 0.1)})
    always = CATALOGUE["parameter_error"]("length")
    for effect, held in ((always, True), (starting(always, ("end",)), False)):
        n = len(effect.parameters)
        _, sd = known.prior_of({"length": 2.0}, [effect], [], np.zeros(n))
        assert np.isfinite(sd).any() == held
        low, _ = KnownParameters(bounds={"length": (1.0, 3.0)}).bounds_of({"length": 2.0}, [effect], [], 9.0)
        assert len(low) == n and (low[0] == -0.5) == held


def test_a_parameter_that_is_always_wrong_has_no_window():
    (effect,) = diagnosed(OSCILLATOR, CATALOGUE["parameter_error"]("gain"), {"relative_error": 0.3}).effects
    assert list(effect.params) == ["relative_error"]


def test_an_effect_that_ends_is_a_richer_form_of_itself():
    stop = CATALOGUE["end_stop"]("rate", "angle")
    ends, other = starting(stop, ["end"]), starting(CATALOGUE["end_stop"]("rate", "rate"), ["end"])
    assert richer(ends, stop) and not richer(stop, ends) and not richer(stop, stop) and not richer(other, stop)
