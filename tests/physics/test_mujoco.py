"""MuJoCo against closed forms, a two-link arm written by hand, and MuJoCo's own loop."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.special import ellipk
from sklearn.base import clone

from sksurrogate.effects import AugmentedSimulator
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.physics import CalibratedSimulator, MuJoCoSimulator, ODESimulator, linearise
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_simulator

mujoco = pytest.importorskip("mujoco")

#: Point mass 2 kg on a rod of 0.5 m; the sphere's own inertia is 2/5 m r^2.
PENDULUM = """
<mujoco>
  <option timestep="{step}" integrator="{integrator}"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping="{damping}" frictionloss="{friction}"/>
      <geom type="sphere" size="0.05" pos="0 0 -0.5" mass="2"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator>
</mujoco>"""
INERTIA, WEIGHT = 2 * 0.5**2 + 0.4 * 2 * 0.05**2, 2 * 9.81 * 0.5

#: Two bars with given masses, centres and inertias, so that the equations of motion can be written by hand.
ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="{integrator}"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.3"/>
      <inertial pos="0 0 -0.2" mass="1.5" diaginertia="0.02 0.03 0.02"/>
      <body name="lower" pos="0 0 -0.4">
        <joint name="elbow" axis="0 1 0" damping="0.1" armature="0.01" stiffness="2"/>
        <inertial pos="0 0 -0.15" mass="0.8" diaginertia="0.01 0.012 0.01"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="first" joint="shoulder" gear="2"/>
    <motor name="second" joint="elbow"/>
  </actuator>
</mujoco>"""

SCENE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="box" pos="0 0 0.3">
      <freejoint name="root"/>
      <geom name="shell" type="box" size="0.1 0.15 0.2" mass="1"/>
      <site name="imu"/>
      <body name="tail" pos="0 0 0.2">
        <joint name="ball" type="ball" damping="0.01"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="0.1" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><general name="spin" joint="ball" gear="0 1 0" dyntype="filter" dynprm="0.1"/></actuator>
  <sensor>
    <accelerometer name="acc" site="imu"/>
    <framequat name="pose" objtype="body" objname="box"/>
    <actuatorfrc name="load" actuator="spin"/>
    <clock name="time"/>
  </sensor>
  <keyframe><key name="up" qpos="0 0 1 1 0 0 0 1 0 0 0" qvel="0.1 0 0 1 2 3 0 0 0" act="0.5"/></keyframe>
</mujoco>"""


def pendulum(step=0.001, integrator="RK4", damping=0.0, friction=0.0, **options):
    return MuJoCoSimulator(PENDULUM.format(**locals()), **options)


def arm(step=0.002, integrator="Euler", **options):
    return MuJoCoSimulator(ARM.format(step=step, integrator=integrator), **options)


def arm_by_hand(t, x, u, p):
    """M(q) a + c(q, v) = torques, with absolute angles of the bars from the vertical."""
    q1, q2, v1, v2 = x
    m1, m2, l, c1, c2, j1, j2, g = 1.5, 0.8, 0.4, 0.2, 0.15, 0.03, 0.012, 9.81
    m11 = j1 + j2 + m1 * c1**2 + m2 * (l**2 + c2**2 + 2 * l * c2 * np.cos(q2))
    m12 = j2 + m2 * (c2**2 + l * c2 * np.cos(q2))
    m22 = j2 + m2 * c2**2 + 0.01
    h = m2 * l * c2 * np.sin(q2)
    r1 = 2 * u[0] - 0.3 * v1 + h * (2 * v1 * v2 + v2**2)
    r1 = r1 - (m1 * c1 + m2 * l) * g * np.sin(q1) - m2 * c2 * g * np.sin(q1 + q2)
    r2 = u[1] - 0.1 * v2 - 2.0 * q2 - h * v1**2 - m2 * c2 * g * np.sin(q1 + q2)
    det = m11 * m22 - m12**2
    return v1, v2, (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det


def points(simulator, shape, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(len(simulator.states), *shape)), rng.normal(size=(len(simulator.inputs), *shape))


def rk4_step(rate, x, h):
    """A step of Runge and Kutta's method."""
    a = rate(x)
    b = rate(x + h / 2 * a)
    c = rate(x + h / 2 * b)
    return x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c))


def own_loop(simulator, U, n_steps):
    """States by MuJoCo's own loop."""
    model = mujoco.MjModel.from_xml_string(simulator.model)
    data, out = mujoco.MjData(model), []
    for u in U:
        out.append(np.concatenate([data.qpos, data.qvel, data.act]))
        data.ctrl[:] = u
        for _ in range(n_steps):
            mujoco.mj_step(model, data)
    return np.array(out)


# ---- closed forms ---------------------------------------------------------------------------------------------------
def test_a_pendulum_keeps_its_energy():
    q, v = pendulum(dt=0.01).simulate(np.zeros((400, 1)), x0=[2.0, 0.5]).T
    energy = 0.5 * INERTIA * v**2 - WEIGHT * np.cos(q)
    np.testing.assert_allclose(energy, energy[0], atol=1e-8 * WEIGHT)  # the error of RK4 at 1 ms


def test_the_period_of_a_large_swing_is_the_elliptic_integral():
    q = pendulum().simulate(np.zeros((4000, 1)), x0=[2.0, 0.0])[:, 0]
    crossing = np.flatnonzero((q[:-1] > 0) & (q[1:] <= 0))
    at = crossing + q[crossing] / (q[crossing] - q[crossing + 1])
    # between crossings a straight line is cubic in the step
    assert np.diff(at)[0] * 0.001 == pytest.approx(4 * np.sqrt(INERTIA / WEIGHT) * ellipk(np.sin(1.0) ** 2), rel=1e-6)


def test_a_free_body_falls_and_turns_as_it_should():
    scene = MuJoCoSimulator(SCENE, outputs=["root.pos.z", "root.vel.x"], inputs=[])
    start = scene.keyframe("up")
    start[13:] = 0.0  # no spin, tail at rest
    n = 100
    z, vx = scene.simulate(np.zeros((n, 0)), x0=start).T
    k = np.arange(n)
    np.testing.assert_allclose(z, 1.0 - 9.81 * 0.002**2 * k * (k + 1) / 2, atol=1e-6)  # semi-implicit sums
    np.testing.assert_allclose(vx, start[11], atol=1e-9)


def test_quaternions_turn_with_the_angular_velocity_of_the_body():
    scene = MuJoCoSimulator(SCENE)
    model = mujoco.MjModel.from_xml_string(SCENE)
    x = scene.keyframe("up") + 0.1 * np.random.default_rng(0).normal(size=len(scene.states))
    for part in (slice(3, 7), slice(7, 11)):
        x[part] /= np.linalg.norm(x[part])
    later, h = x[:11].copy(), 1e-6
    mujoco.mj_integratePos(model, later, x[11:20], h)
    earlier = x[:11].copy()
    mujoco.mj_integratePos(model, earlier, x[11:20], -h)
    slope = scene.rhs(0.0, x, np.zeros(1), {})[:11]
    np.testing.assert_allclose(slope, (later - earlier) / (2 * h), atol=1e-8)
    for part in (slice(3, 7), slice(7, 11)):
        assert slope[part] @ x[part] == pytest.approx(0.0, abs=1e-12)  # the norm stays


# ---- against equations by hand --------------------------------------------------------------------------------------
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_forward_dynamics_are_those_written_by_hand(integrator):
    simulator = arm(integrator=integrator)
    x, u = points(simulator, (5, 8))
    np.testing.assert_allclose(simulator.rhs(0.0, x, u, simulator.params), arm_by_hand(0.0, x, u, {}), atol=1e-10)


@pytest.mark.parametrize(("integrator", "order"), [("Euler", 1), ("implicit", 1), ("RK4", 4)])
def test_trajectories_converge_to_the_differential_equation(integrator, order):
    names = {"states": arm().states, "inputs": ["first", "second"], "outputs": arm().states}
    exact = ODESimulator(arm_by_hand, params={}, dt=0.02, **names)
    U = np.random.default_rng(0).normal(size=(40, 2))
    start = [0.5, -0.4, 1.0, -1.0]
    Y = exact.simulate(U, x0=start)
    steps = [0.02, 0.01, 0.005]  # the reference is exact to about 1e-8
    errors = [np.abs(arm(h, integrator, dt=0.02).simulate(U, x0=start) - Y).max() for h in steps]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), order, atol=0.25)


# ---- against MuJoCo's own loop --------------------------------------------------------------------------------------
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_runs_are_those_of_the_own_loop_of_mujoco(integrator):
    simulator = arm(integrator=integrator, dt=0.01)
    U = np.random.default_rng(0).normal(size=(60, 2))
    np.testing.assert_array_equal(simulator.simulate(U), own_loop(simulator, U, 5))


def test_runs_with_contacts_and_activations_are_those_of_the_own_loop():
    scene = MuJoCoSimulator(SCENE, dt=0.004)
    scene.set_params(outputs=scene.states)
    U = np.full((150, 1), 1e-3)
    Y = scene.simulate(U)
    np.testing.assert_array_equal(Y, own_loop(scene, U, 2))
    assert Y[-1, 2] == pytest.approx(0.2, abs=5e-3)  # it stands on the floor
    assert Y[-1, -1] == pytest.approx(1e-3 * (1.0 - np.exp(-0.596 / 0.1)), rel=1e-3)  # the filter of the actuator


def test_samples_one_by_one_are_the_run():
    simulator = arm(dt=0.01)
    U = np.random.default_rng(0).normal(size=(30, 2))
    Y, x = simulator.simulate(U), simulator.x0
    for k in range(29):
        x = simulator.step(0.01 * k, x, U[k], simulator.params, 0.01)
        np.testing.assert_allclose(x, Y[k + 1], atol=1e-12)


def test_a_short_step_is_the_forward_dynamics():
    simulator = arm()
    x, u = points(simulator, (6,))
    h = 1e-6
    slope = (simulator.step(0.0, x, u, {}, h) - x) / h
    np.testing.assert_allclose(slope, simulator.rhs(0.0, x, u, {}), atol=1e-3)  # O(h) and rounding / h


def test_batches_threads_and_points_give_the_single_numbers():
    simulator = arm(dt=0.01)
    rng = np.random.default_rng(0)
    U, X0 = rng.normal(size=(5, 20, 2)), rng.normal(size=(5, 4))
    alone = np.stack([simulator.simulate(u, x0) for u, x0 in zip(U, X0)])
    np.testing.assert_array_equal(simulator.simulate_batch(U, X0), alone)
    both = clone(simulator).set_params(n_threads=2)
    np.testing.assert_array_equal(both.simulate_batch(U, X0), alone)
    both.close()
    x, u = points(simulator, (2, 3))
    many = simulator.step(0.0, x, u, {}, 0.01)
    one = simulator.step(0.0, x[:, 1, 2], u[:, 1, 2], {}, 0.01)
    assert many.shape == (4, 2, 3) and one.shape == (4,)
    np.testing.assert_array_equal(many[:, 1, 2], one)


# ---- inputs, ports, outputs -----------------------------------------------------------------------------------------
def test_a_force_at_a_port_is_the_torque_of_a_motor_of_gear_one():
    simulator = arm(dt=0.01)
    x, u = points(simulator, (7,))
    torque = np.random.default_rng(1).normal(size=7)
    forces = np.stack([np.zeros(7), torque])
    assert simulator.ports == ["shoulder", "elbow"]
    through = u + forces
    for ask in (simulator.rhs, lambda *a, **k: simulator.step(*a, 0.01, **k)):
        np.testing.assert_allclose(ask(0.0, x, u, {}, forces=forces), ask(0.0, x, through, {}), atol=1e-10)


def test_a_joint_can_be_an_input():
    U = np.random.default_rng(0).normal(size=(30, 2))
    driven = arm(inputs=["shoulder", "second"], dt=0.01)
    assert driven.ports == ["elbow"]
    np.testing.assert_allclose(driven.simulate(U), arm(dt=0.01).simulate(U * [0.5, 1.0]), atol=1e-12)  # gear 2


def test_a_port_gives_way_to_an_actuator_of_its_name():
    simulator = MuJoCoSimulator(ARM.format(step=0.002, integrator="Euler").replace('name="second"', 'name="elbow"'))
    assert simulator.inputs == ["first", "elbow"]
    assert simulator.ports == ["shoulder", "elbow.force"]


def test_sensors_read_the_state_and_the_input_of_their_row():
    scene = MuJoCoSimulator(SCENE, dt=0.01)
    assert scene.outputs == ["acc.x", "acc.y", "acc.z", "pose.w", "pose.x", "pose.y", "pose.z", "load", "time"]
    U = np.random.default_rng(0).normal(size=(20, 1))
    t = 3.0 + 0.01 * np.arange(20)
    Y = scene.simulate(U, x0=scene.keyframe("up"), t=t)
    np.testing.assert_allclose(Y[:, 8], t)
    X, dX = scene.simulate_states(U, scene.keyframe("up"), t)
    np.testing.assert_allclose(Y[:, 7], X[:, -1])  # the motor pulls with its activation
    np.testing.assert_allclose(dX[:, -1], (U[:, 0] - X[:, -1]) / 0.1)
    np.testing.assert_allclose(scene.output(t, X.T, U.T, scene.params), Y.T, atol=1e-6)  # tolerance of the solver
    states = clone(scene).set_params(outputs=["root.pos.z", "pose.w"])
    np.testing.assert_array_equal(states.simulate(U, scene.keyframe("up"))[:, 1], Y[:, 3])


def test_names_of_free_and_ball_joints_are_counted_as_mujoco_counts():
    scene = MuJoCoSimulator(SCENE)
    assert len(scene.states) == 11 + 9 + 1
    assert scene.states[3] == "root.pos.qw" and scene.states[14] == "root.vel.rx" and scene.states[-1] == "spin.act"
    assert scene.kinematic == scene.states[:11]
    assert scene.ports[:3] == ["root.x", "root.y", "root.z"] and scene.ports[-1] == "ball.rz"
    assert scene.params["tail.mass"] == 0.1 and "shell.friction" in scene.params


# ---- parameters -----------------------------------------------------------------------------------------------------
def test_parameters_enter_the_equations_where_they_should():
    simulator = pendulum(damping=0.2)
    x = np.array([[0.3, 0.3, 0.3], [1.5, 1.5, 1.5]])
    own = simulator.rhs(0.0, x, np.zeros((1, 3)), {})[1]
    damped = simulator.rhs(0.0, x, np.zeros((1, 3)), {"hinge.damping": np.array([0.2, 0.5, 1.0])})[1]
    np.testing.assert_allclose(damped, own - np.array([0.0, 0.3, 0.8]) * 1.5 / INERTIA, atol=1e-10)
    heavy = simulator.rhs(0.0, x[:, 0], np.ones(1), {"hinge.armature": 0.3, "hinge.stiffness": 2.0, "torque.gear": 3.0})
    expected = (3.0 - 0.2 * 1.5 - 2.0 * 0.3 - WEIGHT * np.sin(0.3)) / (INERTIA + 0.3)
    assert heavy[1] == pytest.approx(expected, abs=1e-10)
    light = simulator.rhs(0.0, x[:, 0], np.zeros(1), {"body1.mass": 1.0})  # the inertia goes with the mass
    assert light[1] == pytest.approx((-0.2 * 1.5 - 0.5 * WEIGHT * np.sin(0.3)) / (0.5 * INERTIA), abs=1e-10)


def test_dry_friction_holds_and_brakes():
    stuck = pendulum(friction=1.0, integrator="Euler").simulate(np.full((500, 1), 0.9))
    assert np.abs(stuck[:, 0]).max() < 1e-2  # the constraint is soft: it creeps
    assert pendulum(friction=1.0).rhs(0.0, [0.0, 3.0], [0.0], {})[1] == pytest.approx(-1.0 / INERTIA, rel=1e-6)


def test_many_sets_of_parameters_are_simulated_with_few_models():
    simulator = pendulum()
    damping = np.linspace(0.0, 1.0, 150)  # more than there are copies
    x = np.tile([[0.3], [1.0]], (1, 150))
    slope = simulator.rhs(0.0, x, np.zeros((1, 150)), {"hinge.damping": damping})[1]
    np.testing.assert_allclose(slope, slope[0] - damping / INERTIA, atol=1e-10)


def test_the_users_model_is_never_written():
    model = mujoco.MjModel.from_xml_string(ARM.format(step=0.002, integrator="Euler"))
    before = pickle.dumps(model)
    simulator = MuJoCoSimulator(model, dt=0.01)
    simulator.set_params(**{"params__elbow.damping": 0.5, "params__lower.mass": 2.0})
    simulator.simulate(np.ones((5, 2)))
    assert pickle.dumps(model) == before


def test_parameters_by_name_are_new_dicts():
    given = {"elbow.damping": 0.2}
    simulator = arm(params=given).set_params(**{"params__elbow.damping": 0.4})
    assert given == {"elbow.damping": 0.2} and simulator.params == {"elbow.damping": 0.4}
    assert arm(params=["upper.mass"]).params == {"upper.mass": 1.5}
    assert simulator.get_params()["params__elbow.damping"] == 0.4


def test_retuned_and_set_parameters_are_the_same_simulator():
    U = np.random.default_rng(0).normal(size=(20, 2))
    retuned = AugmentedSimulator(arm(dt=0.01), retuned={"elbow.damping": 0.4})
    given = arm(dt=0.01).set_params(**{"params__elbow.damping": 0.4})
    np.testing.assert_array_equal(retuned.simulate(U), given.simulate(U))


def test_calibration_finds_a_damping():
    plant = pendulum(step=0.005, integrator="Euler", damping=0.3, outputs=["hinge.pos"], dt=0.02)
    U = np.random.default_rng(0).normal(size=(100, 1)).cumsum(axis=0)
    Y = plant.simulate(U) + 1e-4 * np.random.default_rng(1).normal(size=(100, 1))
    nominal = clone(plant).set_params(**{"params__hinge.damping": 0.2})
    fitted = CalibratedSimulator(nominal, params=["hinge.damping"]).fit(U, Y[:, 0])
    low, high = fitted.intervals_["hinge.damping"]
    assert low < 0.3 < high and high - low < 0.01


# ---- the protocol ---------------------------------------------------------------------------------------------------
def test_the_own_step_is_what_a_diagnosis_uses():
    assert describe(arm()).access == "step"
    assert not hasattr(AugmentedSimulator(arm()), "rhs")
    local = linearise(arm(), np.zeros(4), np.zeros(2))
    np.testing.assert_allclose(local.A[:2, 2:], 0.002 * local.A[2:, 2:], atol=1e-9)  # semi-implicit: q += h v(later)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_steps_of_order_four_are_the_forward_dynamics_and_others_are_a_simulator_of_their_own(integrator):
    """A sample of 20 ms in steps of 2 ms, and by the forward dynamics: to the error of RK4, or to that of a step of order one."""
    simulator = arm(integrator=integrator)
    x, u = points(simulator, (5,))
    by_steps, by_rates = simulator.step(0.0, x, u, {}, 0.02), x
    for _ in range(40):
        by_rates = rk4_step(lambda x: simulator.rhs(0.0, x, u, {}), by_rates, 0.02 / 40)
    apart = np.abs(by_steps - by_rates).max()
    assert (apart < 1e-6, apart > 1e-4) == ((True, False) if integrator == "RK4" else (False, True))
    assert describe(simulator).access == ("rhs" if integrator == "RK4" else "step")


def test_positions_that_are_quaternions_keep_the_own_step():
    assert describe(MuJoCoSimulator(SCENE.replace("<mujoco>", '<mujoco><option integrator="RK4"/>'))).access == "step"


def test_delayed_actuators_are_simulated_by_trajectories_only():
    text = ARM.format(step=0.002, integrator="Euler").replace(
        'joint="elbow"/>', 'joint="elbow" delay="0.01" nsample="8"/>'
    )
    try:
        simulator = MuJoCoSimulator(text)
        simulator.simulate(np.zeros((2, 2)))
    except SimulatorError as error:  # an older MuJoCo
        pytest.skip(str(error))
    assert describe(simulator).access == "trajectory"
    U = np.zeros((12, 2))
    U[0, 1] = 1.0
    v = simulator.simulate(U)[:, 3]
    assert np.all(v[:5] == 0) and v[8] > 0


@pytest.mark.parametrize("simulator", [pendulum(damping=0.1, dt=0.01), arm(dt=0.004), MuJoCoSimulator(SCENE)])
def test_the_protocol_of_simulators(simulator):
    check_simulator(simulator)


def test_copies_open_their_own_model():
    simulator = arm(dt=0.01)
    U = np.ones((5, 2))
    Y = simulator.simulate(U)
    assert "_handle" not in simulator.__getstate__()
    for copy in (clone(simulator), pickle.loads(pickle.dumps(simulator))):
        np.testing.assert_array_equal(copy.simulate(U), Y)
    assert "model=" in repr(simulator) and "inputs" not in repr(simulator)


def _in_worker(simulator):
    return simulator.simulate(np.ones((5, 2)))


@pytest.mark.parametrize("n_threads", [1, 2])
def test_worker_processes_open_their_own_model(n_threads):
    simulator = arm(dt=0.01, n_threads=n_threads)
    Y = simulator.simulate(np.ones((5, 2)))
    global _HERE
    _HERE = simulator  # a forked child finds it open, with threads that it does not have
    with ProcessPoolExecutor(1, get_context("fork")) as workers:
        np.testing.assert_array_equal(workers.submit(_in_worker, simulator).result(60), Y)
        np.testing.assert_array_equal(workers.submit(_open_in_worker).result(60), Y)
    simulator.close()


def _open_in_worker():
    return _in_worker(_HERE)


def test_a_run_that_blows_up_says_so_and_writes_no_file(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    runaway = pendulum(step=0.01, integrator="Euler", dt=0.01).set_params(**{"params__hinge.damping": -500.0})
    with pytest.raises(SimulationDiverged, match=r"hinge"):
        runaway.simulate(np.ones((200, 1)))
    assert np.isnan(runaway.step(0.0, [np.nan, 0.0], [0.0], {}, 0.01)).all()
    assert np.isnan(runaway.step(0.0, [0.0, 0.0], [0.0], {"body1.mass": -1.0}, 0.01)).all()
    assert not list(tmp_path.iterdir())
    assert not "".join(capfd.readouterr())


def test_a_file_that_changed_is_read_again(tmp_path):
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM.format(step=0.01, integrator="Euler", damping=0.1, friction=0))
    simulator = MuJoCoSimulator(path)
    assert simulator.params["hinge.damping"] == 0.1
    path.write_text(PENDULUM.format(step=0.01, integrator="Euler", damping=0.25, friction=0))
    assert simulator.params["hinge.damping"] == 0.25


# ---- errors ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"inputs": ["third"]}, r"inputs: 'third' is neither an actuator nor a joint of the model; it has \['first'"),
        ({"inputs": ["first", "first"]}, r"inputs: 'first' is listed twice"),
        (
            {"outputs": ["elbow"]},
            r"outputs: 'elbow' is neither a state nor a sensor of the model; did you mean 'elbow.*'\? it has \['shoulder.pos'",
        ),
        ({"params": ["elbow.friction"]}, r"params: 'elbow.friction' is not a parameter of the model"),
        ({"params": {"elbow.damping": "soft"}}, r"params: elbow.damping='soft', expected a number"),
        (
            {"params": {"upper.mass": 0.0}},
            r"params: upper.mass=0 is no value of the model; expected a finite number above 0",
        ),
        (
            {"params": {"elbow.damping": np.nan}},
            r"elbow.damping=nan is no value of the model; expected a finite number\.",
        ),
        ({"x0": [0.0, 1e200, 0.0, 0.0]}, r"a smaller timestep or integrator=.implicitfast. \(<option"),
        ({"dt": 0.003}, r"dt is 0.003, expected a positive multiple of the model's timestep 0.002"),
        ({"x0": [0.0]}, r"x0 has 1 values, expected 4: one for each of states=\['shoulder.pos'"),
        ({"n_threads": 0}, r"n_threads=0: expected None, -1 or a positive integer"),
    ],
)
def test_mistakes_in_the_constructor_are_named(options, match):
    with pytest.raises(SimulatorError, match=match):
        arm(**options).simulate(np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("model", "match"),
    [
        ("no_such.xml", r"model='no_such.xml': there is no such file"),
        ("<mujoco><worldbodi/></mujoco>", r"MuJoCo cannot read the XML text: .*worldbodi"),
        ("<mujoco/>", r"model has no joint"),
        (3, r"model=3: expected the path of an MJCF or URDF file"),
    ],
)
def test_models_that_cannot_be_read_are_named(model, match):
    with pytest.raises(SimulatorError, match=match):
        MuJoCoSimulator(model).simulate(np.zeros((3, 0)))


def test_a_model_that_is_not_compiled_says_how_to_give_it():
    with pytest.raises(SimulatorError, match=r"not MjSpec; give model.compile\(\), or model.to_xml\(\)"):
        MuJoCoSimulator(mujoco.MjSpec()).simulate(np.zeros((3, 0)))


def test_mistakes_in_the_data_are_named():
    simulator = arm(dt=0.01)
    with pytest.raises(SimulatorError, match=r"U has shape \(3, 1\), expected \(n_samples, 2\): one column for each"):
        simulator.simulate(np.zeros((3, 1)))
    with pytest.raises(SimulatorError, match=r"U is not finite in row 1"):
        simulator.simulate([[0.0, 0.0], [np.nan, 0.0]])
    with pytest.raises(SimulatorError, match=r"rows of t are apart by 0.003, expected a positive multiple"):
        simulator.simulate(np.zeros((3, 2)), t=[0.0, 0.003, 0.006])
    with pytest.raises(SimulatorError, match=r"params: the model has no parameter 'k'"):
        simulator.step(0.0, np.zeros(4), np.zeros(2), {"k": 1.0}, 0.01)
    with pytest.raises(SimulatorError, match=r"name: 'home' is not a keyframe of the model; it has \[\]"):
        simulator.keyframe("home")
