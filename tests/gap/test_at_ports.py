"""Diagnoses of an arm whose missing force enters at a torque and moves both joints."""

import numpy as np
import pytest

from sksurrogate._units import over
from sksurrogate.blind._linkage import arm_rates
from sksurrogate.effects import AugmentedSimulator, build_effects
from sksurrogate.gap import EffectEstimate, GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.render._units import parameter_unit
from sksurrogate.gap.unnamed._ode_channels import OdeChannels
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

PARAMS = {"m1": 1.0, "m2": 0.6, "l1": 0.35, "l2": 0.3, "g": 0.0, "d1": 0.1, "d2": 0.02}
RUNS, N = 3, 105


def arm(kind=ODESimulator, rates=arm_rates):
    names = {"states": ["q1", "q2", "v1", "v2"], "inputs": ["t1", "t2"], "outputs": ["q1", "q2"]}
    return kind(rates, **names, params=PARAMS, dt=0.01)


def recorded(friction):
    """Inputs, readings and runs of the arm with a friction of the second joint."""

    def rates(t, x, u, p):
        return arm_rates(t, x, (u[0], u[1] - friction(x[3])), p)

    real, rng = arm().set_params(rhs=rates), np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1, 1, size=(RUNS, N // 15, 2)) * [1.0, 0.3], 15, axis=1)
    X0 = 0.3 * rng.normal(size=(RUNS, 4))
    y = np.concatenate([real.simulate(u, x0) for u, x0 in zip(U, X0)])
    return U.reshape(-1, 2), y + 2e-3 * rng.normal(size=y.shape), np.repeat(np.arange(RUNS), N), X0


def dry(v):
    return 0.06 * np.tanh(v / 1e-3)


@pytest.mark.slow
def test_dry_friction_in_a_joint_is_named_at_its_torque():
    U, y, runs, _ = recorded(dry)
    names = ["coulomb_friction", "linear_loss", "quadratic_drag", "input_delay"]
    report = GapDiagnoser(arm(), effects=names, random_state=0).fit(U, y, groups=runs).report_
    assert report.verdict == "explained"
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("coulomb_friction", "t2", "v2")]
    assert report.effects[0].params["level"] == pytest.approx(0.06, rel=0.02)  # in the unit of the torque
    assert (report.where.kind, report.where.location) == ("input", "t2")


@pytest.mark.slow
def test_dry_friction_of_a_wheel_without_an_angle_is_named_at_its_torque():
    def wheel(t, x, u, p):
        return -u[0] / 4.0, u[0] / 0.05

    def real(t, x, u, p):
        return wheel(t, x, [u[0] - 0.012 * np.tanh(x[1] / 0.05)], p)

    names = {"states": ["rate", "wheel"], "inputs": ["torque"], "outputs": ["rate", "wheel"]}
    simulator, plant = (ODESimulator(rhs, **names, params={}, dt=0.5) for rhs in (wheel, real))
    t, rng = 0.5 * np.arange(120), np.random.default_rng(0)
    U = np.stack([0.06 * np.cos(w * t) for w in (0.21, 0.29, 0.37)])[..., None]
    y = np.concatenate([plant.simulate(u) for u in U])
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    names = ["coulomb_friction", "power_law", "linear_loss"]
    diagnoser = GapDiagnoser(simulator, effects=names, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 1), y, groups=np.repeat(np.arange(3), 120)).report_
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("coulomb_friction", "torque", "wheel")]
    assert report.effects[0].params["level"] == pytest.approx(0.012, rel=0.03)


class Offered(ODESimulator):
    """The arm, with its second joint as a port too."""

    ports = ["elbow"]


def offered_rates(t, x, u, p, forces=None):
    return arm_rates(t, x, u if forces is None else (u[0], u[1] + forces[0]), p)


@pytest.mark.slow
@pytest.mark.parametrize("port", ["t2", "elbow"])
def test_a_missing_force_at_a_port_comes_as_an_effect(port):
    U, y, runs, X0 = recorded(dry)
    simulator = arm() if port == "t2" else arm(Offered, offered_rates)
    plant = describe(simulator)
    split = [np.flatnonzero(runs == r) for r in range(RUNS)]
    record = Record.from_runs([U[k] for k in split], [y[k] for k in split], [0.01 * np.arange(N)] * RUNS, 0.01)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("v1", "v2"))
    null = problem.fit((), np.zeros(0), smoothed.x)
    law = OdeChannels(null).missing_term(port, "input").effects[0]
    assert law.location == port and "v2" in law.variable
    better = AugmentedSimulator(simulator, [law], [law.values])
    left = [
        np.concatenate([one.simulate(u, x) for u, x in zip(U.reshape(RUNS, N, 2), X0)]) - y
        for one in (simulator, better)
    ]
    assert np.std(left[1]) < 0.3 * np.std(left[0])


def test_the_whole_catalogue_at_ports_takes_little_more():
    found = build_effects(describe(arm()), ["v1", "v2"])
    at_ports = [effect for effect in found if effect.kind == "state" and effect.location in ("t1", "t2")]
    assert 0 < len(at_ports) < 0.3 * len(found)
    assert len({effect.key for effect in found}) == len(found)


def test_a_law_at_a_port_is_in_the_unit_of_the_port():
    found = EffectEstimate("linear_loss", "t2", "v2", 1.0, {"coefficient": 0.1}, {}, 1.0, at_port=True)
    units = {"t2": "N m", "v2": "rad/s", "time": "s"}
    assert parameter_unit(found, "coefficient", units) == over("N m", "rad/s")
    dry_one = EffectEstimate("coulomb_friction", "t2", "v2", 1.0, {"level": 0.1}, {}, 1.0, at_port=True)
    assert parameter_unit(dry_one, "level", units) == "N m"


@pytest.mark.slow
def test_a_force_without_a_name_at_a_further_port_is_a_law_there():
    """A magnet at the elbow: no effect has its form, and it moves both joints through the mass matrix."""

    def pull(v, q):
        return 0.08 * np.sin(5.0 * q)

    def rates(t, x, u, p):
        return arm_rates(t, x, (u[0], u[1] - pull(x[3], x[1])), p)

    real, rng = arm().set_params(rhs=rates), np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1, 1, size=(RUNS, N // 15, 2)) * [1.0, 0.3], 15, axis=1)
    X0 = 0.3 * rng.normal(size=(RUNS, 4))
    y = np.concatenate([real.simulate(u, x0) for u, x0 in zip(U, X0)])
    y = y + 5e-4 * rng.normal(size=y.shape)
    diagnoser = GapDiagnoser(
        arm(Offered, offered_rates), effects=["linear_loss", "input_gain"], n_jobs=1, random_state=0
    )
    report = diagnoser.fit(U.reshape(-1, 2), y, groups=np.repeat(np.arange(RUNS), N)).report_
    law, q = report.missing_term.law, np.linspace(-1.2, 1.2, 20)
    assert (law.location, law.kind, law.variables, law.certified) == ("elbow", "input", ("q2",), True)
    np.testing.assert_allclose(law.value({"q2": q}), -pull(0.0, q), atol=2e-3)
