"""Actuators that rise slowly and fall fast, or the other way: a valve with a spring, a heater that cools by itself.

The actuator is followed by 400 steps a sample in plain Python, the tank behind it as well.
"""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.physics import ODESimulator

DT, N, RUNS, RATE, PARTS = 0.2, 200, 2, 0.9, 400
TANK = ODESimulator(
    lambda t, x, u, p: (u[0] - p["rate"] * x[0],),
    states=["level"], inputs=["flow"], outputs=["level"], params={"rate": RATE}, dt=DT, x0=[2.0],
)  # fmt: skip


def ramp(w, u, up, down, h):
    return w + np.clip(u - w, -down * h, up * h)


def lag(w, u, up, down, h):
    return w + (u - w) * h / (up if u > w else down)


#: A movement, its effect, its number for rising and falling.
ACTUATORS = {"valve": (ramp, "rate_limit", 0.8, 4.0), "heater": (lag, "input_lag", 0.3, 1.2)}


def followed(move, up, down, run):
    """Levels (n_samples,) behind an actuator that begins at rest."""
    w, x, levels = run[0], 2.0, []
    for u in run:
        levels.append(x)
        for _ in range(PARTS):
            x += (w - RATE * x) * DT / PARTS
            w = move(w, u, up, down, DT / PARTS)
    return np.array(levels)


def steps(rng):
    return np.repeat(rng.uniform(0.0, 4.0, N // 10), 10)


@pytest.fixture(scope="module", params=ACTUATORS)
def diagnosed(request):
    rng, (move, *told) = np.random.default_rng(0), ACTUATORS[request.param]
    runs = [steps(rng) for _ in range(RUNS)]
    y = np.concatenate([followed(move, *told[1:], run) for run in runs]) + 0.005 * rng.standard_normal(RUNS * N)
    diagnoser = GapDiagnoser(TANK, n_jobs=1, random_state=0)
    return request.param, diagnoser.fit(np.concatenate(runs)[:, None], y, groups=np.repeat(range(RUNS), N))


def test_both_speeds_are_found(diagnosed):
    (_, name, rising, falling), report = ACTUATORS[diagnosed[0]], diagnosed[1].report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location) == ("explained", name, "flow")
    (found,) = effect.params.values()
    assert found == pytest.approx(rising, rel=0.02)
    faster = falling / rising if name == "rate_limit" else rising / falling
    assert np.exp(effect.falling) == pytest.approx(faster, rel=0.03)
    assert "times as fast as rising" in report.sentence and "falling=" in code_of(report)


def test_the_corrected_simulator_moves_so_and_is_stored(diagnosed, tmp_path):
    move, _, rising, falling = ACTUATORS[diagnosed[0]]
    run, augmented = steps(np.random.default_rng(7)), diagnosed[1].augmented_
    found = augmented.simulate(run[:, None], x0=[2.0])
    np.testing.assert_allclose(found[:, 0], followed(move, rising, falling, run), atol=0.02)
    save_augmented(augmented, tmp_path / "tank.json")
    np.testing.assert_allclose(load_augmented(TANK, tmp_path / "tank.json").simulate(run[:, None], x0=[2.0]), found)


@pytest.mark.parametrize("name", ["rate_limit", "input_lag"])
def test_it_has_the_same_free_run_as_a_graph(name):
    whole = AugmentedSimulator(TANK, [CATALOGUE[name]("flow", falling=1.2)], [(0.7,)])
    run = steps(np.random.default_rng(3))[:, None]
    n_sub = whole.substeps(run, x0=[2.0])
    graph, state, found = whole.to_graph(n_sub), whole.start_state([2.0], run[0], n_sub), []
    for u in run:
        now = graph(x=state, u=u)
        state, found = np.ravel(now["x_next"]), [*found, float(np.ravel(now["y"])[0])]
    np.testing.assert_allclose(found, whole.simulate(run, x0=[2.0])[:, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["rate_limit", "input_lag"])
def test_as_fast_both_ways_it_is_the_catalogues(name):
    run = steps(np.random.default_rng(3))[:, None]
    alike, next_to = (
        AugmentedSimulator(TANK, [CATALOGUE[name]("flow", falling=size)], [(0.7,)]).simulate(run)
        for size in (0.0, 1e-9)
    )
    np.testing.assert_allclose(next_to, alike, atol=1e-7)
