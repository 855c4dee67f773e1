"""Unstable plants, recorded under a controller: free runs start again where noise would have grown beyond what can be followed."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._record_parts import excerpt, run_folds
from sksurrogate.gap.fit._unstable import followed_rows, in_pieces, piece_starts
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe


def record_of(lengths):
    n = sum(lengths)
    starts = np.cumsum([0, *lengths[:-1]])
    t = np.concatenate([np.arange(k) * 0.5 for k in lengths])
    rng = np.random.default_rng(0)
    return Record(rng.normal(size=(1, n)), rng.normal(size=(1, n)), t, starts, 0.5)


def test_growth_that_is_lost_again_does_not_count():
    """Grows by e^1 over ten rows and shrinks as much over the next ten: the product never exceeds e^1."""
    rate = np.where(np.arange(200) // 10 % 2 == 0, 0.1, -0.1)
    A = np.exp(rate)[None, None]
    assert followed_rows(A, np.ones(1), np.array([0]), 1.5) is None
    assert followed_rows(A, np.ones(1), np.array([0]), 0.5) >= 20  # grows by more within; not below the shortest block


def test_the_unit_of_a_state_does_not_move_the_pieces():
    A = np.repeat(np.array([[1.0, 0.1], [1.2, 1.0]])[:, :, None], 150, axis=2)
    unit = np.array([1.0, 1000.0])
    other = A * (unit[:, None] / unit[None, :])[:, :, None]
    first, second = (piece_starts(B, s, np.array([0, 70]), 4.0) for B, s in ((A, np.ones(2)), (other, unit)))
    np.testing.assert_array_equal(first, second)
    assert len(first) > 2


def test_parts_know_what_was_recorded_without_a_break():
    pieces = in_pieces(record_of([60, 50]), 25)
    np.testing.assert_array_equal(pieces.starts, [0, 20, 40, 60, 85])
    np.testing.assert_array_equal(pieces.recorded_starts, [0, 60])
    some = pieces.select([0, 2, 3, 4])  # the second piece is missing: the third begins anew
    np.testing.assert_array_equal(some.starts, [0, 20, 40, 65])
    np.testing.assert_array_equal(some.recorded_starts, [0, 20, 40])
    np.testing.assert_array_equal(run_folds(in_pieces(record_of([50, 50, 50]), 25)), [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(run_folds(in_pieces(record_of([100]), 25)), [0, 1, 2, 3])
    long, _ = excerpt(record_of([5000, 5000, 5000]), 6000)
    assert len(long.starts) > 3 and run_folds(long).max() == 2  # whole runs are left out


@pytest.mark.parametrize("name, value", [("input_lag", 1.5), ("input_delay", 0.7), ("input_backlash", 0.4)])
def test_what_passes_before_the_plant_goes_through_the_pieces(name, value):
    """Pieces started on the path of the whole run give the same path: the lag of an input does not begin anew."""
    plant = describe(
        ODESimulator(lambda t, x, u, p: [u[0] - x[0]], states=["v"], inputs=["u"], outputs=["v"], params={}, dt=0.5),
        n_inputs=1,
        n_outputs=1,
        dt=0.5,
    )
    whole = record_of([60, 50])
    effects, theta = [CATALOGUE[name]("u")], np.array([value])

    def run(record, x0):
        return free_run(AugmentedModel(PlantModel(plant), effects, (), record, n_sub=1, scale=np.ones(1)), theta, x0)

    path = run(whole, np.zeros((1, 2)))
    pieces = in_pieces(whole, 25)
    np.testing.assert_allclose(run(pieces, path[:, pieces.starts]), path, atol=1e-9)


def balanced(friction, n_runs=4, n=250, seed=0):
    """A pendulum that stands on its pivot, angle and rate measured under a controller."""
    rng, dt = np.random.default_rng(seed), 0.02
    U, Y = [], []
    for _ in range(n_runs):
        x, goal = np.array([0.1 * rng.normal(), 0.0]), np.repeat(rng.uniform(-0.4, 0.4, n // 50 + 1), 50)
        for k in range(n):
            y = x + 0.003 * rng.normal(size=2)
            u = -30.0 * (y[0] - goal[k]) - 6.0 * y[1]
            U.append([u])
            Y.append(y)
            for _ in range(20):
                rate = 16.0 * np.sin(x[0]) - 0.4 * x[1] + u - friction * np.tanh(x[1] / 0.01)
                x = x + dt / 20 * np.array([x[1] + 0.5 * dt / 20 * rate, rate])
    return np.array(U), np.array(Y), np.repeat(np.arange(n_runs), n)


def pendulum():
    return ODESimulator(
        lambda t, x, u, p: [x[1], p["k"] * np.sin(x[0]) - p["d"] * x[1] + u[0]],
        states=["angle", "rate"],
        inputs=["torque"],
        outputs=["angle", "rate"],
        params={"k": 16.0, "d": 0.4},
        dt=0.02,
    )


@pytest.mark.parametrize("friction", [0.0, 1.5])
def test_dry_friction_of_a_pendulum_that_is_balanced(friction):
    U, Y, runs = balanced(friction)
    effects = ["coulomb_friction", "linear_loss", "quadratic_drag", "sensor_bias", "input_gain", "cubic_stiffness"]
    diagnoser = GapDiagnoser(pendulum(), effects=effects, n_jobs=1, random_state=0).fit(U, Y, groups=runs)
    report = diagnoser.report_
    assert any("unstable along the data" in note for note in report.notes)
    assert diagnoser.initial_states_.shape == (4, 2) and np.isfinite(diagnoser.initial_states_).all()
    if not friction:
        assert report.verdict == "none" and not report.effects
        return
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == ["coulomb_friction"]
    assert report.effects[0].params["level"] == pytest.approx(friction, rel=0.05)
    assert report.shrink.before < 3.0  # a free run over a whole run would be further off by orders of magnitude
