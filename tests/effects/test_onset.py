"""Effects within a window of time: nothing before it, the effect itself after, smooth in its edges, on every path of the kernels."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.effects._onset import Starting, can_start, starting, timed, window
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.kernels.signals import hold
from sksurrogate.physics import ODESimulator, StepSimulator, linearise

DT, N = 0.05, 200
U = np.sin(0.1 * np.arange(N))[:, None]
ONSET = 5.02
CASES = {
    "coulomb_friction": ("v", "v", {"level": 0.2}),
    "constant_bias": ("v", None, {"value": 0.3}),
    "quadratic_drag": ("v", "v", {"coefficient": 0.4}),
    "input_dead_zone": ("F", None, {"half_width": 0.3}),
    "input_gain": ("F", None, {"relative_error": 0.2}),
    "input_lag": ("F", None, {"time_constant": 0.3}),
    "sensor_gain": ("q", None, {"relative_error": 0.1}),
    "sensor_lag": ("q", None, {"time_constant": 0.3}),
    "sensor_bias": ("q", None, {"value": 0.1}),
    "hidden_mode": ("v", "q", {"gain": 1.0, "angular_frequency": 3.0, "damping": 0.2}),
    "hysteresis": ("v", "q", {"stiffness": 2.0, "limit": 0.1}),
    "state_saturation": ("q", None, {"limit": 0.05}),
    "overflow": ("q", "v", {"limit": 0.05, "share": 0.5}),
    "parameter_error": ("k", None, {"relative_error": 0.2}),
}


def oscillator(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - 0.3 * x[1]


class Outside:
    """The same seen from outside."""

    states, inputs, outputs, dt, params = None, ("F",), ("q",), DT, {}

    def simulate(self, U, x0=None, t=None):
        return plant().simulate(U, x0=x0)


def plant():
    return ODESimulator(oscillator, states=["q", "v"], inputs=["F"], outputs=["q"], params={"k": 4.0}, dt=DT)


def case(name):
    location, variable, values = CASES[name]
    return CATALOGUE[name](location, variable), values


def simulated(effect, values, simulator=None):
    return AugmentedSimulator(simulator or plant(), [effect], [values]).simulate(U)[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_nothing_before_the_onset_and_from_the_start_the_effect_itself(name):
    effect, values = case(name)
    late = simulated(starting(effect), {**values, "onset": ONSET})
    plain, always = plant().simulate(U)[:, 0], simulated(effect, values)
    before = DT * np.arange(N) <= ONSET - DT
    np.testing.assert_allclose(late[before], plain[before], atol=1e-6)  # the integrator's own error
    assert np.max(np.abs(late - plain)[~before]) > 0.1 * np.max(np.abs(always - plain))
    np.testing.assert_allclose(
        simulated(starting(effect), {**values, "onset": 0.0}), always, atol=2e-3 * np.ptp(always)
    )
    np.testing.assert_allclose(
        simulated(starting(effect, ("end",)), {**values, "end": 1e9}), always, atol=1e-9 + 1e-9 * np.ptp(always)
    )
    both = simulated(starting(effect, ("onset", "end")), {**values, "onset": ONSET, "end": 1e9})
    np.testing.assert_allclose(both, late, atol=1e-9)


def test_a_parameter_error_that_begins_is_the_parameter_step():
    late = simulated(starting(CATALOGUE["parameter_error"]("k")), {"relative_error": 0.2, "onset": ONSET})
    np.testing.assert_allclose(
        late, simulated(CATALOGUE["parameter_step"]("k"), {"relative_error": 0.2, "time": ONSET}), atol=1e-12
    )


def test_a_limit_is_in_force_within_its_window_alone():
    window = {"limit": 0.05, "onset": 3.0, "end": 7.0}
    q = simulated(starting(CATALOGUE["state_saturation"]("q"), ("onset", "end")), window)
    t = DT * np.arange(N)
    inside = (t >= 3.0 + DT) & (t <= 7.0 - DT)
    assert q[inside].max() == pytest.approx(0.05) and min(q[t < 3.0].max(), q[t > 7.0].max()) > 0.1
    whole = StepSimulator(
        lambda t, x, u, p, dt: (x[0] + dt * u[0],), states=["x"], inputs=["F"], outputs=["x"], params={}, dt=DT
    )
    x = simulated(starting(CATALOGUE["state_saturation"]("x"), ("onset", "end")), {**window, "limit": 0.5}, whole)
    free = whole.simulate(U)[:, 0]
    np.testing.assert_allclose(x[t <= 3.0 - DT], free[t <= 3.0 - DT], rtol=1e-12)
    assert x[inside].max() == pytest.approx(0.5) and free[inside].max() > 0.9
    np.testing.assert_allclose(np.diff(x[t > 7.0]), np.diff(free[t > 7.0]), atol=1e-12)


def test_a_limit_that_is_not_in_force_does_not_stop_a_linearisation():
    def at_rest(effect, values):
        return linearise(AugmentedSimulator(plant(), [effect], [values]), [0.5, 0.0], [2.0]).A

    limit = CATALOGUE["state_saturation"]("q")
    with pytest.raises(SimulatorError, match="at its limit"):
        at_rest(limit, {"limit": 0.1})
    later = at_rest(starting(limit), {"limit": 0.1, "onset": 5.0})
    np.testing.assert_allclose(later, [[0.0, 1.0], [-4.0, -0.3]], atol=1e-6)


@pytest.mark.parametrize("name", ["input_dead_zone", "sensor_gain", "sensor_lag", "input_gain"])
def test_a_simulator_seen_from_outside_gives_the_same(name):
    effect, values = case(name)
    given = starting(effect), {**values, "onset": 5.0}
    np.testing.assert_allclose(simulated(*given, Outside()), simulated(*given), atol=5e-3)  # substeps of the inputs


def test_a_force_that_sets_in_is_the_step_disturbance():
    late = simulated(starting(CATALOGUE["constant_bias"]("v")), {"value": 0.3, "onset": ONSET})
    np.testing.assert_allclose(
        late, simulated(CATALOGUE["step_disturbance"]("v"), {"size": 0.3, "time": ONSET}), atol=1e-9
    )


@pytest.mark.parametrize("name", ["coulomb_friction", "input_gain", "quadratic_drag", "input_lag", "parameter_error"])
def test_the_free_run_is_smooth_in_the_onset(name):
    effect, values = case(name)
    times = ONSET + DT * np.linspace(0.0, 1.0, 9)
    ends = np.array([simulated(starting(effect), {**values, "onset": t})[-60:] for t in times])
    steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    assert steps.max() < 3.0 * steps.mean()  # no jump from sample to sample


def test_a_window_keeps_its_time_in_pieces_of_a_run():
    late, u = starting(CATALOGUE["input_gain"]("F")), hold(U[:, 0], 2, 1, np.array([0]))
    theta = [np.array([[0.2]]), np.array([[ONSET]])]
    whole = late.transform(u, None, theta, DT / 2, np.array([0]))
    in_pieces = timed(late, DT * np.arange(N)).transform(u, None, theta, DT / 2, np.array([0, 50, 110]))
    np.testing.assert_allclose(in_pieces.mean, whole.mean, rtol=1e-12)
    assert abs(whole.mean - u.mean).max() > 0.1 and (whole.mean == u.mean)[..., : int(ONSET / DT)].all()


def test_edges_move_by_whole_samples_up_to_the_distance_of_those_that_were_tried():
    moved = starting(CATALOGUE["input_gain"]("F"), ("onset", "end")).moved((0.2, 5.0, 8.0), 0.1, 16.0)
    for place, edge in ((1, 5.0), (2, 8.0)):
        by = sorted({round((values[place] - edge) / 0.1) for values in moved} - {0})
        assert by == [k for k in range(-10, 11) if k]  # a sixteenth of the run is ten samples
    assert {values[0] for values in moved} == {0.2}


def test_a_window_is_one_inside_and_none_outside():
    t = np.linspace(0.0, 10.0, 101)
    inside = (t >= 2.0) & (t < 7.0)
    np.testing.assert_array_equal(window(t, (2.0, 7.0), ("onset", "end"), 0.0), inside)
    assert np.sum(window(t, (2.03, 7.0), ("onset", "end"), 0.1)) * 0.1 == pytest.approx(4.97)


def test_it_is_cloned_pickled_saved_and_read_back(tmp_path):
    effect, values = case("coulomb_friction")
    late = starting(effect)
    for again in (clone(late), pickle.loads(pickle.dumps(late))):
        assert type(again) is type(late) and again.key == ("coulomb_friction", "v", "v", "onset")
        assert [p.name for p in again.parameters] == ["level", "onset"]
    better = AugmentedSimulator(plant(), [late], [{**values, "onset": ONSET}])
    save_augmented(better, tmp_path / "late.json")
    again = load_augmented(plant(), tmp_path / "late.json")
    assert isinstance(again.effects[0], Starting)
    np.testing.assert_array_equal(again.simulate(U), better.simulate(U))
    assert isinstance(effect, type(effect)) and [p.name for p in effect.parameters] == ["level"]


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_with_parameters_and_no_time_of_its_own_can_begin(name):
    kind = CATALOGUE[name]
    effect = kind("a", "b" if getattr(kind, "drivers", ()) else None)
    times = {"step_disturbance", "periodic_disturbance", "parameter_step"}
    others = {"parameter_drift", "sensor_rectification"}
    assert can_start(effect) == (name not in times | others)


def test_mistakes_are_named():
    effect, _ = case("coulomb_friction")
    for span in (("begin",), ("end", "onset"), None):  # one effect has one key
        with pytest.raises(DataError, match=r"span=.*: expected \('onset',\), \('end',\) or"):
            starting(effect, span)
    with pytest.raises(DataError, match=r"has no onset.*no time of its own"):
        starting(CATALOGUE["parameter_step"]("k"))
