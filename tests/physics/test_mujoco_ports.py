"""Laws at the joints of a MuJoCo model: where they are sought, and the steps that MuJoCo itself takes with such a force."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, build_effects, save_augmented
from sksurrogate.effects._ports import Port, places_of
from sksurrogate.physics import MuJoCoSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

mujoco = pytest.importorskip("mujoco")

ARM = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.2"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" damping="0.1" armature="0.01"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.7"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor1" joint="shoulder"/>
    <position name="servo2" joint="elbow" kp="20" kv="1"/>
  </actuator>
  <sensor><actuatorfrc actuator="motor1"/><accelerometer site="tip"/></sensor>
</mujoco>""".replace("</body>\n    </body>", '<site name="tip" pos="0 0 -0.3"/></body>\n    </body>')


def arm(**given):
    return MuJoCoSimulator(ARM, **{"outputs": ["shoulder.pos", "elbow.pos"], "dt": 0.01, **given})


def inputs(n=60):
    return np.repeat(np.random.default_rng(0).uniform(-1, 1, size=(n // 20, 2)), 20, axis=0)


def by_mujoco(U, force, x0):
    """Positions at the samples, the force held over every step of MuJoCo's own."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data, out = mujoco.MjData(model), []
    data.qpos[:], data.qvel[:] = x0[:2], x0[2:]
    for u in U:
        out.append(data.qpos.copy())
        for _ in range(5):
            data.ctrl[:], data.qfrc_applied[:] = u, [0.0, force(data)]
            mujoco.mj_step(model, data)
    return np.array(out)


@pytest.mark.parametrize(
    ("name", "variable", "values", "force"),
    [
        ("quadratic_drag", "elbow.vel", {"coefficient": 0.2}, lambda d: -0.2 * d.qvel[1] * abs(d.qvel[1])),
        ("cubic_stiffness", "elbow.pos", {"coefficient": 0.8}, lambda d: -0.8 * d.qpos[1] ** 3),
        ("linear_loss", "shoulder.vel", {"coefficient": 0.3}, lambda d: -0.3 * d.qvel[0]),
        ("gravity_tilt", "elbow.pos", {"level": 0.3}, lambda d: -0.3 * np.sin(d.qpos[1])),
    ],
)
def test_a_law_at_a_joint_is_a_force_that_mujoco_applies_at_each_of_its_steps(name, variable, values, force):
    x0 = np.array([0.3, -0.5, 0.5, -1.0])
    there = AugmentedSimulator(arm(), [CATALOGUE[name]("elbow", variable)], [values])
    assert np.allclose(there.simulate(inputs(), x0), by_mujoco(inputs(), force, x0), rtol=0, atol=1e-12)
    assert np.ptp(there.simulate(inputs(), x0) - arm().simulate(inputs(), x0)) > 1e-3


@pytest.mark.parametrize(
    ("name", "variable", "parameter"),
    [
        ("coulomb_friction", "elbow.vel", "elbow.frictionloss"),
        ("linear_loss", "elbow.vel", "elbow.damping"),
        ("linear_loss", "elbow.pos", "elbow.stiffness"),
    ],
)
def test_a_law_that_is_a_parameter_of_the_joint_acts_as_that_parameter(name, variable, parameter):
    x0, U = np.array([0.3, -0.5, 0.5, -1.0]), inputs(200)
    law = AugmentedSimulator(arm(), [CATALOGUE[name]("elbow", variable)], [(0.15,)])
    own = arm().params[parameter]
    as_parameter = arm().set_params(**{f"params__{parameter}": own + 0.15})
    assert np.allclose(law.simulate(U, x0), as_parameter.simulate(U, x0), rtol=0, atol=1e-12)
    assert arm().as_parameters(law.effects, [{"level": 0.15}])[0].params[parameter] == own + 0.15
    twice = AugmentedSimulator(
        as_parameter, law.effects, law.values, retuned={parameter: own}
    )  # on top of what is re-tuned
    assert np.allclose(twice.simulate(U, x0), law.simulate(U, x0), rtol=0, atol=1e-12)


def test_dry_friction_as_a_force_is_near_the_constraint_that_mujoco_solves():
    x0, U = np.array([0.3, -0.5, 0.5, -1.0]), inputs(200)
    friction = CATALOGUE["asymmetric_friction"]("elbow", "elbow.vel")
    law = AugmentedSimulator(arm(), [friction], [{"level": 0.15, "offset": 0.0}]).simulate(U, x0)
    constraint = arm().set_params(**{"params__elbow.frictionloss": 0.15}).simulate(U, x0)
    # at rest, which a servo makes frequent, both creep, each in its own way
    assert np.sqrt(np.mean((law - constraint) ** 2)) < 0.1 * np.std(constraint - arm().simulate(U, x0))


def test_laws_are_sought_at_joints_and_not_in_the_accelerations_that_they_make():
    plant = describe(arm())
    balances = ["shoulder.vel", "elbow.vel"]
    places = places_of(plant, balances)
    assert places.balances == ()
    assert places.ports == tuple(Port(j, (f"{j}.vel",), (f"{j}.pos",), constant=True) for j in ("shoulder", "elbow"))
    found = [effect.key for effect in build_effects(plant, balances, "coulomb_friction")]
    assert found == [("coulomb_friction", j, f"{j}.vel") for j in ("shoulder", "elbow")]  # no twin at a motor or servo


def test_a_joint_that_is_an_input_stays_a_port():
    plant = describe(arm(inputs=["shoulder", "servo2"]))
    assert plant.inputs == ("shoulder", "servo2") and plant.further_ports == ("elbow",)
    assert {port.name for port in places_of(plant, ["shoulder.vel", "elbow.vel"]).ports} >= {"shoulder", "elbow"}


def test_sensors_show_what_enters_at_a_joint():
    plant = describe(arm(outputs=["sensor1.x", "elbow.vel"]))
    model = PlantModel(plant)
    x, u = np.zeros((4, 2)), np.zeros((4, 2))
    u[3, 1] = 1.0  # a force in the elbow, behind two inputs and the shoulder
    read = model.output(np.zeros(2), x, u)
    assert abs(read[0, 1] - read[0, 0]) > 0.1 and read[1, 1] == read[1, 0]


def test_a_parameter_that_the_model_does_not_have_is_tried_as_a_law():
    whole = {e.key for e in build_effects(describe(arm()), [], ["parameter_error", "linear_loss", "coulomb_friction"])}
    assert ("parameter_error", "elbow.damping", None) in whole and ("linear_loss", "elbow", "elbow.pos") in whole
    assert not {e for e in whole if e[1] in ("elbow.frictionloss", "elbow.stiffness")}
    chosen = build_effects(describe(arm(params=["elbow.frictionloss"])), [], "parameter_error")
    assert [effect.location for effect in chosen] == ["elbow.frictionloss"]


def test_geoms_that_cannot_touch_have_no_friction_to_be_tried():
    assert not any(name.endswith("friction") for name in arm().params)
    floor = MuJoCoSimulator(ARM.replace("<worldbody>", '<worldbody><geom name="floor" type="plane" size="1 1 1"/>'))
    assert {"floor.friction", "geom1.friction", "geom2.friction"} < set(floor.params)


def test_a_lone_joint_is_a_port_too():
    alone = ARM[: ARM.index('<body name="lower"')] + '<site name="tip"/></body></worldbody></mujoco>'
    plant = describe(MuJoCoSimulator(alone, outputs=["shoulder.pos"], dt=0.01))
    found = [effect.key for effect in build_effects(plant, ["shoulder.vel"], "coulomb_friction")]
    assert found == [("coulomb_friction", "shoulder", "shoulder.vel")]


def test_the_model_that_is_written_says_what_it_cannot_hold(tmp_path):
    effects = [CATALOGUE["coulomb_friction"]("elbow", "elbow.vel"), CATALOGUE["input_delay"]("motor1")]
    found = AugmentedSimulator(arm(), effects, [(0.15,), {"delay": 0.03}], {"elbow.damping": 0.25})
    path = tmp_path / "model.xml"
    with pytest.warns(UserWarning, match=r"does not hold input_delay at motor1 \(delay 0.03\)"):
        save_augmented(found, path)
    assert "not in this model: input_delay at motor1 (delay 0.03)" in path.read_text()
    read = MuJoCoSimulator(path, outputs=["shoulder.pos", "elbow.pos"], dt=0.01)
    assert read.params["elbow.frictionloss"] == 0.15 and read.params["elbow.damping"] == 0.25
    without = AugmentedSimulator(arm(), effects[:1], [(0.15,)], {"elbow.damping": 0.25})
    assert np.allclose(read.simulate(inputs()), without.simulate(inputs()), rtol=0, atol=1e-12)


def test_the_first_of_equal_columns_are_as_many_as_those_of_numpy():
    from sksurrogate.physics._mujoco_points import first_of_equals

    table = np.random.default_rng(0).integers(0, 3, size=(3, 200)).astype(float)
    table[table == 0.0] = np.resize([0.0, -0.0], np.sum(table == 0.0))
    first, which = first_of_equals(table)
    assert np.array_equal(table[:, first][:, which], table)
    assert np.array_equal(first, np.sort(np.unique(table, axis=1, return_index=True)[1]))


def test_points_that_are_equal_are_computed_once(monkeypatch):
    simulator, rng = arm(), np.random.default_rng(0)
    engine = simulator._engine()
    states, inputs = rng.normal(size=(4, 6)), rng.normal(size=(2, 6))
    forces, damping = rng.normal(size=(len(simulator.ports), 6)), rng.uniform(0.1, 0.3, 6)
    points = 0.01 * np.arange(6), states, inputs, {"elbow.damping": damping}, 0.01, forces
    alone = np.column_stack([simulator.step(*(part_of(part, k) for part in points)) for k in range(6)])
    asked, rollout = [], engine._rollout

    def counted(models, start, *rest):
        asked.append(len(start))
        return rollout(models, start, *rest)

    monkeypatch.setattr(engine, "_equations", None)  # of MuJoCo, not by equations
    monkeypatch.setattr(engine, "_rollout", counted)
    again = rng.integers(0, 6, size=200)
    assert np.array_equal(simulator.step(*(part_of(part, again) for part in points)), alone[:, again])
    assert sum(asked) == 6


def part_of(part, k):
    """Of what varies from point to point some points, anything else as it is."""
    if isinstance(part, dict):
        return {name: value[k] for name, value in part.items()}
    return part[..., k] if isinstance(part, np.ndarray) else part


def test_a_model_in_a_file_is_not_looked_up_at_every_step(tmp_path, monkeypatch):
    """What is known of a simulator is read once: a free run with a law at a joint asks for its ports at every step."""
    (tmp_path / "arm.xml").write_text(ARM)
    plant = describe(MuJoCoSimulator(tmp_path / "arm.xml", outputs=["elbow.pos"], dt=0.01))
    asked, ports = [], MuJoCoSimulator.ports.fget
    monkeypatch.setattr(MuJoCoSimulator, "ports", property(lambda self: asked.append(1) or ports(self)))
    assert plant.ports == plant.ports == (*plant.inputs, "shoulder", "elbow")
    assert len(asked) <= 1


def test_sensors_of_joints_are_read_from_the_states(monkeypatch):
    """By rows of a run and at single points alike; one with a cutoff is read by MuJoCo."""
    sensors = (
        '<sensor><jointpos name="angle" joint="elbow"/><jointvel name="speed" joint="elbow" cutoff="0.5"/></sensor>'
    )
    simulator = MuJoCoSimulator(
        ARM.replace("</mujoco>", f"{sensors}</mujoco>"), outputs=["angle", "elbow.vel"], dt=0.01
    )
    U = np.random.default_rng(2).normal(0, 3, (50, len(simulator.inputs)))
    X = simulator.simulate_states(U)[0].T
    expected = X[[simulator.states.index("elbow.pos"), simulator.states.index("elbow.vel")]]
    np.testing.assert_array_equal(simulator.simulate(U).T, expected)
    clipped = simulator.set_params(outputs=["angle", "speed"])
    np.testing.assert_allclose(
        clipped.output(0.0, X, U.T, {}), [expected[0], np.clip(expected[1], -0.5, 0.5)], atol=1e-12
    )
    assert np.abs(expected[1]).max() > 0.5
    monkeypatch.setattr(simulator._engine(), "sensors", lambda at: pytest.fail("MuJoCo was asked"))
    simulator.set_params(outputs=["angle", "elbow.vel"])
    np.testing.assert_array_equal(simulator.output(0.0, X, U.T, {}), expected)
