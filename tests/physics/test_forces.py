"""A simulator with ports of its own: its functions take forces there, which is asked early and in words."""

import numpy as np
import pytest

from sksurrogate.effects import AugmentedSimulator, build_effects
from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

NAMES = {"states": ["q", "v"], "inputs": ["u"], "params": {"k": 4.0}, "dt": 0.02}


def acceleration(x, u, p, forces):
    return u[0] + (0.0 if forces is None else forces[0]) - p["k"] * x[0]


def rhs(t, x, u, p, forces=None):
    return x[1], acceleration(x, u, p, forces)


def step(t, x, u, p, dt, forces=None):
    v = x[1] + dt * acceleration(x, u, p, forces)
    return x[0] + dt * v, v


def ported(kind, function, output=None, ports=("joint",)):
    own = type("Ported", (kind,), {"ports": ports, "__init__": kind.__init__})
    return own(function, **NAMES, outputs=["q"] if output is None else ["reading"], output=output)


def without_forces(t, x, u, p):
    return [x[0]]


def deaf(t, x, u, p, dt=None):  # a step without forces takes them for a further argument
    return [x[0], x[1]]


def scaled(t, x, u, p, gain=2.0):  # takes forces for a gain
    return [gain * x[0] + 1.0 * gain]


def out_of_range(t, x, u, p, forces=None):
    return [x[0] if forces is None else x[0] + forces[1]]


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (ported(ODESimulator, rhs, without_forces), r"output fails with forces at its ports \(TypeError: .*ports=\['joint'\]"),
        (ported(StepSimulator, step, without_forces), r"output fails.*output\(t, x, u, p, forces=None\)"),
        (ported(ODESimulator, lambda t, x, u, p: (x[1], u[0])), r"rhs fails.*rhs\(t, x, u, p, forces=None\)"),
        (ported(StepSimulator, deaf), r"step fails.*step\(t, x, u, p, dt, forces=None\)"),
        (ported(ODESimulator, rhs, out_of_range), r"output fails.*IndexError"),
        (ported(ODESimulator, rhs, scaled), r"output gives \[0.0\] for forces of 0 at its ports, and \[2.0\] without"),
    ],
)  # fmt: skip
def test_a_function_that_takes_no_forces_is_refused_before_anything_is_fitted(plant, words):
    U = np.sin(np.arange(60.0))[:, None]
    with pytest.raises(SimulatorError, match=words):
        GapDiagnoser(plant, n_jobs=1).fit(U, np.cos(U))


def test_a_port_by_name_and_one_in_a_list_are_the_same():
    assert describe(ported(ODESimulator, rhs, ports="joint")).ports == ("u", "joint")
    U, runs = np.ones((20, 1)), []
    for ports in ("joint", ["joint"]):
        plant = ported(ODESimulator, rhs, ports=ports)
        friction = next(
            e for e in build_effects(describe(plant), plant.states) if (e.name, e.location) == ("coulomb_friction", "joint")
        )  # fmt: skip
        runs.append(AugmentedSimulator(plant, [friction], [{"level": 0.5}]).simulate(U))
    np.testing.assert_array_equal(*runs)
    assert not np.allclose(runs[0], ported(ODESimulator, rhs).simulate(U))


@pytest.mark.parametrize("what", ["states", "inputs", "outputs", "ports"])
def test_a_name_that_stands_twice_is_refused(what):
    plant = ported(ODESimulator, rhs)
    setattr(plant, what, ["same", "same"])
    with pytest.raises(SimulatorError, match=f"{what}=.*'same' is named twice"):
        describe(plant)


def test_a_point_that_is_refused_with_forces_is_no_mistake():
    def guarded(t, x, u, p, forces=None):
        if forces is not None and np.any(np.abs(forces) > 0.5):
            raise ValueError("too strong")
        return [x[0]]

    PlantModel(describe(ported(ODESimulator, rhs, guarded))).probe(np.zeros(1))


@pytest.mark.parametrize("given", [5, b"joint"])
def test_what_is_no_list_of_names_is_refused_in_words(given):
    with pytest.raises(
        SimulatorError, match=r"simulator's ports=.*: expected a list of names; write ports=\['joint'\]"
    ):
        describe(ported(ODESimulator, rhs, ports=given))
