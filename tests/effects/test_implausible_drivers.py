"""Forms that no plant has are no candidates by default; asked for by name they are."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, build_effects
from sksurrogate.effects._structure import motions
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

FRICTIONS = ("coulomb_friction", "asymmetric_friction", "stribeck_friction", "lugre_friction")


def cart(t, x, u, p):
    q, v, i = x
    return v, i - p["c"] * v - q, u[0] - i


PLANT = describe(ODESimulator(cart, states=["q", "v", "i"], inputs=["u"], outputs=["q"], params={"c": 0.1}, dt=0.1))


def keys(effects):
    return {effect.key for effect in build_effects(PLANT, ["v", "i"], effects)}


def test_positions_and_speeds_are_seen():
    assert motions(PlantModel(PLANT)) == {"q": "position", "v": "speed"}


@pytest.mark.parametrize("name", FRICTIONS)
def test_no_friction_at_a_position_unless_it_is_asked_for(name):
    assert (name, "v", "v") in keys(None) and (name, "v", "i") in keys(None)
    assert not any(key[0] == name and key[2] == "q" for key in keys(None))
    assert (name, "v", "q") in keys([name]) and (name, "v", "q") in keys([CATALOGUE[name]])


def test_no_sine_of_a_speed_unless_it_is_asked_for():
    assert {key[2] for key in keys(None) if key[0] == "gravity_tilt"} == {"q", "i", "u"}
    assert ("gravity_tilt", "v", "v") in keys(["gravity_tilt"])


@pytest.mark.parametrize("variable", ["v", "v*i"])
def test_a_power_law_of_a_signal_that_changes_sign_is_odd(variable):
    law, v = CATALOGUE["power_law"]("v", variable), np.linspace(-2.0, 2.0, 9)
    given = (lambda s: (s * v, np.ones(9))) if "*" in variable else (lambda s: s * v)
    one, other = (law.term(0.0, v, given(sign), (0.7, 1.6), 0.0) for sign in (1.0, -1.0))
    np.testing.assert_allclose(one, -other)
    np.testing.assert_allclose(one[v > 0], -0.7 * v[v > 0] ** 1.6)


def test_a_speed_that_is_an_integral_too_stays_a_speed():
    def chain(t, x, u, p):
        return x[1], x[2], u[0] - x[2]

    plant = ODESimulator(chain, states=["q", "v", "a"], inputs=["u"], outputs=["q"], params={}, dt=0.1)
    assert motions(PlantModel(describe(plant))) == {"q": "position", "v": "speed", "a": "speed"}


def test_without_a_motion_nothing_is_left_out():
    def tank(t, x, u, p):
        return (u[0] - x[0],)

    plant = describe(ODESimulator(tank, states=["h"], inputs=["u"], outputs=["h"], params={}, dt=0.1))
    found = {effect.key for effect in build_effects(plant, ["h"])}
    assert {("coulomb_friction", "h", "h"), ("gravity_tilt", "h", "h")} <= found
