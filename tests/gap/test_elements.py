"""Elements: what a parameter scales in several balances; laws of their own flow are one place."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.unnamed._elements import elements_along
from sksurrogate.gap.unnamed._law_places import push_at
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe


def two_masses(law=None):
    """Two masses with a spring and a damper between them; ``law`` of the stretch beside the spring."""

    def rhs(t, x, u, p):
        a, va, c, vc = x
        force = p["k"] * (a - c) + p["d"] * (va - vc) + (0.0 if law is None else law(a - c))
        return [va, (u[0] - force - 0.5 * va) / p["m"], vc, (force - 0.3 * vc) / 0.5]

    states = ["a", "va", "c", "vc"]
    params = {"k": 20.0, "d": 0.4, "m": 1.0}
    method = "auto" if law is None else "LSODA"  # a kink asks for fine steps
    return ODESimulator(rhs, states=states, inputs=["F"], outputs=["a", "c"], params=params, dt=0.03, method=method)


def test_direction_and_flow_are_those_of_the_equations():
    plant = describe(two_masses(), n_inputs=1, n_outputs=2, dt=0.03)
    rng = np.random.default_rng(0)
    x = rng.normal(size=(4, 50))
    record = Record(rng.normal(size=(1, 50)), x[[0, 2]], np.arange(50) * 0.03, np.array([0]), 0.03)
    model = PlantModel(plant)
    model.probe(record.u[:, 0])
    found = {one.parameter: one for one in elements_along(model, record, x, plant.params)}
    assert sorted(found) == ["d", "k"]  # m moves one balance alone
    for name, flow in (("k", x[0] - x[2]), ("d", x[1] - x[3])):
        np.testing.assert_allclose(
            found[name].flow * np.sign(found[name].flow @ flow), flow, rtol=1e-5
        )  # in its own size
        both = found[name].direction[:, None] * found[name].flow  # their product does not depend on the choice of sign
        expected = np.array([0.0, -1.0, 0.0, 2.0])[:, None] * flow
        np.testing.assert_allclose(both, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_a_spring_that_is_stiffer_in_compression_is_a_law_of_the_spring():
    """It moves two balances at once: no law of a single one explains it, and no effect has its form."""
    rng = np.random.default_rng(1)
    U = np.repeat(rng.uniform(-6, 6, (4, 30)), 10, axis=1)
    plant = two_masses(lambda e: np.where(e < 0, 10.0 * e, 0.0))
    Y = np.concatenate([plant.simulate(u[:, None]) for u in U])
    Y = Y + 0.008 * Y.std(axis=0) * rng.normal(size=Y.shape)
    effects = ["cubic_stiffness", "linear_loss", "parameter_error", "constant_bias", "sensor_gain"]
    diagnoser = GapDiagnoser(two_masses(), effects=effects, n_jobs=1, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 1), Y, groups=np.repeat(np.arange(4), 300)).report_
    assert report.verdict in ("partial", "unknown")
    law = report.missing_term
    assert (law.location, law.kind) == ("k", "parameter")
    assert law.curves[0].variable == "flow of k" or law.curves[0].explained > 0.8
    assert (report.remainder.location, report.remainder.kind) == ("k", "parameter")
    for stretch, stiffness in (
        (-0.1, 30.0),
        (0.1, 20.0),
    ):  # a mean stiffness is named, and a law of the stretch beside it
        found = diagnoser.augmented_.values[0]["relative_error"]
        assert 20.0 * (1.0 + found) + law.law.value({"a": stretch, "c": 0.0}) == pytest.approx(stiffness, rel=0.05)


def reactor(rate=None):
    """A reaction in the balances of a concentration and of a temperature; ``rate`` of the temperature in place of the parameter k."""

    def rhs(t, x, u, p):
        k = p["k"] if rate is None else rate(x[1])
        return 0.5 * (1.0 - x[0]) - k * x[0], u[0] - 0.4 * x[1] + 1.5 * k * x[0]

    return ODESimulator(rhs, states=["c", "T"], inputs=["heat"], outputs=["c", "T"], params={"k": 0.6}, dt=0.2)


@pytest.mark.slow
def test_a_parameter_that_depends_on_a_state_is_a_law_of_the_parameter(tmp_path):
    """It moves two balances; the rate over the temperature is found, certified, carried to other runs, saved and read."""

    def rate(T):
        return 0.2 + 0.5 / (1.0 + (T / 1.2) ** 2)

    rng = np.random.default_rng(3)
    U = np.repeat(rng.uniform(-0.2, 0.8, (5, 15)), 12, axis=1)
    Y = [reactor(rate).simulate(u[:, None], x0=[1.0, 0.5]) for u in U]
    y = np.concatenate(Y[:4])
    y = y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape)
    effects = ["linear_loss", "parameter_error", "constant_bias", "input_gain"]
    diagnoser = GapDiagnoser(reactor(), effects=effects, n_jobs=1, random_state=0)
    report = diagnoser.fit(U[:4].reshape(-1, 1), y, groups=np.repeat(np.arange(4), 180)).report_
    law = report.missing_term.law
    assert (law.location, law.kind, law.variables, law.certified) == ("k", "parameter", ("T",), True)
    assert "in the term that the parameter k scales" in report.sentence and not any(
        "From run to run" in note for note in report.notes
    )
    T = np.linspace(*law.domain["T"], 50)
    np.testing.assert_allclose(0.6 + law.value({"T": T}), rate(T), rtol=0.02)
    save_augmented(diagnoser.augmented_, tmp_path / "reactor.json")
    better = load_augmented(reactor(), tmp_path / "reactor.json")
    left = better.simulate(U[4][:, None], x0=[1.0, 0.5]) - Y[4]
    assert np.all(np.std(left, axis=0) < 0.01 * Y[4].std(axis=0))


def test_a_unit_of_a_parameter_moves_the_same_whether_it_is_re_tuned_or_given():
    U = [np.repeat(np.random.default_rng(0).uniform(-0.2, 0.8, (6, 1)), 10, axis=0)]
    record = Record.from_runs(U, [reactor().simulate(U[0], x0=[1.0, 0.5])], [0.2 * np.arange(60)], 0.2)
    pushes = []
    for k, free, theta in ((0.6, ("k",), [np.log(2.0)]), (1.2, (), [])):
        plant = describe(reactor().set_params(params={"k": k}), n_inputs=1, n_outputs=2, dt=0.2)
        problem, _ = build_problem(PlantModel(plant), record, free, plant.states)
        null = problem.fit((), np.array(theta), record.y)
        null = replace(null, fit=replace(null.fit, theta=np.array(theta)))  # the record is that of k = 0.6
        pushes.append(push_at(null, record.y, "k", "parameter")[:, 0])
    np.testing.assert_allclose(pushes[0], pushes[1], rtol=1e-3, atol=1e-5)
