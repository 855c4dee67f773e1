"""Experiments by design: what is simulated, how it is spread, and that a cut call goes on."""

import socket

import joblib
import numpy as np
import pytest
from scipy.stats import kstest

from sksurrogate.datasets import make_reactor, make_reactor_runs, reactor_rhs, simulate_experiments
from sksurrogate.exceptions import DataError, SimulationDiverged, SimulatorError
from sksurrogate.physics import BaseSimulator, CallableSimulator, ODESimulator

RANGES = {"y": (0.5, 15.0)}, {"u": (0.05, 0.25)}


@pytest.mark.parametrize("sampling", ["lhs", "sobol", "random"])
@pytest.mark.parametrize("design", ["levels", "multisine", "prbs"])
def test_runs_are_those_of_the_simulator_and_stay_in_their_ranges(design, sampling):
    data = simulate_experiments(
        make_reactor(), *RANGES, design=design, n_runs=5, n_samples=80, sampling=sampling, random_state=1
    )
    X, y = data.X[data.groups == 3], data.y[data.groups == 3]
    np.testing.assert_allclose(make_reactor().simulate(X, x0=data.x0[3])[:, 0], y, rtol=1e-6)
    np.testing.assert_allclose(data.dydt, reactor_rhs(0, [data.y], [data.X[:, 0]], make_reactor().params)[0])
    assert data.X.min() >= 0.05 and data.X.max() <= 0.25 and np.ptp(X) > 0


def test_a_latin_hypercube_has_one_start_in_each_slice():
    data = simulate_experiments(make_reactor(), *RANGES, n_runs=32, n_samples=3, random_state=0)
    slices = np.floor((data.x0[:, 0] - 0.5) / 14.5 * 32).astype(int)
    assert sorted(slices) == list(range(32))


def test_a_sobol_start_is_more_even_than_chance():
    data = simulate_experiments(make_reactor(), *RANGES, n_runs=60, n_samples=3, sampling="sobol", random_state=0)
    assert kstest(data.x0[:, 0], "uniform", args=(0.5, 14.5)).statistic < 0.06  # chance: about 0.11


@pytest.mark.slow
def test_a_cut_call_goes_on_and_gives_the_same(tmp_path):
    kwargs = {"n_runs": 6, "n_samples": 30, "batch_size": 2, "random_state": 3, "cache": tmp_path}
    whole = simulate_experiments(make_reactor(), *RANGES, **kwargs)
    files = sorted(tmp_path.iterdir())
    files[0].unlink()
    kept = {path: path.stat().st_mtime_ns for path in files[1:]}
    again = simulate_experiments(make_reactor(), *RANGES, **kwargs, n_jobs=2)
    np.testing.assert_array_equal(whole.y, again.y)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items()) and len(files) == 3
    simulate_experiments(make_reactor(flow=3.0), *RANGES, **kwargs)
    assert len(list(tmp_path.iterdir())) == 6  # another simulator does not mix


def explode(t, x, u, p):
    return [x[0] ** 2 + u[0]]


@pytest.mark.slow
def test_runs_that_diverge_are_left_out_and_said_so():
    plant = ODESimulator(explode, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    with pytest.warns(RuntimeWarning, match=r"runs diverged and were left out, the first is run \d") as told:
        data = simulate_experiments(
            plant, {"x": (-1.0, 2.0)}, {"u": (-0.1, 0.0)}, n_runs=2, n_samples=15, random_state=0
        )
    assert told[0].filename == __file__
    assert data.failed and set(data.groups) == set(range(2)) - set(data.failed) and np.all(np.isfinite(data.y))


def test_a_simulator_that_gives_outputs_only_has_no_derivatives():
    def integrate(U, x0=None, t=None):
        return np.cumsum(U, axis=0)

    plant = CallableSimulator(integrate, inputs=["u"], outputs=["y"], dt=1.0)
    data = simulate_experiments(plant, None, {"u": (-1, 1)}, n_runs=3, n_samples=20, noise=0.1, random_state=0)
    assert data.dydt is None and data.y.shape == (60,)


def test_one_input_for_all_runs_and_wrong_designs():
    u = np.linspace(0.05, 0.25, 30)
    data = simulate_experiments(make_reactor(), RANGES[0], design=u, n_runs=3, n_samples=30, random_state=0)
    np.testing.assert_array_equal(data.X.reshape(3, 30), np.tile(u, (3, 1)))
    with pytest.raises(DataError, match="set n_runs and n_samples"):
        simulate_experiments(make_reactor(), RANGES[0], design=u, n_runs=3, n_samples=31)
    with pytest.raises(DataError, match="x0_ranges names 'z'"):
        simulate_experiments(make_reactor(), {"z": (0, 1)}, RANGES[1])
    with pytest.raises(DataError, match="give 'u' a range"):
        simulate_experiments(make_reactor(), RANGES[0])


def test_all_runs_lost_is_an_error():
    class Never:
        def simulate(self, U, x0=None, t=None):
            raise SimulationDiverged("became infinite or nan")

    with pytest.warns(RuntimeWarning), pytest.raises(DataError, match="every run diverged"):
        simulate_experiments(Never(), None, [(0, 1)], n_runs=2, n_samples=5)


def test_a_slow_simulator_is_called_once_a_run():
    class Slow:
        states, inputs, outputs, dt, calls = ["a", "b"], ["u"], ["b"], 0.02, 0

        def simulate(self, U, x0=None, t=None):
            self.calls += 1
            return self.simulate_states(U, x0)[0][:, 1:]

        def simulate_states(self, U, x0=None, t=None):
            self.calls += 1
            return np.cumsum(np.hstack([U, U]), axis=0) + x0, np.hstack([U, U])

    slow = Slow()
    data = simulate_experiments(slow, {"a": (0, 1), "b": (2, 3)}, {"u": (0, 1)}, n_runs=3, n_samples=5, random_state=0)
    assert slow.calls == 3 and data.y.min() > 2
    np.testing.assert_array_equal(data.dydt, data.X[:, 0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"n_runs": 0}, "n_runs=0 must be an int of at least 1"),
        ({"n_samples": 2.5}, "n_samples=2.5 must be an int"),
        ({"u_range": (0.3, 0.1)}, r"u_range=.* must be two numbers, above 0, low before high"),
        ({"y0_range": 4.0}, "y0_range=4.0 must be two numbers, low before high"),
        ({"noise": -1.0}, "noise=-1.0 must be a standard deviation"),
    ],
)
def test_settings_of_the_reactor_that_mean_nothing_are_refused(settings, message):
    with pytest.raises(DataError, match=message):
        make_reactor_runs(**settings)


def test_ranges_in_order_are_those_by_name_and_one_is_given_for_each():
    plant = ODESimulator(
        lambda t, x, u, p: (u[0] - x[0], u[1] - x[1]),
        states=["a", "b"], inputs=["u", "v"], outputs=["a", "b"], params={}, dt=0.1,
    )  # fmt: skip
    given = {"n_runs": 2, "n_samples": 10, "random_state": 0}
    names = simulate_experiments(plant, {"a": (0, 1), "b": (5, 6)}, {"u": (0, 1), "v": (7, 8)}, **given)
    order = simulate_experiments(plant, [(0, 1), (5, 6)], [(0, 1), (7, 8)], **given)
    np.testing.assert_array_equal(order.X, names.X)
    np.testing.assert_array_equal(order.y, names.y)
    for signals, low in ((order.y[::10], (0, 5)), (order.X, (0, 7))):  # the first rows are the initial states
        assert (signals >= low).all() and (signals <= np.add(low, 1)).all() and (np.ptp(signals, axis=0) > 0).all()
    for wrong in ([(0, 1)], [(0, 1)] * 3):
        with pytest.raises(DataError, match=f"input_ranges has {len(wrong)} pairs, expected 2"):
            simulate_experiments(plant, None, wrong, **given)


def test_a_range_that_is_a_number_is_refused():
    with pytest.raises(DataError, match=r"x0_ranges of 'y' is 5, expected a pair \(low, high\)"):
        simulate_experiments(make_reactor(), {"y": 5}, RANGES[1], n_runs=2, n_samples=5)
    with pytest.raises(DataError, match="noise=-1 must be a standard deviation"):
        simulate_experiments(make_reactor(), *RANGES, n_runs=2, n_samples=5, noise=-1)


def test_a_multisine_has_whole_periods_from_one_a_run_to_the_fastest_and_no_others():
    data = simulate_experiments(
        make_reactor(), *RANGES, n_runs=2, n_samples=120, design="multisine", hold=(5, 5), random_state=0
    )
    power = np.abs(np.fft.rfft(data.X.reshape(2, 120), axis=1))[:, 1:] > 1e-9
    assert power[:, 0].all() and power[:, 11].all() and not power[:, 12:].any()


@pytest.mark.parametrize("n_samples", [40, 41, 44])
def test_a_binary_sequence_has_two_levels_that_stay_for_a_bit(n_samples):
    data = simulate_experiments(
        make_reactor(), *RANGES, n_runs=3, n_samples=n_samples, design="prbs", hold=(5, 9), random_state=0
    )
    for run in data.X.reshape(3, n_samples):
        assert len(np.unique(run)) == 2 and set(np.flatnonzero(np.diff(run)) % 5) <= {4}


class Connected:
    """A simulator that holds an open connection."""

    def __init__(self):
        self.pair = socket.socketpair()

    def __call__(self, U, x0=None, t=None):
        self.pair[0].sendall(np.ascontiguousarray(U, dtype=float))
        return 2.0 * np.frombuffer(self.pair[1].recv(8 * len(U), socket.MSG_WAITALL)).reshape(-1, 1)


def test_a_connection_cannot_travel_and_works_where_it_is():
    plant = Connected()
    simulator = CallableSimulator(plant, inputs=["u"], outputs=["y"])
    with pytest.raises(SimulatorError, match=r"n_jobs=2: the simulator holds something.*socket.*leave out n_jobs"):
        simulate_experiments(simulator, None, [(-1, 1)], n_runs=4, n_samples=20, batch_size=2, n_jobs=2, random_state=0)
    found = simulate_experiments(simulator, None, [(-1, 1)], n_runs=4, n_samples=20, random_state=0)
    np.testing.assert_allclose(found.y, 2.0 * found.X[:, 0])
    for one in plant.pair:
        one.close()


@pytest.mark.parametrize("hold", [5, (5,), (0, 5), (6, 5)])
def test_how_long_a_level_is_held_is_two_numbers_in_order(hold):
    with pytest.raises(DataError, match=r"hold=.*fewest and most rows of a level, at least 1 and in this order"):
        simulate_experiments(make_reactor(), *RANGES, n_runs=2, n_samples=20, hold=hold)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"n_runs": 2.5}, "n_runs=2.5: expected a whole number of at least 1"),
        ({"n_samples": True}, "n_samples=True: expected a whole number"),
        ({"n_jobs": 0}, "n_jobs=0: expected None, -1 or a positive integer"),
        ({"noise": np.inf}, "noise=inf must be a standard deviation"),
        ({"noise": "loud"}, "noise='loud' must be a standard deviation"),
        ({"hold": (2.5, 4)}, "both whole numbers"),
        ({"input_ranges": {"u": ("a", "b")}}, "input_ranges: .'a', 'b'., expected two numbers"),
        ({"input_ranges": {"u": (-1.7e308, 1.7e308)}}, "must be finite"),
        ({"design": np.full((20, 1), np.inf)}, "not finite in run 0, row 0"),
        ({"design": lambda rng, n: np.r_[np.ones(n - 1), np.nan]}, "not finite in run 0, row 19"),
        ({"design": np.ma.masked_equal(np.r_[np.ones(19), 7.0][:, None], 7.0)}, "not finite in run 0, row 19"),
        ({"design": lambda rng, n: np.ones(rng.randint(2, n))}, "expected 20 rows for every run"),
        ({"design": lambda: np.ones(20)}, "gives no array of numbers .* expected a function design.rng, n_samples."),
        ({"design": [["a"]] * 20}, "gives no array of numbers"),
    ],
)
def test_arguments_that_mean_nothing_are_refused_before_any_run(given, message):
    def never(U):
        raise AssertionError("simulated")

    plant = CallableSimulator(never, inputs=["u"], outputs=["y"])
    settings = {"input_ranges": {"u": (0.0, 1.0)}, "n_runs": 3, "n_samples": 20, "random_state": 0, **given}
    with pytest.raises(DataError, match=message):
        simulate_experiments(plant, **settings)


def test_the_reason_is_said_where_every_run_is_lost():
    plant = CallableSimulator(lambda U: U / 0.0 if U[0, 0] < 0 else int("three"), inputs=["u"], outputs=["y"])
    lost = pytest.raises(DataError, match=r"every run diverged.* ValueError: invalid literal")
    with pytest.warns(RuntimeWarning), lost:
        simulate_experiments(plant, None, {"u": (1.0, 2.0)}, n_runs=2, n_samples=20)


class Silent(BaseSimulator):
    """Gives nan where its input is large, without a word."""

    inputs, outputs = ["u"], ["y"]

    def simulate(self, U, x0=None, t=None):
        return np.where(U > 1.0, np.nan, U)


def test_a_run_that_is_not_finite_is_no_data():
    design = np.stack([np.full((20, 1), level) for level in (0.5, 2.0)])
    with pytest.warns(RuntimeWarning, match="1 of 2 runs diverged"):
        made = simulate_experiments(Silent(), design=design, n_runs=2, n_samples=20)
    assert made.failed == (1,) and np.all(made.y == 0.5)


class InOneArray(BaseSimulator):
    """Writes every run into the array that it gave for the one before."""

    inputs, outputs, states = ["u"], ["y"], ["y"]

    def simulate(self, U, x0=None, t=None):
        return self.simulate_states(U, x0)[0]

    def simulate_states(self, U, x0=None, t=None):
        if not hasattr(self, "kept_"):
            self.kept_ = np.zeros_like(U), np.zeros_like(U)
        self.kept_[0][:] = U
        self.kept_[1][:] = 2.0 * U
        return self.kept_


@pytest.mark.parametrize("states", [True, False])
def test_a_simulator_that_gives_one_array_again_and_again_has_as_many_runs(states):
    class Plant(InOneArray):
        if not states:
            simulate_states = None

            def simulate(self, U, x0=None, t=None):
                return InOneArray.simulate_states(self, U)[0]

    made = simulate_experiments(Plant(), None, {"u": (0.0, 1.0)}, n_runs=3, n_samples=20, random_state=0)
    np.testing.assert_array_equal(made.y, made.X[:, 0])
    if states:
        np.testing.assert_array_equal(made.dxdt, 2.0 * made.X)


@pytest.mark.parametrize("content", [None, [1, 2], "runs", [], [("a", "b", "c")], [(np.ones((5, 1)), None, None)] * 4])
def test_a_batch_with_other_content_is_simulated_again(content, tmp_path):
    def made():
        return simulate_experiments(
            make_reactor(), {"y": (0.5, 15)}, {"u": (0.05, 0.25)}, n_runs=4, n_samples=20, cache=tmp_path, random_state=0
        ).y  # fmt: skip

    expected = made()
    joblib.dump(content, next(tmp_path.iterdir()))
    with pytest.warns(RuntimeWarning, match="is damaged .other content.: its runs are simulated again"):
        assert np.array_equal(made(), expected)


def test_a_full_disk_does_not_cost_the_runs(tmp_path, monkeypatch):
    def full(*given):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(joblib, "dump", full)
    with pytest.warns(RuntimeWarning, match="could not be written .No space left on device.: its runs are not kept"):
        made = simulate_experiments(make_reactor(), None, {"u": (0.05, 0.25)}, n_runs=2, n_samples=20, cache=tmp_path)
    assert made.y.shape == (40,) and not list(tmp_path.iterdir())


def test_a_cache_that_is_a_file_is_said(tmp_path):
    file = tmp_path / "kept"
    file.write_text("x")
    with pytest.raises(DataError, match=r"cache=.* is no folder"):
        simulate_experiments(make_reactor(), None, {"u": (0.05, 0.25)}, n_runs=2, n_samples=20, cache=file)
