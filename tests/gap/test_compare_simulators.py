"""Two simulators compared: the term that separates their equations is named."""

import numpy as np
import pytest

import sksurrogate
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.gap import compare_simulators
from sksurrogate.gap._compare import excitation
from sksurrogate.physics import ODESimulator

NAMES = {"states": ["q", "v"], "inputs": ["force"], "outputs": ["q"], "dt": 0.02}
PARAMS = {"k": 20.0, "d": 0.5, "drag": 0.0, "cubic": 0.0}
FEW = ["linear_loss", "quadratic_drag", "coulomb_friction", "cubic_stiffness", "input_bias", "sensor_bias"]


def spring(t, x, u, p):
    q, v = x
    return v, u[0] - p["k"] * q - p["d"] * v - p["drag"] * v * np.abs(v) - p["cubic"] * q**3


def simulator(**params):
    return ODESimulator(spring, params={**PARAMS, **params}, **NAMES)


class Outside:
    """A simulator with other names, and outputs that the first lacks."""

    inputs, outputs, dt = ("u",), ("q",), 0.02

    def simulate(self, U, x0=None, t=None):
        return simulator(drag=0.8).simulate(U)


def compared(a, b, **settings):
    settings = {"limits": {"force": (-5, 5)}, "duration": 6.0, "n_runs": 4, "effects": FEW, "n_jobs": 1, **settings}
    return compare_simulators(a, b, random_state=0, **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "name", "value"),
    [({"drag": 0.8}, "quadratic_drag", 0.8), ({"cubic": 300.0}, "cubic_stiffness", 300.0)],
)
def test_the_term_that_one_has_is_named_with_its_coefficient(extra, name, value):
    report = compared(simulator(), simulator(**extra))
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == [name]
    assert report.effects[0].params["coefficient"] == pytest.approx(value, rel=0.03)


def test_of_two_alike_nothing_is_named_and_the_same_seed_gives_the_same():
    report, data = compared(simulator(), simulator(), return_data=True)
    assert report.verdict == "none" and report.effects == []
    _, again = compared(simulator(), simulator(), return_data=True)
    np.testing.assert_array_equal(data.y, again.y)
    assert data.X.shape == (4 * 301, 1) and np.all(np.bincount(data.groups) == 301)
    np.testing.assert_allclose(data.y[:301, 0], simulator().simulate(data.X[:301])[:, 0], atol=6e-3 * np.std(data.y))


@pytest.mark.slow
def test_a_simulator_with_other_names_is_matched_by_position():
    report, data = compared(simulator(), Outside(), return_data=True)
    assert report.effects[0].name == "quadratic_drag"
    better = data.diagnoser.augmented_.simulate(data.X[:301])[:, 0]
    assert np.std(better - data.y[:301, 0]) < 0.02 * np.std(data.y)


def test_excitation_stays_within_its_limits_and_differs_from_run_to_run():
    U = excitation([(-1.0, 3.0), (10.0, 11.0)], 6, 200, np.random.default_rng(0))
    assert U[..., 0].min() >= -1.0 and U[..., 0].max() <= 3.0 and U[..., 1].min() >= 10.0 and U[..., 1].max() <= 11.0
    assert np.ptp(U[0, :, 0]) > 2.0 > np.ptp(U[4, :, 0])  # large and small
    assert len(np.unique(U[0, :, 0])) < 40 < len(np.unique(U[1, :, 0]))  # steps and sines


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"hold": "foh"}, "a takes its inputs with hold='zoh', b with hold='foh'"),
        ({"units": {"q": "mm", "force": "N"}}, "'q' is in m in a and in mm in b: give both one unit"),
        ({"units": {"time": "h"}}, "'time' is in s in a and in h in b"),
    ],
)
def test_what_is_meant_otherwise_is_no_effect(other, words):
    ours = simulator().set_params(units={"q": "m", "time": "s"})
    with pytest.raises(SimulatorError, match=words):
        compared(ours, simulator(drag=0.8).set_params(**other))


def test_it_is_at_the_top_level():
    assert sksurrogate.compare_simulators is compare_simulators


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        (
            {"limits": {"forc": (0, 1)}},
            DataError,
            "'forc' is not an input of a; expected .low, high. for each of .'force'.",
        ),
        ({"limits": {}}, DataError, "the input 'force' is missing"),
        ({"limits": [(0, 1), (0, 1)]}, DataError, "expected .low, high. for each of the inputs"),
        (
            {"limits": {"force": (1, 0)}},
            DataError,
            r"limits\['force'\]=\(1, 0\): expected \(low, high\) with low < high",
        ),
        ({"duration": 0.1}, DataError, "duration=0.1 is 6 samples of dt=0.02, expected 40 at least"),
        ({"duration": -1.0}, DataError, "duration=-1.0: expected the length of a run"),
        ({"n_runs": 0}, DataError, "n_runs=0: expected"),
        ({"noise": 0.0}, DataError, "noise=0.0: expected a share"),
    ],
)
def test_mistakes_are_named(settings, error, message):
    with pytest.raises(error, match=message):
        compared(simulator(), simulator(), **settings)


def test_simulators_that_do_not_fit_are_said_so():
    with pytest.raises(SimulatorError, match=r"a has the sample time dt=0.02, b has dt=0.05"):
        compared(simulator(), simulator().set_params(dt=0.05))
    two = ODESimulator(
        lambda t, x, u, p: (u[0] + u[1],), states=["s"], inputs=["e", "f"], outputs=["s"], params={}, dt=0.02
    )
    with pytest.raises(SimulatorError, match=r"a has inputs .'force'., b has .'e', 'f'."):
        compared(simulator(), two)
