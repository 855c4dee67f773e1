"""What a change of every sample would do to the likelihood: the adjoint against the columns of the screen."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._normal_equations import eliminate_rows, project_starts
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._slopes import Slopes
from sksurrogate.kernels.banded import recursion_band, solve_adjoint, solve_recursion
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import stack_runs

DT, N, RUNS, NOISE = 0.1, 250, 4, 0.01
LEVEL = 40.0


def rhs(t, x, u, p):
    return x[1], p["gain"] * u[0] - 2.0 * (x[0] - LEVEL) - 0.6 * x[1] - 0.05 * (x[0] - LEVEL) ** 3


def read(t, x, u, p):
    """A position, and an acceleration that shows the input at once."""
    return x[0], p["gain"] * u[0] - 2.0 * (x[0] - LEVEL) - 0.6 * x[1]


def simulator(shows=True):
    outputs = ["q", "a"] if shows else ["q", "v"]
    given = {"output": read} if shows else {}
    return ODESimulator(
        rhs, states=["q", "v"], inputs=["f"], outputs=outputs, params={"gain": 3.0}, x0=[LEVEL, 0.0], dt=DT, **given
    )


def runs(step_in=0.0, step_out=0.0, seed=0, shows=False):
    """Held inputs, rounded before the plant sees them, and first readings rounded before the noise."""
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.normal(size=N // 5), 5)[:, None] for _ in range(RUNS)]
    act = [step_in * np.round(u / step_in) if step_in else u for u in U]
    Y = [np.array(simulator(shows).simulate(u, x0=np.array([LEVEL, 0.0])).reshape(N, 2)) for u in act]
    for y in Y:
        y[:, 0] = step_out * np.round(y[:, 0] / step_out) if step_out else y[:, 0]
    return U, [y + NOISE * rng.normal(size=y.shape) for y in Y]


def test_the_adjoint_is_the_transposed_recursion():
    rng = np.random.default_rng(0)
    A, starts = 0.4 * rng.normal(size=(3, 3, 30)), np.array([0, 11])
    band = recursion_band(A, starts)
    b, c = rng.normal(size=(3, 30)), rng.normal(size=(3, 30))
    forward = np.sum(c * solve_recursion(band, b[:, None])[:, 0])
    assert np.sum(b * solve_adjoint(band, c)) == pytest.approx(forward, rel=1e-12)


@pytest.mark.parametrize("shows", [False, True])
def test_a_slope_times_a_change_is_what_the_screen_expects_of_it(shows):
    U, Y = runs(0.2, 0.0, shows=shows)
    plant = describe(simulator(shows), n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(plant), record, ("gain",), ("v",))
    null = estimate_noise(problem.fit((), np.zeros(1), smoothed.x), problem.first_noise())
    responses = Responses(null.candidate, smoothed.x)
    sd = problem.sd[None, :, None]
    known = np.concatenate([(record.y - responses.lin.y)[None], responses.lin.J_theta.transpose(1, 0, 2)]) / sd
    J_x = responses.lin.J_x / problem.sd[:, None, None]
    white = project_starts(known, J_x, record.starts).reshape(2, -1)
    steps = np.array([[0.05, 0.2, 0.31]])
    signal, slope = Slopes(responses).of("input", "f")
    columns, _ = responses.columns(CATALOGUE["input_quantization"]("f"), steps)
    seen, reading = Slopes(responses).of("output", "q")
    rounded = np.zeros_like(columns)
    rounded[0] = steps.T * np.round(seen / steps.T) - seen
    for change, y in (
        ((steps.T * np.round(signal / steps.T) - signal) @ slope, columns),
        (rounded[0] @ reading, rounded),
    ):
        flat = project_starts(y.transpose(1, 0, 2) / sd, J_x, record.starts).reshape(3, -1)
        rows = np.concatenate([white @ white.T, white @ flat.T], axis=1)
        expected, _ = eliminate_rows(rows, np.zeros(5), np.zeros(1), np.zeros(1))
        np.testing.assert_allclose(change, expected, rtol=1e-5, atol=1e-5 * np.max(np.abs(expected)))


@pytest.mark.parametrize(
    "name, place, steps", [("input_quantization", "f", (0.046, 0.0)), ("sensor_quantization", "q", (0.0, 0.024))]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_fine_step_is_named(name, place, steps, seed):
    """Of rounding below the noise, of many steps up to the largest value, no reading shows its level."""
    U, Y = runs(*steps, seed=seed)
    report = GapDiagnoser(simulator(False), random_state=0).fit(*stack_runs(U, Y)).report_
    assert [(e.name, e.location) for e in report.effects] == [(name, place)]
    assert report.effects[0].params["step"] == pytest.approx(max(steps), rel=5e-3)
