"""A bank of valves that are open or shut rounds down, a stepper to the nearest step. The tank is solved exactly over every sample."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.physics import ODESimulator

DT, N, RUNS, STEP, RATE = 0.2, 200, 3, 0.8, 0.9
ROUNDED = {0.0: np.round, 0.5: np.floor}
TANK = ODESimulator(
    lambda t, x, u, p: (u[0] - p["rate"] * x[0],),
    states=["level"], inputs=["flow"], outputs=["level"], params={"rate": RATE}, dt=DT, x0=[2.0],
)  # fmt: skip


@pytest.fixture(scope="module", params=ROUNDED)
def diagnosed(request):
    rng, decay = np.random.default_rng(0), np.exp(-RATE * DT)
    U = np.repeat(rng.uniform(0.0, 4.0, (RUNS, N // 5)), 5, axis=1)
    acting, Y = STEP * ROUNDED[request.param](U / STEP), np.full((RUNS, N), 2.0)
    for k in range(N - 1):
        Y[:, k + 1] = decay * Y[:, k] + (1.0 - decay) / RATE * acting[:, k]
    y = Y.ravel() + 0.01 * rng.standard_normal(RUNS * N)
    diagnoser = GapDiagnoser(TANK, n_jobs=1, random_state=0)
    return request.param, diagnoser.fit(U.reshape(-1, 1), y, groups=np.repeat(range(RUNS), N))


def test_the_step_is_found_and_which_way_it_rounds(diagnosed):
    lower, report = diagnosed[0], diagnosed[1].report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location, effect.lower) == (
        "explained",
        "input_quantization",
        "flow",
        lower,
    )
    assert effect.params["step"] == pytest.approx(STEP, rel=0.01)
    assert ("rounding down" in report.sentence) == ("lower=" in code_of(report)) == (lower > 0.0)


def test_the_corrected_simulator_rounds_so_and_is_stored(diagnosed, tmp_path):
    lower, diagnoser = diagnosed
    run = np.linspace(0.1, 3.9, 40)[:, None]
    found = diagnoser.augmented_.simulate(run, x0=[2.0])
    expected = TANK.simulate(STEP * ROUNDED[lower](run / STEP), x0=[2.0])
    np.testing.assert_allclose(found, expected, atol=0.03)
    save_augmented(diagnoser.augmented_, tmp_path / "tank.json")
    np.testing.assert_allclose(load_augmented(TANK, tmp_path / "tank.json").simulate(run, x0=[2.0]), found, atol=1e-12)


def test_one_that_rounds_down_has_the_same_free_run_as_a_graph():
    whole = AugmentedSimulator(TANK, [CATALOGUE["input_quantization"]("flow", lower=0.5)], [(STEP,)])
    graph, run = whole.to_graph(), np.linspace(0.1, 3.9, 40)[:, None]
    state, found = whole.start_state(), []
    for u in run:
        now = graph(x=state, u=u)
        state, found = np.ravel(now["x_next"]), [*found, float(np.ravel(now["y"])[0])]
    np.testing.assert_allclose(found, np.ravel(whole.simulate(run)), atol=1e-6)
