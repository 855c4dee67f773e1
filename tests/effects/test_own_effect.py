"""A user's own effect: five lines, and a check that says what is wrong with others."""

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.effects import (
    AugmentedSimulator,
    BalanceEffect,
    HiddenEffect,
    InputEffect,
    Parameter,
    ParameterEffect,
    SensorEffect,
    build_effects,
)
from sksurrogate.kernels.signals import pointwise
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_effect


class Convection(BalanceEffect):
    """Natural convection: ``- c v abs(v)^0.25``."""

    name, parameters, equation = "convection", (Parameter("coefficient", low=0.0),), "- c v abs(v)^0.25"

    def term(self, t, x, v, theta, width):
        return -theta[0] * v * np.abs(v) ** 0.25


class Backflow(InputEffect):
    """The pump lets some through: ``u - c`` where it is off."""

    name, parameters, equation = "backflow", (Parameter("leak", low=0.0),), "u - c where u <= 0"

    def transform(self, u, v, theta, h, starts):
        return pointwise(lambda value: np.where(value <= 0, value - theta[0], value), u)

    def starts(self, probe):
        return [(0.1,)]


class Ageing(ParameterEffect):
    """``p exp(-c t)``."""

    name, access, parameters, equation = "ageing", "step", (Parameter("rate", low=0.0),), "p exp(-c t)"
    linear = False

    def value(self, p, t, theta, width):
        return p * np.exp(-theta[0] * t)

    def starts(self, probe):
        return [(0.1 / probe.duration,)]


class Fouling(HiddenEffect):
    """A deposit that grows with v and takes from dx/dt."""

    name, parameters, equation = "fouling", (Parameter("rate", low=0.0),), "- c z, dz/dt = abs(v)"

    def rates(self, z, t, v, dv, theta, width):
        return [np.abs(v)]

    def force(self, z, v, theta):
        return -theta[0] * z[0]


class Logarithmic(SensorEffect):
    """``y + c log(1 + y^2)``."""

    name, parameters, equation = "logarithmic", (Parameter("coefficient"),), "y + c log(1 + y^2)"

    def read(self, y, v, t, theta):
        return y + theta[0] * np.log1p(y * y)

    def starts(self, probe):
        return [(0.1,), (-0.1,)]


@pytest.mark.parametrize("cls", [Convection, Backflow, Ageing, Fouling, Logarithmic])
def test_own_effects_keep_the_contract(cls, oscillator):
    check_effect(cls)
    check_effect(cls, oscillator)


def test_own_effects_are_enumerated_simulated_and_cloned(oscillator, force):
    plant = describe(oscillator)
    assert [e.key for e in build_effects(plant, ["v"], [Convection])] == [
        ("convection", "v", "q"),
        ("convection", "v", "v"),
    ]
    wide = AugmentedSimulator(oscillator, [Convection("v", "v")], [{"coefficient": 0.5}])
    assert np.max(np.abs(clone(wide).simulate(force) - oscillator.simulate(force))) > 1e-3


class WithExponent(Convection):
    """One with an argument of its own: two of them at one place are two effects."""

    def __init__(self, location=None, variable=None, exponent=0.25):
        super().__init__(location, variable)
        self.exponent = exponent


def test_arguments_of_its_own_survive_and_tell_instances_apart(oscillator):
    plant = describe(oscillator)
    found = build_effects(plant, ["v"], [WithExponent("v", "v", 0.25), WithExponent("v", "v", 0.33)])
    assert [clone(effect).exponent for effect in found] == [0.25, 0.33]


class Unnamed(Convection):
    name = ""


class Twice(Convection):
    parameters = (Parameter("a"), Parameter("a"))


class Outside(Convection):
    parameters = (Parameter("coefficient", null=0.0, low=1.0),)


class Never(Convection):
    def term(self, t, x, v, theta, width):
        return 0.1 - theta[0] * v


class Flat(Convection):
    """Forgets that parameters come in columns."""

    def term(self, t, x, v, theta, width):
        return -np.max(theta[0]) * v


class Writes(Convection):
    def term(self, t, x, v, theta, width):
        x += theta[0]
        return -theta[0] * v


class Bent(Convection):
    def term(self, t, x, v, theta, width):
        return -(theta[0] ** 2) * v


class Short(Convection):
    parameters = (Parameter("coefficient"), Parameter("exponent"))

    def starts(self, probe):
        return [(1.0,)]


class Idle(Convection):
    def term(self, t, x, v, theta, width):
        return 0.0 * theta[0] * v


class Decides(Convection):
    def __init__(self, location=None, variable=None):
        super().__init__(location, f"{variable}!" if variable else None)


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (Unnamed, "name must be a non-empty str"),
        (Twice, "has a name twice"),
        (Outside, "null 0.0 of 'coefficient' is not in"),
        (Never, "its null value .* changes the simulator"),
        (Flat, "differs from the same alone"),
        (Writes, "changes the simulator|writes into its arguments|differs"),
        (Bent, "twice the magnitude is not twice the change"),
        (Short, "starts.. gives"),
        (Idle, "none of its starting values changes anything"),
        (dict, "is not a subclass of BaseEffect"),
    ],
)
def test_the_check_says_what_is_wrong(cls, message):
    with pytest.raises(AssertionError, match=message):
        check_effect(cls)


def test_the_check_notices_a_constructor_that_decides():
    with pytest.raises((AssertionError, RuntimeError), match=r"clone|constructor"):
        check_effect(Decides, None)


def test_the_check_needs_a_right_hand_side():
    class Recorded:
        def simulate(self, U, x0=None, t=None):
            return U

    with pytest.raises(AssertionError, match="needs a simulator with rhs"):
        check_effect(Convection, Recorded())
