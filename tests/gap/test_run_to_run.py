"""A cause of another size in every run has no name; that it is one is said, with its sizes."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N = 0.05, 160
LOADS = np.array([0.5, -0.4, 0.1, 0.3])


def spring(load=0.0, k=2.0, drag=0.0):
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - 0.5 * x[1] - 2.0 * x[0] ** 3 - drag * x[1] * abs(x[1]) + load),
        states=["y", "v"], inputs=["force"], outputs=["y"], params={"k": k}, dt=DT,
    )  # fmt: skip


def recorded(plants, seed=0):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(-1.5, 1.5, N // 10), 10)[:, None] for _ in plants]
    y = np.concatenate([plant.simulate(u).ravel() for plant, u in zip(plants, U)])
    return np.concatenate(U), y + 0.01 * y.std() * rng.normal(size=len(y)), np.repeat(range(len(plants)), N)


def notes(data):
    X, y, groups = data
    effects = ["constant_bias", "parameter_error", "input_gain", "coulomb_friction", "quadratic_drag", "sensor_bias"]
    report = GapDiagnoser(spring(), effects=effects, n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    return report, [note for note in report.notes if note.startswith("From run to run")]


def sizes(note):
    return [float(part.split(" in run")[0]) for part in note.split("in each: ")[1].split(" (to first")[0].split(", ")]


@pytest.mark.slow
def test_loads_of_each_run_are_told_with_their_sizes():
    report, (note,) = notes(recorded([spring(load=load) for load in LOADS]))
    assert "constant_bias at v does" in note
    assert sizes(note) == pytest.approx(LOADS, abs=0.05)
    assert not report.effects or report.effects[0].name == "constant_bias"


@pytest.mark.slow
def test_a_parameter_of_each_run_is_told_too():
    errors = np.array([0.2, -0.1, 0.3, 0.05])
    _, (note,) = notes(recorded([spring(k=2.0 * (1 + error)) for error in errors]))
    assert "parameter_error at k does" in note
    assert sizes(note) == pytest.approx(errors, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("plant", [spring(), spring(drag=0.4), spring(load=0.3)], ids=["nothing", "drag", "one load"])
def test_what_is_the_same_in_all_runs_has_no_such_note(plant):
    assert notes(recorded([plant] * 4))[1] == []
