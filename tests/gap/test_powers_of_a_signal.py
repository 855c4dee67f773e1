"""Dependences that are a power of a straight line of a signal, or nearly: an outlet against a back pressure, a heat transfer, an oil.

The plants are integrated by many small steps in plain Python.
"""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.physics import ODESimulator

DT, N, RUNS, PARTS = 0.2, 200, 3, 40


def held(rng, low, high, rows=20):
    return np.repeat(rng.uniform(low, high, N // rows), rows)


def followed(rate, x0, U):
    """States (n_samples, n_states) by Heun's method."""
    x, out = np.array(x0, float), []
    for u in U:
        out.append(x.copy())
        for _ in range(PARTS):
            k = np.array(rate(x, u))
            x = x + DT / PARTS * 0.5 * (k + np.array(rate(x + DT / PARTS * k, u)))
    return np.array(out)


def diagnosed(plant, simulator, draw, noise=0.005, **settings):
    rng = np.random.default_rng(0)
    runs = [draw(rng) for _ in range(RUNS)]
    Y = np.concatenate([followed(plant, simulator.x0, u) for u in runs])
    y = Y + noise * Y.std(axis=0) * rng.standard_normal(Y.shape)
    diagnoser = GapDiagnoser(simulator, n_jobs=1, random_state=0, **settings)
    return diagnoser.fit(np.concatenate(runs), y, groups=np.repeat(range(RUNS), N))


BACK, KV = 1.0, 0.5
VESSEL = ODESimulator(
    lambda t, x, u, p: (u[0] - p["kv"] * (x[0] - p["back"]),),
    states=["p"], inputs=["feed"], outputs=["p"], params={"kv": KV, "back": BACK}, dt=DT, x0=[1.5],
)  # fmt: skip


@pytest.mark.parametrize("free", [[], ["kv"]], ids=["known", "free"])
def test_a_root_of_a_pressure_difference_is_a_dependence_of_the_valve(free):
    """``kv sqrt(p - back)`` is ``kv(p) (p - back)`` with ``kv(p)`` one over the root of the difference, whether kv is re-tuned too or not."""
    report = diagnosed(
        lambda x, u: [u[0] - KV * np.sqrt(max(x[0] - BACK, 1e-9))],
        VESSEL, lambda rng: held(rng, 0.2, 0.55)[:, None], free_params=free,
    ).report_  # fmt: skip
    (effect,) = report.effects
    valve = "parameter_dependence", "kv", "p"  # a back pressure that depends on p has the same curve
    assert report.verdict == "explained" and valve in [
        (effect.name, effect.location, effect.variable),
        *effect.equivalents,
    ]
    assert effect.location != "kv" or 1.0 / (1.0 - effect.curvature) == pytest.approx(-0.5, abs=0.1)
    low, high = effect.intervals["slope"]
    assert np.isfinite([low, high]).all() and not low <= 0.0 <= high
    assert not free or report.retuned[0]["value"] == KV


def test_a_viscosity_over_a_wide_range_is_one_name():
    """To first order nothing tells of a drag that changes eightfold: a law of its signals does."""

    def drag(T):
        return 0.15 * np.exp(700.0 / (T - 230.0) - 700.0 / 85.0)

    def rate(x, u):
        loss = drag(x[1]) * x[0]
        return (u[0] - loss) / 0.4, (loss * x[0] + u[1] - 14.0 * (x[1] - 293.0)) / 160.0

    rotor = ODESimulator(
        lambda t, x, u, p: (
            (u[0] - p["c"] * x[0]) / p["J"], (p["c"] * x[0] ** 2 + u[1] - 14.0 * (x[1] - 293.0)) / 160.0,
        ),
        states=["w", "T"], inputs=["torque", "heat"], outputs=["w", "T"], params={"c": 0.15, "J": 0.4}, dt=DT,
        x0=[30.0, 305.0],
    )  # fmt: skip
    diagnoser = diagnosed(rate, rotor, lambda rng: np.c_[held(rng, 2.0, 12.0), held(rng, 0.0, 500.0, 50)])
    (effect,) = diagnoser.report_.effects
    assert (effect.name, effect.location, effect.variable) == ("parameter_dependence", "c", "T")
    rng = np.random.default_rng(5)
    fresh = np.c_[held(rng, 2.0, 12.0), held(rng, 0.0, 500.0, 50)]
    truth = followed(rate, rotor.x0, fresh)
    left, before = (np.abs(m.simulate(fresh) - truth).max(axis=0) for m in (diagnoser.augmented_, rotor))
    assert np.all(left < 0.05 * before)


def test_a_parameter_that_depends_on_a_signal_is_held_unless_the_user_knows_it():
    dependence = CATALOGUE["parameter_dependence"]("kv", "p")
    assert KnownParameters().held([dependence]) == {"kv"}
    assert KnownParameters(priors={"kv": (0.5, 0.1)}).held([dependence]) == set()
    mean, sd = KnownParameters().prior_of({"kv": 0.5}, [dependence], ["kv"], np.zeros(3))
    assert sd[2] < 0.01 and np.isinf(sd[:2]).all() and not mean.any()
