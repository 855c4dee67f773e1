"""Step tests from rest: the input stands at its value from the first row on, the actuator does not."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.effects import load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CallableSimulator, ODESimulator

DT, N, RUNS = 0.05, 120, 5
SPRING = ODESimulator(
    lambda t, x, u, p: (x[1], 2.0 * u[0] - 2.0 * x[0] - 0.9 * x[1]),
    states=["y", "v"], inputs=["u"], outputs=["y"], params={}, dt=DT,
)  # fmt: skip


def lagging(u, w):
    return (u - w) / 0.3


def ramping(u, w):
    return np.clip((u - w) / 0.02, -1.5, 1.5)


def recorded(move, per_run, seed=1):
    """Outputs of the spring behind an actuator that is at rest before each run; noise of 0.5 %."""
    rng, U, Y = np.random.default_rng(seed), [], []
    for _ in range(RUNS):
        levels = rng.uniform(-1.0, 1.0, per_run)
        u = np.repeat(levels + 0.3 * np.sign(levels), N // per_run)
        x, rows = np.zeros(3), []
        for value in u:
            rows.append(x[0])
            x = solve_ivp(
                lambda t, x, u=value: (x[1], 2 * x[2] - 2 * x[0] - 0.9 * x[1], move(u, x[2])),
                (0, DT), x, rtol=1e-8, atol=1e-10,
            ).y[:, -1]  # fmt: skip
        U.append(u)
        Y.append(rows)
    y = np.concatenate(Y)
    return np.concatenate(U)[:, None], y + 0.005 * y.std() * rng.normal(size=len(y)), np.repeat(range(RUNS), N)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("move", "name", "value"), [(lagging, "input_lag", 0.3), (ramping, "rate_limit", 1.5)], ids=["lag", "ramp"]
)
def test_an_actuator_that_starts_at_rest_is_named_and_not_the_sensor(move, name, value, tmp_path):
    """With one step a run the actuator moves before the first row after all where it is taken to stand at the first value."""
    X, y, groups = recorded(move, per_run=1)
    diagnoser = GapDiagnoser(SPRING, random_state=0, n_jobs=1).fit(X, y, groups=groups)
    (effect,) = diagnoser.report_.effects
    assert (effect.name, effect.location, effect.before) == (name, "u", 0.0)
    ((low, high),) = effect.intervals.values()
    assert low < value < high
    assert "from 0 before every run" in str(diagnoser.report_)
    save_augmented(diagnoser.augmented_, tmp_path / "plant.json")
    loaded = load_augmented(SPRING, tmp_path / "plant.json")
    np.testing.assert_array_equal(loaded.simulate(X[:N]), diagnoser.augmented_.simulate(X[:N]))


@pytest.mark.slow
def test_a_lag_of_the_sensor_stays_possible_where_both_say_the_same():
    X, y, groups = recorded(lagging, per_run=3)
    report = GapDiagnoser(SPRING, random_state=0, n_jobs=1).fit(X, y, groups=groups).report_
    assert {(e.name, e.location) for e in report.effects} == {("input_lag", "u")}
    assert ("sensor_lag", "y", None) in report.effects[0].equivalents


@pytest.mark.slow
def test_trajectories_alone_show_it_too():
    plant = CallableSimulator(lambda U: SPRING.simulate(U), inputs=["u"], outputs=["y"], dt=DT)
    X, y, groups = recorded(ramping, per_run=3)
    report = GapDiagnoser(plant, random_state=0, n_jobs=1).fit(X, y, groups=groups).report_
    assert [(e.name, e.before) for e in report.effects] == [("rate_limit", 0.0)]


@pytest.mark.slow
@pytest.mark.parametrize(("runs", "before"), [(1, None), (2, 0.0)])
def test_of_one_run_or_two_the_rest_tells_what_the_actuator_did_in_what_is_left_out(runs, before):
    """Few runs are cut into blocks that are left out: what the actuator remembers at their start came before them.

    One run does not tell where the actuator was before it (0.2 nats; two runs: 90): then it was at the first value.
    """
    X, y, groups = recorded(ramping, per_run=3)
    few = groups < runs
    report = GapDiagnoser(SPRING, random_state=0, n_jobs=1).fit(X[few], y[few], groups=groups[few]).report_
    assert report.verdict == "explained"
    assert [(e.name, e.before) for e in report.effects] == [("rate_limit", before)]
    assert report.shrink.after < 1.2 * report.shrink.floor < 0.3 * report.shrink.before
