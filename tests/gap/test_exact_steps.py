"""Effects are compared by what they do, not by what steps of the search that are too long make of them."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator, StepSimulator

PENDULUM = {"states": ["q", "v"], "inputs": ["torque"], "outputs": ["q"], "dt": 0.02}
RUNS, N = 5, 250


def torques(rng):
    return np.repeat(rng.uniform(-0.7, 0.7, (RUNS, 25)), 10, axis=1)


def diagnosed(simulator, U, Y, rng, noise):
    Y = Y + noise * np.ptp(Y, axis=(0, 1)) * rng.normal(size=Y.shape)
    diagnoser = GapDiagnoser(simulator, n_jobs=1, random_state=0)
    return diagnoser.fit(U.reshape(-1, 1), Y.reshape(len(U) * N, -1), groups=np.repeat(range(RUNS), N)).report_


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_damping_beside_a_small_second_error_is_no_hidden_mode(factor):
    """A light link: four times the damping, and 3 % of inertia. A mode of 2.6 rad a sample did that only in steps of a whole sample."""

    def link(inertia, damping):
        def rhs(t, x, u, p):
            return x[1], (u[0] - 0.8 * np.sin(x[0]) - p["d"] * x[1]) / p["I"]

        return ODESimulator(rhs, params={"I": inertia, "d": damping}, **PENDULUM)

    rng = np.random.default_rng(3)
    U = torques(rng)
    plant = link(0.014 * factor, 0.2)
    Y = np.array([plant.simulate(u[:, None]) for u in U])
    report = diagnosed(link(0.014, 0.05), U, Y, rng, 0.003)
    damping = report.effects[0]
    assert report.verdict == "explained" and (damping.name, damping.location) == ("parameter_error", "d")
    assert 0.05 * (1.0 + damping.params["relative_error"]) == pytest.approx(0.2, rel=0.005)
    assert [e.location for e in report.effects[1:]] in ([], ["I"])


def test_a_simulator_that_cuts_off_a_position_has_a_limit_there():
    """The speed goes on: the reading stays at the limit until it turns round."""

    def step(t, x, u, p, dt):
        v = x[1] + dt * (u[0] - p["k"] * x[0] - 0.5 * x[1])
        return x[0] + dt * v, v

    rng = np.random.default_rng(1)
    U, Y = np.repeat(rng.uniform(-1.2, 1.2, (RUNS, 10)), 25, axis=1), []
    for u in U:
        x, path = (0.0, 0.0), []
        for force in u:
            path.append(x)
            x = step(0.0, x, [force], {"k": 1.0}, 0.05)
            x = min(x[0], 0.6), x[1]
        Y.append(path)
    kind = {**PENDULUM, "outputs": ["q", "v"], "dt": 0.05}
    report = diagnosed(StepSimulator(step, params={"k": 1.0}, **kind), U, np.array(Y), rng, 0.005)
    (effect,) = report.effects
    assert report.verdict == "explained" and (effect.name, effect.location) == ("state_saturation", "q")
    assert effect.params["limit"] == pytest.approx(0.6, rel=0.005)
