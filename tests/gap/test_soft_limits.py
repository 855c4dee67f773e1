"""No actuator has a corner at its limit: how it bends is fitted beside the limit, carried, said and stored."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.effects._smooth import clip
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.physics import BaseSimulator, ODESimulator

DT, N, RUNS, LIMIT, NOISE = 0.05, 200, 4, 1.5, 0.01


def cart(acting):
    return ODESimulator(
        lambda t, x, u, p: [x[1], acting(u[0]) - 2.0 * x[0] - p["c"] * x[1]],
        dt=DT, x0=[0.0, 0.0], states=["place", "speed"], inputs=["force"], outputs=["place"], params={"c": 0.6},
    )  # fmt: skip


NOMINAL = cart(lambda u: u)


@pytest.mark.parametrize("corner", [0.0, 0.05, 0.3, 0.8, 1.0])
def test_a_soft_clip_is_odd_rises_by_one_at_rest_and_ends_at_the_limit(corner):
    v = np.linspace(-4.0, 4.0, 801)
    w = clip(v, LIMIT, corner)
    assert w == pytest.approx(-w[::-1], abs=1e-12)
    assert clip(1e-6, LIMIT, corner) == pytest.approx(1e-6, rel=1e-6)
    assert np.all(np.diff(w) >= -1e-12) and np.all(np.abs(w) <= LIMIT + 1e-12)
    assert clip(60.0, LIMIT, corner) == pytest.approx(LIMIT, rel=1e-9)


def test_a_soft_clip_goes_from_the_corner_to_tanh():
    v = np.linspace(-4.0, 4.0, 81)
    assert clip(v, LIMIT, 1e-4) == pytest.approx(np.clip(v, -LIMIT, LIMIT), abs=1e-3)
    assert clip(v, LIMIT, 1.0) == pytest.approx(LIMIT * np.tanh(v / LIMIT), abs=1e-6)
    softer = [clip(v[v > 0], LIMIT, corner) for corner in (0.0, 0.1, 0.3, 0.6, 1.0)]
    assert all(np.all(b <= a + 1e-9) for a, b in zip(softer, softer[1:]))
    assert clip(v, np.inf, 0.5) == pytest.approx(v)


@pytest.fixture(scope="module")
def diagnosed():
    """A cart whose actuator saturates as ``tanh``."""
    rng, plant = np.random.default_rng(3), cart(lambda u: LIMIT * np.tanh(u / LIMIT))
    U = [np.repeat(rng.uniform(-4.0, 4.0, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [np.reshape(plant.simulate(u), (N, 1)) + NOISE * rng.normal(size=(N, 1)) for u in U]
    data = np.concatenate(U), np.concatenate(Y), np.repeat(np.arange(RUNS), N)
    return GapDiagnoser(NOMINAL, n_jobs=1, random_state=0).fit(data[0], data[1], groups=data[2]), data


def test_a_saturation_as_tanh_is_named_with_its_limit(diagnosed):
    report = diagnosed[0].report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location) == ("explained", "input_saturation", "force")
    assert effect.params["limit"] == pytest.approx(LIMIT, rel=0.02) and effect.corner > 0.7
    assert report.shrink.after < 1.1 * report.shrink.floor
    assert "soft at its limit" in str(effect) and "corner=" in code_of(report)


class ByRuns(BaseSimulator):
    """The cart through ``simulate`` alone."""

    inputs, outputs, dt, params = ["force"], ["place"], DT, {}

    def simulate(self, U, x0=None, t=None):
        return NOMINAL.simulate(U)


def test_a_saturation_as_tanh_is_named_through_simulate_alone(diagnosed):
    X, y, groups = diagnosed[1]
    report = GapDiagnoser(ByRuns(), n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    (effect,) = report.effects
    assert (report.verdict, effect.name) == ("explained", "input_saturation")
    assert effect.params["limit"] == pytest.approx(LIMIT, rel=0.02) and effect.corner > 0.7


def test_the_corner_is_carried_stored_and_written_as_a_graph(diagnosed, tmp_path):
    diagnoser, (U, Y, groups) = diagnosed
    carried, run = diagnoser.augmented_, U[groups == 0]
    once = carried.simulate(run)
    assert np.ravel(once) == pytest.approx(np.ravel(Y[groups == 0]), abs=6.0 * NOISE)
    save_augmented(carried, tmp_path / "cart.json")
    assert load_augmented(NOMINAL, tmp_path / "cart.json").simulate(run) == pytest.approx(once, abs=1e-12)


def test_a_soft_limit_has_the_same_free_run_as_a_graph():
    effect = CATALOGUE["input_saturation"]("force", corner=0.4)
    whole = AugmentedSimulator(NOMINAL, [effect], [(LIMIT,)])
    graph, run = whole.to_graph(), np.linspace(-5.0, 5.0, 60)[:, None]
    state, found = np.zeros(len(graph.states)), []
    for u in run:
        now = graph(x=state, u=u)
        state, found = now["x_next"], [*found, float(now["y"][0])]
    assert np.array(found) == pytest.approx(np.ravel(whole.simulate(run)), abs=1e-6)


def test_a_corner_stays_a_corner():
    rng = np.random.default_rng(4)
    plant = AugmentedSimulator(NOMINAL, [CATALOGUE["input_saturation"]("force")], [(LIMIT,)])
    U = [np.repeat(rng.uniform(-4.0, 4.0, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [np.reshape(plant.simulate(u), (N, 1)) + NOISE * rng.normal(size=(N, 1)) for u in U]
    report = (
        GapDiagnoser(NOMINAL, n_jobs=1, random_state=0)
        .fit(np.concatenate(U), np.concatenate(Y), groups=np.repeat(np.arange(RUNS), N))
        .report_
    )
    (effect,) = report.effects
    assert effect.name == "input_saturation" and effect.corner < 0.1
    assert effect.params["limit"] == pytest.approx(LIMIT, rel=0.02)
