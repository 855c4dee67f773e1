"""Laws at a port: a force that moves several balances, against scipy, MuJoCo and their twins in a balance."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.effects import (
    CATALOGUE,
    AugmentedSimulator,
    BalanceEffect,
    Parameter,
    build_effects,
    load_augmented,
    save_augmented,
)
from sksurrogate.effects._law import LawEffect, Term
from sksurrogate.effects._ports import Port, places_of
from sksurrogate.effects._structure import kinematic_states, structure_of
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

A, B, C = 0.35, 0.12, 0.12  # inertias of a horizontal arm of two links


def mass(q2):
    """Mass matrix."""
    c = B * np.cos(q2)
    return A + 2 * c, C + c, C + 0 * c


def arm_rhs(t, x, u, p):
    _, q2, v1, v2 = x
    m11, m12, m22 = mass(q2)
    h = -B * np.sin(q2)
    t1 = u[0] * p["gear"] - h * (2 * v1 * v2 + v2**2)
    t2 = u[1] + h * v1**2 - 0.1 * v2
    det = m11 * m22 - m12 * m12
    return v1, v2, (m22 * t1 - m12 * t2) / det, (m11 * t2 - m12 * t1) / det


def arm():
    names = {"states": ["q1", "q2", "v1", "v2"], "inputs": ["t1", "t2"], "outputs": ["q1", "q2"]}
    return ODESimulator(arm_rhs, **names, params={"gear": 1.0}, dt=0.01)


def cart_rhs(t, x, u, p):
    return x[1], (u[0] - p["k"] * x[0]) / p["m"]


def cart():
    names = {"states": ["q", "v"], "inputs": ["force"], "outputs": ["q"]}
    return ODESimulator(cart_rhs, **names, params={"k": 20.0, "m": 2.0}, dt=0.02)


def steps(seed, n_inputs, n=100):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, size=(n // 20, n_inputs)), 20, axis=0)


def keys(effects):
    return {effect.key for effect in effects}


LAWS = {
    "coulomb_friction": ("v", {"level": 0.2}),
    "stribeck_friction": ("v", {"level": 0.1, "static_level": 0.3, "velocity": 0.1}),
    "lugre_friction": ("v", {"stiffness": 40.0, "level": 0.1, "static_level": 0.15, "velocity": 0.1}),
    "hysteresis": ("q", {"stiffness": 6.0, "limit": 0.03}),
    "hidden_mode": ("q", {"gain": 4.0, "angular_frequency": 9.0, "damping": 0.1}),
    "end_stop": ("q", {"stiffness": 30.0, "edge": 0.0}),
    "power_law": ("v", {"coefficient": 0.7, "exponent": 1.6}),
}


@pytest.mark.parametrize("name", LAWS)
def test_at_a_port_of_one_balance_a_law_is_that_of_the_balance(name):
    variable, values = LAWS[name]
    forces = {"level", "static_level", "stiffness", "gain", "coefficient"}
    there = {key: value / 2.0 if key in forces else value for key, value in values.items()}  # over the mass
    U, effect = steps(0, 1), CATALOGUE[name]
    at_port = AugmentedSimulator(cart(), [effect("force", variable)], [values])
    in_balance = AugmentedSimulator(cart(), [effect("v", variable)], [there])
    assert np.allclose(at_port.simulate(U), in_balance.simulate(U), rtol=0, atol=1e-9)
    assert np.ptp(at_port.simulate(U) - cart().simulate(U)) > 1e-3


def test_a_law_at_a_torque_goes_through_the_mass_matrix():
    U, loss = steps(1, 2), AugmentedSimulator(arm(), [CATALOGUE["linear_loss"]("t2", "v2")], [{"coefficient": 0.4}])

    def real(t, x):
        u = U[min(int(t / 0.01 + 1e-9), len(U) - 1)]
        return arm_rhs(t, x, (u[0], u[1] - 0.4 * x[3]), {"gear": 1.0})

    x, wanted = np.zeros(4), [np.zeros(4)]
    for k in range(len(U) - 1):
        x = solve_ivp(lambda t, z, k=k: real(0.01 * k, z), (0, 0.01), x, rtol=1e-10, atol=1e-12).y[:, -1]
        wanted.append(x)
    X, rates = loss.simulate_states(U)
    assert np.allclose(X, wanted, rtol=0, atol=1e-6)  # local errors of 1e-8 of speeds of 2 add up
    assert np.allclose(rates[7], real(0.07, X[7]), rtol=1e-9)
    assert np.allclose(loss.rhs(0.0, X[7], U[7], {"gear": 1.0}), real(0.07, X[7]), rtol=1e-9)


def test_a_law_at_a_port_and_an_effect_on_that_input_act_together():
    U = steps(2, 2)
    effects = [CATALOGUE["input_gain"]("t2"), CATALOGUE["linear_loss"]("t2", "v2")]
    both = AugmentedSimulator(arm(), effects, [{"relative_error": 0.5}, {"coefficient": 0.4}]).simulate(U)
    loss = AugmentedSimulator(arm(), effects[1:], [{"coefficient": 0.4}])
    assert np.allclose(both, loss.simulate(U * [1.0, 1.5]), rtol=0, atol=1e-9)


def test_an_input_that_never_moves_is_a_port():
    still = AugmentedSimulator(arm(), [CATALOGUE["coulomb_friction"]("t2", "v2")], [{"level": 0.3}])
    U, x0 = np.zeros((100, 2)), [0.0, 0.5, 0.0, 2.0]
    speed = np.diff(still.simulate(U, x0)[:, 1])
    assert abs(speed[-1]) < 1e-3 < speed[0]  # it stops


def test_a_law_found_in_data_and_an_own_effect_act_at_a_port():
    class Belt(BalanceEffect):
        name, parameters, equation = "belt", (Parameter("coefficient", low=0.0),), "- c v abs(v)^0.5"

        def term(self, t, x, v, theta, width):
            return -theta[0] * v * np.abs(v) ** 0.5

    U = steps(3, 2)
    law = LawEffect("t1", "v1", (Term((("drag", "v1", 0.0, 0.0),)),), (-0.5,))
    drag = AugmentedSimulator(arm(), [CATALOGUE["quadratic_drag"]("t1", "v1")], [{"coefficient": 0.5}])
    assert np.allclose(AugmentedSimulator(arm(), [law], [(-0.5,)]).simulate(U), drag.simulate(U), atol=1e-9)
    plant = describe(arm())
    assert {("belt", "t1", "v1"), ("belt", "t2", "v2")} < keys(build_effects(plant, ["v1", "v2"], Belt))


def test_save_and_load_keep_the_port(tmp_path):
    there = AugmentedSimulator(arm(), [CATALOGUE["coulomb_friction"]("t2", "v2")], [{"level": 0.3}], scale=[1.0] * 4)
    save_augmented(there, tmp_path / "arm.json")
    U = steps(4, 2)
    assert np.array_equal(load_augmented(arm(), tmp_path / "arm.json").simulate(U), there.simulate(U))


# ---- where laws are sought ------------------------------------------------------------------------------------------
def test_every_torque_is_paired_with_its_joint():
    plant = describe(arm())
    places = places_of(plant, ["v1", "v2"])
    assert places.balances == ("v1", "v2")
    assert [(port.name, port.speeds, port.positions) for port in places.ports] == [
        ("t1", ("v1",), ("q1",)),
        ("t2", ("v2",), ("q2",)),
    ]
    found = keys(build_effects(plant, ["v1", "v2"], ["coulomb_friction", "hysteresis", "cubic_stiffness"]))
    assert ("coulomb_friction", "t2", "v2") in found and ("coulomb_friction", "t2", "v1") not in found
    assert ("hysteresis", "t1", "q1") in found and ("coulomb_friction", "t1", "q1") not in found


@pytest.mark.parametrize("seed", range(5))
def test_the_pairing_survives_gears_and_any_order_of_the_torques(seed):
    rng = np.random.default_rng(seed)
    n = 4
    order, gears = rng.permutation(n), rng.uniform(0.1, 50.0, size=n) * rng.choice([-1, 1], size=n)
    L = rng.normal(size=(n, n))
    G = np.linalg.inv(L @ L.T + 0.1 * np.eye(n))[:, order] * gears  # torque k drives joint order[k]

    def rhs(t, x, u, p):
        return [*x[n:], *(G @ np.reshape(u, (n, -1))).reshape(n, *np.shape(x)[1:])]

    states = [f"q{k}" for k in range(n)] + [f"v{k}" for k in range(n)]
    plant = ODESimulator(rhs, states=states, inputs=[f"t{k}" for k in range(n)], outputs=states, params={}, dt=0.01)
    ports = places_of(describe(plant), states[n:]).ports
    assert [port.speeds for port in ports] == [(f"v{k}",) for k in order]


def test_a_port_that_enters_one_balance_is_not_sought_twice():
    assert places_of(describe(cart()), ["v"]).ports == (Port("force", levels=("v",), is_a_balance=True),)
    assert keys(build_effects(describe(cart()), ["v"], "load_friction")) == {("load_friction", "force", "v")}
    assert {effect.location for effect in build_effects(describe(cart()), ["v"], "coulomb_friction")} == {"v"}
    asked = CATALOGUE["coulomb_friction"]("force", "v")  # by name of the place it can be asked for
    assert build_effects(describe(cart()), ["v"], asked) == [asked]


def test_a_flow_between_two_tanks_is_a_port_driven_by_their_levels():
    def tanks(t, x, u, p):
        return -u[0], 2.0 * u[0] - 0.1 * x[1]

    names = {"states": ["upper", "lower"], "inputs": ["flow"], "outputs": ["upper"]}
    plant = describe(ODESimulator(tanks, **names, params={}, dt=1.0))
    assert places_of(plant, ["upper", "lower"]).ports == (Port("flow", levels=("upper", "lower")),)
    assert ("sqrt_leak", "flow", "upper") in keys(build_effects(plant, ["upper", "lower"], "sqrt_leak"))
    assert not any(e.location == "flow" for e in build_effects(plant, ["upper", "lower"], "cubic_stiffness"))


def test_a_speed_whose_angle_is_not_modelled_may_have_dry_friction_at_the_torque():
    def wheel(t, x, u, p):
        return -u[0] / 40.0, u[0] / 0.05

    names = {"states": ["rate", "wheel"], "inputs": ["torque"], "outputs": ["rate", "wheel"]}
    plant = describe(ODESimulator(wheel, **names, params={}, dt=1.0))
    for name in ("coulomb_friction", "asymmetric_friction", "stribeck_friction"):
        assert (name, "torque", "wheel") in keys(build_effects(plant, ["rate", "wheel"], name))


def test_a_place_that_is_neither_says_what_there_is():
    with pytest.raises(
        ValueError, match=r"location='t3' is not a state of the simulator: .*, and no port: \['t1', 't2'\]"
    ):
        build_effects(describe(arm()), ["v1"], CATALOGUE["coulomb_friction"]("t3", "v2"))


# ---- kinematic states -----------------------------------------------------------------------------------------------
def whole(t, x, u, p, dt):
    """A step that knows only its own sample time: semi-implicit."""
    v = x[1] + 0.05 * (u[0] - 4.0 * x[0] - 0.2 * x[1])
    return x[0] + 0.05 * v, v


def trapezoidal(t, x, u, p, dt):
    v = x[1] + dt * (u[0] - 4.0 * x[0] - 0.2 * x[1])
    return x[0] + dt * (x[1] + v) / 2, v


@pytest.mark.parametrize("step", [whole, trapezoidal])
def test_positions_are_seen_whatever_the_step(step):
    plant = StepSimulator(step, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=0.05)
    assert kinematic_states(PlantModel(describe(plant))) == ("q",)
    assert structure_of(PlantModel(describe(plant))).speed_of == {"q": "v"}


def test_a_law_at_a_port_of_a_step_is_that_of_the_right_hand_side():
    def step(t, x, u, p, dt):
        k1 = np.array(arm_rhs(t, x, u, p))
        k2 = np.array(arm_rhs(t, x + dt / 2 * k1, u, p))
        return x + dt * k2

    names = {"states": ["q1", "q2", "v1", "v2"], "inputs": ["t1", "t2"], "outputs": ["q1", "q2"]}
    stepper = StepSimulator(step, **names, params={"gear": 1.0}, dt=0.01)
    U, loss = steps(5, 2), CATALOGUE["linear_loss"]("t2", "v2")
    found = [AugmentedSimulator(one, [loss], [{"coefficient": 0.2}]).simulate(U) for one in (arm(), stepper)]
    assert np.max(np.abs(found[0] - found[1])) < 0.02 * np.ptp(found[0] - arm().simulate(U))


def test_states_can_be_declared_kinematic():
    names = {"states": ["q", "v"], "inputs": ["force"], "outputs": ["q"], "params": {"k": 20.0, "m": 2.0}, "dt": 0.02}
    scaled = ODESimulator(lambda t, x, u, p: (0.1 * x[1], u[0] - x[0]), **names)  # in other units
    assert kinematic_states(PlantModel(describe(scaled))) == ()
    declared = scaled.set_params(kinematic=["q"])
    assert kinematic_states(PlantModel(describe(declared))) == ("q",)
    with pytest.raises(SimulatorError, match=r"kinematic=\['p'\]: 'p' is not a state; states are \['q', 'v'\]"):
        kinematic_states(PlantModel(describe(scaled.set_params(kinematic=["p"]))))


def _unmoved(t, x, u, p):
    return 1.0 + 0.0 * x[0]


@pytest.mark.parametrize("enters_one", [True, False])
def test_a_port_is_that_of_a_balance_whatever_a_solver_smears_over_a_step(enters_one):
    def swing(t, x, u, p):
        return x[1], u[0] * (1.0 if enters_one else np.cos(x[0])) - 9.0 * np.sin(x[0]) - 0.4 * x[1]

    given = {"states": ["angle", "rate"], "inputs": ["push"], "outputs": ["angle"], "params": {}, "dt": 0.05}
    never = [(_unmoved, lambda t, x, u, p: x)]
    plain, stepped = (describe(ODESimulator(swing, **given, events=events)) for events in (None, never))
    assert (plain.access, stepped.access) == ("rhs", "step")
    structures = [structure_of(PlantModel(plant)) for plant in (plain, stepped)]
    assert [structure.is_a_balance(0) for structure in structures] == [enters_one, enters_one]
    if enters_one:
        np.testing.assert_allclose(structures[1].gain[1], structures[0].gain[1], rtol=1e-5)
    assert places_of(stepped, ["rate"]) == places_of(plain, ["rate"])


class Ported(ODESimulator):
    """A cart with a joint of its own, and a reading of its acceleration."""

    ports = ["joint"]

    @staticmethod
    def acceleration(x, u, p, forces):
        return (u[0] + (0.0 if forces is None else forces[0]) - p["k"] * x[0]) / p["m"]


@pytest.mark.parametrize("location", ["joint", "force"])
def test_a_reading_of_forces_is_the_same_along_a_run_and_at_a_point(location):
    of = Ported.acceleration
    plant = Ported(
        lambda t, x, u, p, forces=None: (x[1], of(x, u, p, forces)),
        output=lambda t, x, u, p, forces=None: (x[0], of(x, u, p, forces)),
        states=["q", "v"], inputs=["force"], outputs=["q", "a"], params={"k": 20.0, "m": 2.0}, dt=0.02, x0=[0.3, 0.0],
    )  # fmt: skip
    friction = AugmentedSimulator(plant, [CATALOGUE["coulomb_friction"](location, "v")], [{"level": 0.4}])
    U = steps(3, 1)
    X, _ = friction.simulate_states(U)
    pointwise = [friction.output(0.0, x, u, friction.params) for x, u in zip(X, U)]
    np.testing.assert_allclose(friction.simulate(U), pointwise, atol=1e-12)
    assert np.max(np.abs(friction.simulate(U) - [plant.output(0.0, x, u, plant.params) for x, u in zip(X, U)])) > 0.19
