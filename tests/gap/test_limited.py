"""The screen's column of a limit on a state that nobody measures: the change of the free run, not of the smoothed path."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._normal_equations import project_starts
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import stack_runs

LIMIT, RUNS, N, DT = 0.6, 3, 200, 0.1


def rhs(t, x, u, p):
    return p["gain"] * u[0] - x[0], x[0] - 0.5 * x[1] - p["loss"] * x[1]


def plant(loss=0.0):
    return ODESimulator(
        rhs, states=["hidden", "seen"], inputs=["u"], outputs=["seen"], params={"gain": 1.0, "loss": loss}, dt=DT
    )


def limited_run(u, loss=0.0, substeps=40):
    """The plant with its first state cut off at LIMIT, by small steps."""
    x, h, out = np.zeros(2), DT / substeps, []
    for value in u:
        out.append(x[1])
        for _ in range(substeps):
            x = x + h * np.array(rhs(0.0, x, (value,), {"gain": 1.0, "loss": loss}))
            x[0] = min(x[0], LIMIT)
    return np.array(out)[:, None]


def data(loss=0.0, seed=0):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(-1.0, 1.5, N // 20), 20)[:, None] for _ in range(RUNS)]
    Y = [limited_run(u[:, 0], loss) for u in U]
    return U, [y + 0.003 * rng.normal(size=y.shape) for y in Y]


@pytest.fixture(scope="module")
def responses():
    U, Y = data()
    simulator = plant()
    described = describe(simulator, n_inputs=1, n_outputs=1, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(described), record, (), ("hidden", "seen"))
    null = estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise())
    return Responses(null.candidate, smoothed.x)


@pytest.mark.parametrize("limit", [0.4, 0.6, 0.9])
def test_the_column_is_the_change_of_the_free_run(responses, limit):
    problem = responses.problem
    effect = CATALOGUE["state_saturation"]("hidden")
    out, _ = responses.columns(effect, np.array([[limit]]))
    first = responses.smoothed.x[:, problem.record.starts]
    runs = [
        free_run(problem.augmented(effects), theta, np.minimum(first, np.array([[limit], [np.inf]])))
        for effects, theta in (((), np.zeros(0)), ((effect,), np.array([limit])))
    ]
    change = np.stack([out[:, 0], (runs[1] - runs[0])[1:]])
    J_x = responses.lin.J_x
    a, b = project_starts(change, J_x, problem.record.starts).reshape(2, -1)
    assert np.linalg.norm(b) > 0.1  # the limit bites
    assert np.linalg.norm(a - b) < 0.1 * np.linalg.norm(b)


@pytest.mark.slow
def test_a_hidden_limit_beside_a_loss_is_named():
    U, Y = data(loss=0.15, seed=1)
    report = GapDiagnoser(plant(), random_state=0).fit(*stack_runs(U, Y)).report_
    named = {(e.name, e.location) for e in report.effects}
    named |= {(name, place) for e in report.effects for name, place, _ in e.equivalents}
    assert report.verdict == "explained"
    assert len(report.effects) == 2
    assert ("state_saturation", "hidden") in named
    assert ("linear_loss", "seen") in named
    limit = next(e for e in report.effects if e.name == "state_saturation").params["limit"]
    assert limit == pytest.approx(LIMIT, rel=0.02)
