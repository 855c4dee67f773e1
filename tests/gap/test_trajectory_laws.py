"""A law without a name through ``simulate`` alone: at an input or a sensor, fitted, certified, carried."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_trajectory
from sksurrogate.gap.unnamed._trajectory_channels import TrajectoryChannels
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CallableSimulator, ODESimulator
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.1, 200, 4
TANK = ODESimulator(
    lambda t, x, u, p: [u[0] - 0.5 * x[0], 0.4 * x[0] - 0.3 * x[1]],
    states=["upper", "lower"], inputs=["pump"], outputs=["lower"], params={}, dt=DT,
)  # fmt: skip
TOOL = CallableSimulator(lambda U: TANK.simulate(U), inputs=["pump"], outputs=["lower"], dt=DT)


def recorded(at_input, at_sensor, seed=0):
    """Runs of the tank whose pump and gauge do something else; noise of 0.5 %."""
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(0.0, 2.0, 10), N // 10)[:, None] for _ in range(RUNS)]
    y = np.concatenate([at_sensor(np.ravel(TANK.simulate(at_input(u)))) for u in U])
    return np.concatenate(U), y + 0.005 * y.std() * rng.normal(size=len(y)), np.repeat(range(RUNS), N)


def plain(z):
    return z


@pytest.mark.parametrize(
    ("at_input", "at_sensor", "place"),
    [
        (lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi), plain, ("pump", "input")),
        (plain, lambda y: y + 0.4 * np.exp(-(((y - 1.2) / 0.4) ** 2)), ("lower", "output")),
    ],
    ids=["input", "sensor"],
)
def test_a_law_at_an_input_or_a_sensor_is_found_and_carried(at_input, at_sensor, place):
    X, y, groups = recorded(at_input, at_sensor)
    diagnoser = GapDiagnoser(TOOL, effects=["sensor_quantization"], random_state=0).fit(X, y, groups=groups)
    law = diagnoser.report_.missing_term.law
    assert law is not None and law.certified and (law.location, law.kind) == place
    assert diagnoser.report_.shrink.fraction_law > 0.95
    fresh, clean, runs = recorded(at_input, at_sensor, seed=7)
    after = np.concatenate([np.ravel(diagnoser.augmented_.simulate(fresh[runs == k])) for k in range(RUNS)])
    before = np.concatenate([np.ravel(TOOL.simulate(fresh[runs == k])) for k in range(RUNS)])
    assert np.sqrt(np.mean((after - clean) ** 2)) < 0.08 * np.sqrt(np.mean((before - clean) ** 2))


def test_where_nothing_is_missing_no_law_is_certified():
    X, y, groups = recorded(plain, plain)
    report = GapDiagnoser(TOOL, random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "none" and (report.missing_term is None or report.missing_term.law is None)


def test_no_law_is_looked_for_where_a_user_rules_effects_out():
    X, y, groups = recorded(lambda u: u - np.sin(2 * np.pi * u) / (2 * np.pi), plain)
    asked = GapDiagnoser(TOOL, effects=["sensor_quantization"], exclude=[(None, "pump")], random_state=0)
    term = asked.fit(X, y, groups=groups).report_.missing_term
    assert term is None or term.law is None or term.law.location != "pump"


class OnlyInputs:
    """The tank as a tool that takes its inputs and nothing else."""

    inputs, outputs, dt = ("pump",), ("lower",), DT

    def simulate(self, U):
        return TANK.simulate(U)


def test_a_tool_may_take_its_inputs_and_nothing_else():
    X, y, groups = recorded(plain, lambda y: y + 0.3)
    report = GapDiagnoser(OnlyInputs(), effects=["sensor_bias"], random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == ["sensor_bias"]


def test_beside_a_law_inside_the_noise_has_a_force_on_every_state_of_the_surrogate():
    X, y, groups = recorded(plain, plain)
    runs = [groups == k for k in range(RUNS)]
    record = Record.from_runs([X[run] for run in runs], [y[run, None] for run in runs], [DT * np.arange(N)] * RUNS, DT)
    problem = build_trajectory(describe(TOOL), record, (), range(RUNS))
    channel = TrajectoryChannels(problem.fit((), np.zeros(0))).at("inside", "state")
    assert channel.D.b > 1
    noise = channel.settled(channel.respond(record.u))
    assert len(noise.force) == channel.D.b and np.isfinite(noise.pack()).all()
