"""A floor whose heat comes late in part: a relaxation that an input drives, of the sign that the input has."""

import numpy as np
import pytest
from scipy.linalg import expm

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

RUNS, N, DT = 3, 250, 2.0
#: Loss of the room, gain of the fan, late share of the floor's heat, time constant of the slab.
LOSS, FAN, LATE, SLAB = 0.1, 0.3, 0.6, 40.0


def room(floor):
    """Temperature above the surroundings between a floor and a fan."""

    def rhs(t, x, u, p):
        return (-LOSS * x[0] + p["floor"] * u[0] + FAN * u[1],)

    return ODESimulator(rhs, states=["T"], inputs=["floor", "fan"], outputs=["T"], params={"floor": floor}, dt=DT)


def exact(inputs, floor, colder=0.0):
    """Room and slab as one linear system, stepped by the exponential of its matrix; the slab starts as warm as its input, or colder."""
    A = np.array([[-LOSS, LATE * floor], [0.0, -1.0 / SLAB]])
    B = np.array([[(1.0 - LATE) * floor, FAN], [1.0 / SLAB, 0.0]])
    step = expm(DT * np.block([[A, B], [np.zeros((2, 4))]]))
    x, out = np.array([0.0, inputs[0, 0] - colder]), []
    for u in inputs:
        out.append(x[0])
        x = step[:2, :2] @ x + step[:2, 2:] @ u
    return np.array(out)


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(0)
    return [np.repeat(rng.choice([0.0, 1.0, 3.0], size=(N // 10, 2)), 10, axis=0) for _ in range(RUNS)]


@pytest.mark.parametrize("floor", [0.5, -0.5], ids=["heats", "cools"])
def test_the_effect_is_the_linear_system(floor, runs):
    effect = CATALOGUE["hidden_relaxation"]("T", "floor")
    late = AugmentedSimulator(room(floor), [effect], [(LATE * floor, SLAB)])
    for inputs in runs:
        np.testing.assert_allclose(late.simulate(inputs)[:, 0], exact(inputs, floor), atol=1e-5)


@pytest.mark.parametrize(
    ("floor", "colder"), [(0.5, 0.0), (-0.5, 0.0), (0.5, 4.0)], ids=["heats", "cools", "cold slab"]
)
def test_the_slow_part_of_an_input_is_named(floor, colder, runs):
    # Real records begin in operation: where the slab did not begin at rest, the diagnosis finds where it began.
    y = np.concatenate([exact(inputs, floor, colder) for inputs in runs])
    y += 0.02 * np.random.default_rng(1).normal(size=len(y))
    wanted = ["hidden_relaxation", "hidden_mode", "input_lag", "sensor_lag", "linear_loss", "exchange", "bilinear"]
    diagnoser = GapDiagnoser(room(floor), effects=[CATALOGUE[name] for name in wanted], free_params=[], n_jobs=1)
    report = diagnoser.fit(np.vstack(runs), y, groups=np.repeat(np.arange(RUNS), N)).report_
    (found,) = report.effects
    assert (report.verdict, found.name, found.location, found.variable) == (
        "explained", "hidden_relaxation", "T", "floor",
    ), str(report)  # fmt: skip
    assert found.params["coefficient"] == pytest.approx(LATE * floor, rel=0.03)
    assert found.params["time_constant"] == pytest.approx(SLAB, rel=0.03)
    assert [effect.settled for effect in diagnoser.augmented_.effects] == [colder == 0.0]
