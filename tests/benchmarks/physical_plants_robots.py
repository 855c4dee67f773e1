"""Ten simulated robots as a robotics laboratory would identify them: seven MuJoCo models, two right-hand sides, a step.

Four robots have one effect in the form that hardware gives it, two have two at different places, two have a parameter
that is 18 to 25 % off (alone, and beside an effect), one has an effect of no entry of the catalogue, one has none.
``ACCEPTED``, ``NEAR`` and ``WRONG`` are as in ``physical_plants_trades``; all were fixed by engineering judgement
before any diagnosis. ``NOISE`` and ``CHECK`` are those of ``physical_plants_service``, as are most helpers.

    python tests/benchmarks/physical_plants_robots.py [NAME ...] [--seed 91]

prints sizes over the noise: of the gap, of all effects, of each of two effects, and of the rest, which is what the
integrator of the nominal model errs by where the plant takes shorter steps.
"""

import mujoco
import numpy as np
from physical_plants import case, sines, steps
from physical_plants_service import CHECK, NOISE, hand_in, main, play, twin  # noqa: F401
from physical_plants_trades import led_in, quiet, rk4
from scipy.linalg import solve_discrete_are

from sksurrogate.physics import ClosedLoopSimulator, MuJoCoSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, WRONG = {}, {}, {}
DRY = ("stribeck", "coulomb", "asymmetric", "lugre")


def rig(name, rng, sim, made, begins, act, noise, *, finer=None, change=None, hidden=None, grid=0.0, parts=()):
    """Inputs, readings and runs of a plant of MuJoCo that takes steps of ``finer`` seconds (the model's by default).

    ``act(m, d, u, z, on)`` gives forces at the joints, inputs of the actuators, and hidden states a step later, which
    begin at ``hidden(u)``; ``u(late)`` are commands of so many seconds before. ``change(m, on)`` writes parameters.
    """

    columns = [sim.states.index(a) for a in sim.outputs]

    def campaign(*on):
        out = []
        for U, x in zip(made, begins):
            m = mujoco.MjModel.from_xml_string(sim.model)
            m.opt.timestep = h = finer or m.opt.timestep
            d, n = mujoco.MjData(m), round(sim.dt / h)
            if change:
                change(m, on)
                mujoco.mj_setConst(m, d)
            d.qpos[:], d.qvel[:], z = x[: m.nq], x[m.nq :], hidden(U[0]) if hidden else None
            for k in range(n * len(U)):
                if k % n == 0:
                    out.append(np.r_[d.qpos, d.qvel])
                past = lambda late=0.0: U[max(k - round(late / h), 0) // n]  # noqa: B023, E731
                d.qfrc_applied[:], d.ctrl[:], z = act(m, d, past, z, on)
                mujoco.mj_step(m, d)
        return np.array(out)[:, columns]

    e = rng.normal(size=(sum(len(U) for U in made), len(columns)))
    return hand_in(name, rng, sim, made, begins, campaign, e, noise, grid, parts=parts)


def stuck(m, d, command, j):
    """The force at joint j that makes it stand still after the next step."""
    d.qfrc_applied[:], d.ctrl[:], unit = 0, command, np.eye(m.nv)[[j]]
    mujoco.mj_forward(m, d)
    free, yields = d.qacc[j], np.zeros((1, m.nv))
    mujoco.mj_solveM(m, d, yields, unit)
    return -(d.qvel[j] / m.opt.timestep + free) / yields[0, j]


# ------------------------------------------------------------------------------------------ one effect


RAIL = """<mujoco><option timestep="0.002" integrator="Euler"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="cart" pos="0 0 1"><joint name="rail" type="slide" axis="1 0 0" damping="4"/>
<geom type="box" size="0.08 0.05 0.03" mass="0.9"/><body name="rod"><joint name="pole" axis="0 1 0" damping="0.003"/>
<geom type="capsule" size="0.008" fromto="0 0 0 0 0 -0.5" mass="0.22"/></body></body></worldbody>
<actuator><position name="drive" joint="rail" kp="160" kv="14"/></actuator></mujoco>"""


@case
def rail_pole(rng):
    """Cart-pole whose pole hangs, cart in the position loop of its drive; m and rad, samples of 10 ms.

    The wipers of the carriage stick: the cart holds still up to 2.6 N and slides at 1.4 N, Stribeck width 0.04 m/s; a
    switch between stick and slip (Karnopp). The simulator is a model of MuJoCo with viscous losses.
    """

    def act(m, d, u, z, on):
        limit = on[0] * (1.4 + 1.2 * np.exp(-((d.qvel[0] / 0.04) ** 2)))
        return [np.clip(stuck(m, d, u(), 0), -limit, limit), 0], u(), z

    sim = MuJoCoSimulator(
        RAIL, outputs=["rail.pos", "pole.pos"], params=["rail.damping", "pole.damping", "cart.mass", "rod.mass"],
        dt=0.01,
    )  # fmt: skip
    made, begins, n = [], [], 400
    for r in range(4):
        ref = steps(rng, n, -0.14, 0.14, 70) + sines(rng, n, 0.01, 0.02 + 0.01 * r, 0.2, 1.6, 6)
        made.append(np.round(led_in(ref * np.minimum(1, np.arange(n) / 20)), 4)[:, None])
        begins.append(np.array([0, rng.uniform(-0.3, 0.3), 0, 0]))
    data = rig("rail_pole", rng, sim, made, begins, act, 0.01)
    return sim, *data, "stribeck_friction@rail of rail.vel 1.4 to 2.6 N (with true sticking)"


ACCEPTED["rail_pole"] = [[f"{a}_friction@rail of rail.vel (or @drive, over kp)" for a in DRY]]
NEAR["rail_pole"] = [
    "hysteresis@rail of rail.pos, linear_loss@rail of rail.vel or parameter_error@rail.damping (+), said to be partial",
    "input_backlash@drive, said to be partial",
]  # fmt: skip
WRONG["rail_pole"] = [
    "any friction at pole, or a name at pole said to be all",
    "input_backlash, _dead_zone, _lag, _delay or _gain@drive, or a parameter_error said to be all", "a sensor effect",
]  # fmt: skip


@case
def delta_axis(rng):
    """Delta robot whose three arms go up and down together, one joint with gravity and a loop in its drive, 10 ms.

    Arm and plate make a mass and a gravity that depend on the angle. The teeth of the gear rub more as they carry more:
    0.5 N m and 0.16 of the torque, smooth within 0.02 rad/s (the usual friction model of harmonic drives). The
    simulator, a right-hand side, has viscous losses.
    """
    p = {"J": 0.03, "plate": 1.5, "arm": 0.35, "b": 0.35, "kp": 55.0, "kd": 2.2}

    def legs(q):  # plate below the base of arms of 0.2 m, rods of 0.45 m, an offset of 0.06 m; slope, bend
        c, s = 0.2 * np.cos(q), 0.2 * np.sin(q)
        w, e = c + 0.06, np.sqrt(0.45**2 - (c + 0.06) ** 2)
        slope = c + w * s / e
        return slope, -s + (w * c - s * s) / e - (w * s) ** 2 / e**3

    def nom(t, x, u, p, rub=(0.0, 0.0)):
        q, w = x
        slope, bend = legs(q)
        M = p["J"] + p["plate"] / 3 * slope * slope
        drive = p["kp"] * (u[0] - q) - p["kd"] * w
        pull = 9.81 * (p["plate"] / 3 * slope + p["arm"] * 0.1 * np.cos(q))
        dry = (rub[0] + rub[1] * abs(drive)) * np.tanh(w / 0.02) if rub[0] else 0.0
        return w, (drive + pull - p["plate"] / 3 * slope * bend * w * w - p["b"] * w - dry) / M

    def true(t, x, u, d, on):
        return nom(t, x, u, p, (0.5 * on[0], 0.16 * on[0]))

    def plan(r):
        n = 400
        ref = 0.25 + steps(rng, n, -0.5, 0.5, 60) + sines(rng, n, 0.01, 0.08 + 0.03 * r, 0.3, 2.0, 6)
        return np.round(led_in(ref), 4), quiet(n)

    sim = ODESimulator(nom, states=["q", "w"], inputs=["ref"], outputs=["q"], params=p, dt=0.01)
    data = twin(
        "delta_axis", rng, sim, true, plan, lambda r, u: [u[0] + rng.uniform(0, 0.15), 0], see=lambda X, on: X[:, :1],
        noise=0.006, runs=4, scale=0.1, grid=2 * np.pi / 65536,
    )  # fmt: skip
    return sim, *data, "coulomb_friction@w of w 0.5 N m and 0.16 of the torque of the drive"


ACCEPTED["delta_axis"] = [[f"{a}_friction@w of w (or @ref)" for a in DRY]]
NEAR["delta_axis"] = [
    "linear_loss@w of w, parameter_error@b or @kd (+), or hysteresis@w of q, said to be partial",
    "power_law@w of w (exponent below 0.6)", "parameter_dependence@b on a signal",
]  # fmt: skip
WRONG["delta_axis"] = [
    "parameter_error, linear_loss@w, or an input effect at ref said to be all", "a sensor effect",
]  # fmt: skip


HOPPER = """<mujoco><option timestep="0.001" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body name="torso" pos="0 0 1">
<joint name="slide" type="slide" axis="0 0 1" stiffness="260" damping="9" springref="0.1"/>
<geom type="box" size="0.06 0.05 0.04" mass="1.6"/><body name="thigh">
<joint name="hip" axis="0 1 0" damping="0.16" armature="0.012" stiffness="2.5"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.16" mass="0.7"/><body name="shank" pos="0 0 -0.16">
<joint name="knee" axis="0 1 0" damping="0.05" armature="0.007" stiffness="1.2"/>
<geom type="capsule" size="0.012" fromto="0 0 0 0 0 -0.16" mass="0.22"/></body></body></body></worldbody>
<actuator><motor name="hip_motor" joint="hip"/><motor name="knee_motor" joint="knee"/></actuator></mujoco>"""


@case
def hopper_leg(rng):
    """Leg of a hopping robot on its vertical slide with a bungee, swung in the air, torques in N m, samples of 5 ms.

    The supply limits the knee motor: 1.3 N m at standstill, none at 9 rad/s, in the direction of the motion (line of
    torque and speed of a direct-current motor). The simulator is a model of MuJoCo with ideal torques.
    """

    def act(m, d, u, z, on):
        hip, knee = u()
        back = 1.3 * d.qvel[2] / 9
        return [0, 0, 0], [hip, np.clip(knee, -1.3 - back, 1.3 - back) if on[0] else knee], z

    sim = MuJoCoSimulator(
        HOPPER, outputs=["slide.pos", "hip.pos", "knee.pos"], params=["hip.damping", "knee.damping", "slide.damping",
        "shank.mass", "knee.armature"], dt=0.005,
    )  # fmt: skip
    made, begins, n = [], [], 500
    for r in range(4):
        ramp = np.minimum(1, np.arange(n) / 40)
        hip = sines(rng, n, 0.005, 1.5 + 0.3 * r, 0.6, 3.5, 6)
        knee = sines(rng, n, 0.005, 0.38 + 0.04 * r, 0.8, 3.5, 6)
        made.append(np.round(np.c_[hip * ramp, knee * ramp], 3))
        begins.append(np.array([0.1 - 2.52 * 9.81 / 260, 0, rng.uniform(-0.2, 0.2), 0, 0, 0]))
    data = rig("hopper_leg", rng, sim, made, begins, act, [0.02, 0.01, 0.01])
    return sim, *data, "input_saturation@knee_motor (1.3 N m less 0.144 N m s of the speed)"


ACCEPTED["hopper_leg"] = [["input_saturation@knee_motor", "unknown or partial at knee_motor or knee"]]
NEAR["hopper_leg"] = [
    "input_gain (-) or input_curve@knee_motor (c < 0), said to be partial",
    "any loss or drag@knee of knee.vel, or parameter_error@knee.damping (+), said to be partial",
    "input_saturation@knee_motor beside any loss or drag@knee of knee.vel",
]  # fmt: skip
WRONG["hopper_leg"] = [
    "any name at hip, hip_motor or slide said to be all, or a sensor effect",
    "any loss, drag or friction@knee, or a parameter_error said to be all",
    "input_gain, _lag, _delay, _dead_zone or rate_limit@knee_motor said to be all",
]  # fmt: skip


DESK = """<mujoco><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body name="column" pos="0 0 0.2">
<joint name="base" axis="0 0 1" damping="0.6" armature="0.03"/><geom type="cylinder" size="0.05 0.05" mass="1.2"/>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.7" armature="0.04"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.25" mass="1.1"/><body name="fore" pos="0 0 0.25">
<joint name="elbow" axis="0 1 0" damping="0.4" armature="0.02"/>
<geom type="capsule" size="0.025" fromto="0 0 0 0.22 0 0" mass="0.6"/><body name="tool" pos="0.22 0 0">
<joint name="roll" axis="1 0 0" damping="0.05" armature="0.002"/>
<geom type="capsule" size="0.015" fromto="0 -0.08 0 0 0.08 0" mass="0.35"/></body></body></body></body></worldbody>
<actuator><position name="base_servo" joint="base" kp="45" kv="3"/><position name="shoulder_servo" joint="shoulder"
kp="90" kv="6"/><position name="elbow_servo" joint="elbow" kp="45" kv="2"/><position name="roll_servo" joint="roll"
kp="5" kv="0.25"/></actuator></mujoco>"""


@case
def desk_arm(rng):
    """Desk-top arm of four joints with position servos, angles from encoders at the links, samples of 20 ms.

    The last gear stage of the roll axis has play: 0.045 rad to each side between motor and tool, and teeth that yield
    (60 N m/rad, 0.06 N m s/rad while they touch); its servo sees the motor. The simulator is a model of MuJoCo with the
    rotor as an armature of the joint.
    """

    def act(m, d, u, z, on):
        if not on[0]:
            return [0, 0, 0, 0], u(), z
        (a, w), h, lag = z, m.opt.timestep, z - [d.qpos[3], d.qvel[3]]
        bite = lag[0] - np.clip(lag[0], -0.045, 0.045)
        mesh = 60 * bite + 0.06 * lag[1] if bite else 0.0
        mesh = mesh if mesh * bite > 0 else 0.0  # teeth push, they never pull
        w = w + h / 0.002 * (5 * (u()[3] - a) - 0.25 * w - mesh)
        return [0, 0, 0, mesh], u(), np.array([a + h * w, w])

    def change(m, on):  # the rotor is a body of its own
        if on[0]:
            m.dof_armature[3], m.actuator_gainprm[3], m.actuator_biasprm[3] = 0, 0, 0

    names = ("base", "shoulder", "elbow", "roll")
    sim = MuJoCoSimulator(
        DESK, outputs=[f"{a}.pos" for a in names], params=[*(f"{a}.damping" for a in names), "tool.mass", "fore.mass",
        "roll_servo.kp"], dt=0.02,
    )  # fmt: skip
    made, begins, n = [], [], 300
    for r in range(3):
        ramp = np.minimum(1, np.arange(n) / 20)[:, None]
        ref = [steps(rng, n, -a, a, 50) + sines(rng, n, 0.02, a / 3, 0.15, 1.2, 5) for a in (0.5, 0.35, 0.4)]
        roll = steps(rng, n, -0.25, 0.25, 60) + sines(rng, n, 0.02, 0.3, 0.1, 1.2, 6)
        made.append(np.round(np.c_[(*ref, roll)] * ramp, 3))
        begins.append(np.zeros(8))
    more = {"finer": 2.5e-4, "hidden": lambda u: np.zeros(2), "grid": 2 * np.pi / 4096}
    data = rig("desk_arm", rng, sim, made, begins, act, 0.01, change=change, **more)
    return sim, *data, "input_backlash@roll_servo 0.045 rad (with a mesh of 60 N m/rad)"


ACCEPTED["desk_arm"] = [["input_backlash@roll_servo"]]
NEAR["desk_arm"] = [
    "hysteresis@roll of roll.pos, any dry friction@roll of roll.vel, or hidden_mode@roll, said to be partial",
    "input_backlash@roll_servo beside a small input_lag, input_delay, hidden_mode or parameter_error at roll",
    "input_delay, input_lag or input_dead_zone@roll_servo, said to be partial",
]  # fmt: skip
WRONG["desk_arm"] = [
    "any name at base, shoulder or elbow", "any friction@roll, or a sensor effect said to be all",
    "input_delay, input_lag or input_gain@roll_servo, or a parameter_error said to be all",
]  # fmt: skip


# ------------------------------------------------------------------------------------------ two effects


PLANAR = """<mujoco><option timestep="0.001" integrator="Euler"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="inner" pos="0 0 0.4"><joint name="shoulder" axis="0 0 1" damping="0.8" armature="0.02"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="2.2"/><body name="outer" pos="0.3 0 0">
<joint name="elbow" axis="0 0 1" damping="0.25"/><geom type="capsule" size="0.02" fromto="0 0 0 0.25 0 0" mass="0.9"/>
</body></body></worldbody><actuator><position name="shoulder_servo" joint="shoulder" kp="70" kv="8"/>
<position name="elbow_servo" joint="elbow" kp="10" kv="0.9"/></actuator></mujoco>"""


@case
def planar_direct(rng):
    """Horizontal arm of two links, a geared shoulder and a direct-drive elbow in position loops, samples of 10 ms.

    The frame with the command of the shoulder waits one and a half samples on the bus, and the magnets of the elbow
    cog: 0.55 N m eight times a turn, with a quarter of it at twice the rate. The simulator is a model of MuJoCo.
    """

    def act(m, d, u, z, on):
        q = d.qpos[1]
        cog = 0.55 * np.sin(8 * q + 0.4) + 0.14 * np.sin(16 * q + 1.1)
        return [0, -on[1] * cog], [u(0.015 * on[0])[0], u()[1]], z

    sim = MuJoCoSimulator(
        PLANAR, outputs=["shoulder.pos", "elbow.pos"], params=["shoulder.damping", "elbow.damping", "outer.mass",
        "shoulder_servo.kp", "elbow_servo.kp"], dt=0.01,
    )  # fmt: skip
    made, begins, n = [], [], 350
    for r in range(4):
        one = steps(rng, n, -0.5, 0.5, 50) + sines(rng, n, 0.01, 0.15, 0.3, 1.8, 6)
        two = steps(rng, n, -0.9, 0.9, 60) + sines(rng, n, 0.01, 0.3, 0.15, 1.2, 6)
        made.append(np.round(np.c_[one, two] * np.clip((np.arange(n) - 5) / 20, 0, 1)[:, None], 4))
        begins.append(np.zeros(4))
    data = rig("planar_direct", rng, sim, made, begins, act, 0.01, parts=["delay", "cogging"])
    return sim, *data, "input_delay@shoulder_servo 15 ms + unknown at elbow (cogging, sin 8 q and sin 16 q)"


ACCEPTED["planar_direct"] = [
    ["input_delay@shoulder_servo", "input_delay with a small input_lag@shoulder_servo"],
    ["unknown or partial at elbow", "a law of elbow.pos at elbow or elbow_servo", "no name for it, verdict partial"],
]
NEAR["planar_direct"] = [
    "input_lag@shoulder_servo for the delay",
    "gravity_tilt, hysteresis, cubic_stiffness or linear_loss@elbow of elbow.pos for the cogging, said to be partial",
    "a dry friction@elbow of elbow.vel for the cogging, said to be partial",
]  # fmt: skip
WRONG["planar_direct"] = [
    "input_delay or input_lag@elbow_servo", "a sensor effect, or sensor_delay@shoulder.pos, said to be all",
    "any friction, backlash or parameter_error@elbow said to be all of the cogging",
]  # fmt: skip


FINGER = """<mujoco><option timestep="0.001" integrator="Euler"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body name="first" pos="0 0 0.2"><joint name="proximal" axis="0 1 0" damping="0.012" stiffness="0.35"
armature="0.0004"/><geom type="capsule" size="0.008" fromto="0 0 0 0.05 0 0" mass="0.04"/>
<body name="second" pos="0.05 0 0"><joint name="distal" axis="0 1 0" damping="0.006" stiffness="0.22"
armature="0.0002"/><geom type="capsule" size="0.007" fromto="0 0 0 0.04 0 0" mass="0.025"/></body></body></worldbody>
<tendon><fixed name="cord"><joint joint="proximal" coef="0.011"/><joint joint="distal" coef="0.008"/></fixed></tendon>
<actuator><motor name="pull" tendon="cord"/></actuator></mujoco>"""


@case
def gripper_finger(rng):
    """Finger of a gripper, two joints that one cord pulls against return springs, force in N, samples of 5 ms.

    The spindle that stretches the cord has an end speed: the force follows its command within 15 ms, but by 240 N/s at
    most. The return spring of the distal joint is a rubber hinge that hardens (0.06 N m at 1 rad, power 2.7). The
    simulator is a model of MuJoCo with linear springs and an ideal force.
    """

    def act(m, d, u, z, on):
        z = z + m.opt.timestep * np.clip((u()[0] - z) / 0.015, -240, 240)
        q = d.qpos[1]
        return [0, -on[1] * 0.06 * np.sign(q) * abs(q) ** 2.7], [z if on[0] else u()[0]], z

    sim = MuJoCoSimulator(
        FINGER, outputs=["proximal.pos", "distal.pos"], params=["proximal.damping", "distal.damping",
        "proximal.stiffness", "distal.stiffness", "pull.gear"], dt=0.005,
    )  # fmt: skip
    made, begins, n = [], [], 400
    for r in range(5):
        pull = np.clip(14 + steps(rng, n, -13, 17, 40) + sines(rng, n, 0.005, 2.5, 0.4, 3, 5), 0, None)
        made.append(np.round(led_in(pull), 2)[:, None])
        q = np.array([0.011 / 0.35, 0.008 / 0.22]) * pull[0]
        begins.append(np.r_[q * rng.uniform(0.75, 0.95, 2), 0, 0])
    more = {"finer": 5e-4, "hidden": lambda u: u[0], "parts": ["spindle", "rubber"]}
    data = rig("gripper_finger", rng, sim, made, begins, act, 0.012, **more)
    return sim, *data, "rate_limit@pull 240 N/s (with a lag of 15 ms) + cubic_stiffness@distal 0.06 (power 2.7)"


ACCEPTED["gripper_finger"] = [
    ["rate_limit@pull", "rate_limit with input_lag or input_delay@pull"],
    ["cubic_stiffness@distal of distal.pos", "power_law@distal of distal.pos (exponent 1.8 to 3.5)"],
]
NEAR["gripper_finger"] = [
    "one of both alone, said to be partial", "input_lag or input_delay@pull for the spindle",
    "end_stop, quadratic_loss or linear_loss@distal of distal.pos, or parameter_error@distal.stiffness (+), partial",
]  # fmt: skip
WRONG["gripper_finger"] = [
    "a sensor effect, input_saturation, input_curve or input_gain@pull said to be all",
    "any spring at proximal, or any friction, said to be all",
]  # fmt: skip


# ------------------------------------------------------------------------------------------ a parameter


PENDUBOT = """<mujoco><option timestep="0.002" integrator="Euler"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body name="upper" pos="0 0 1">
<joint name="shoulder" axis="0 1 0" damping="0.09" armature="0.004"/>
<geom type="capsule" size="0.012" fromto="0 0 0 0 0 -0.2" mass="0.5"/><body name="fore" pos="0 0 -0.2">
<joint name="elbow" axis="0 1 0" damping="0.006"/><geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.26" mass="0.3"/>
</body></body></worldbody><actuator><motor name="motor" joint="shoulder" gear="0.9"/></actuator></mujoco>"""


@case
def pendubot(rng):
    """Pendulum of two links that only its first joint drives, hanging, currents in A, angles, samples of 10 ms.

    The outer link, mass and inertia, is 18 % heavier than drawn (not free). The simulator is a model of MuJoCo.
    """

    def change(m, on):
        m.body_mass[2] *= 1 + 0.18 * on[0]
        m.body_inertia[2] *= 1 + 0.18 * on[0]

    sim = MuJoCoSimulator(
        PENDUBOT, outputs=["shoulder.pos", "elbow.pos"], params=["shoulder.damping", "elbow.damping", "upper.mass",
        "fore.mass", "shoulder.armature", "motor.gear"], dt=0.01,
    )  # fmt: skip
    made, begins, n = [], [], 400
    for r in range(4):
        amps = sines(rng, n, 0.01, 0.35 + 0.08 * r, 0.3, 2.2, 7) + steps(rng, n, -0.25, 0.25, 70)
        made.append(np.round(amps * np.minimum(1, np.arange(n) / 30), 3)[:, None])
        begins.append(np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.3, 0.3), 0, 0]))
    data = rig("pendubot", rng, sim, made, begins, lambda m, d, u, z, on: ([0, 0], u(), z), 0.01, change=change)
    return sim, *data, "parameter_error@fore.mass 0.18"


ACCEPTED["pendubot"] = [["parameter_error@fore.mass (+)"]]
NEAR["pendubot"] = [
    "parameter_error@fore.mass (+) beside a small parameter_error of another parameter",
    "gravity_tilt@shoulder or @elbow of its position with parameter_error@shoulder.armature (+), said to be partial",
]  # fmt: skip
WRONG["pendubot"] = [
    "another parameter_error, a law at a joint, or an input effect said to be all", "a sensor effect",
]  # fmt: skip


@case
def belt_axis(rng):
    """Linear axis with a toothed belt: angle of the motor (as a way) and linear scale, m, force in N, samples of 5 ms.

    The carriage is 25 % heavier than in the model (mc, not free: a tool plate), and the head of the scale sends the
    mean of its last 25 ms. The simulator, a step in Python, has a belt that is softer far from the motor.
    """
    p = {"mm": 2.4, "mc": 2.6, "k": 5200.0, "d": 9.0, "bm": 30.0, "bc": 14.0}

    def nom(t, x, u, p, more=0.0):  # spans from the carriage to the motor, and around the idler
        a, c, va, vc = x
        k = p["k"] * 0.5 * (0.8 / (0.9 + c) + 0.8 / (3.1 - c))
        belt = k * (a - c) + p["d"] * (va - vc)
        return va, vc, (u[0] - belt - p["bm"] * va) / p["mm"], (belt - p["bc"] * vc) / (p["mc"] * (1 + more))

    def true(t, x, u, d, on):
        return *nom(t, x[:4], u, p, 0.25 * on[0]), x[1]

    def plan(r):
        n = 500
        force = 22 * np.sign(sines(rng, n, 0.005, 1, 0.5, 1.4, 3)) + sines(rng, n, 0.005, 26 + 5 * r, 1.5, 16, 8)
        return np.round(led_in(np.clip(force, -120, 120) * np.minimum(1, np.arange(n) / 20)), 1), quiet(n)

    def see(X, on):  # column 4 is the integral of the way of the carriage, which begins at rest at 0
        mean = (X[:, 4] - np.r_[np.zeros(5), X[:, 4]][: len(X)]) / 0.025
        return np.c_[X[:, 0], mean if on[1] else X[:, 1]]

    sim = StepSimulator(
        rk4(nom, 2), states=["motor", "scale", "vm", "vc"], inputs=["force"], outputs=["motor", "scale"], params=p,
        dt=0.005,
    )  # fmt: skip
    data = twin(
        "belt_axis", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0, 0], see=see, noise=0.006, runs=4, scale=0.01,
        parts=["mass", "mean"],
    )  # fmt: skip
    return sim, *data, "parameter_error@mc 0.25 + sensor_delay@scale 12.5 ms (a mean over 25 ms)"


ACCEPTED["belt_axis"] = [["parameter_error@mc (+)"], ["sensor_delay@scale", "sensor_lag@scale", "both together"]]
NEAR["belt_axis"] = [
    "one of both alone, said to be partial",
    "parameter_error@mm (+), @k (-) or input_gain@force (-) for the carriage, said to be partial",
]  # fmt: skip
WRONG["belt_axis"] = [
    "a sensor effect at motor, or sensor_gain@scale", "input_delay or input_lag@force said to be all",
    "any friction, hidden_mode or hidden_relaxation said to be all",
]  # fmt: skip


# ------------------------------------------------------------------------------------------ an effect of no entry


WHEEL = """<mujoco><option timestep="0.004" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body name="beam" pos="0 0 1">
<joint name="pivot" axis="0 1 0" damping="0.02"/><geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.22" mass="0.2"/>
<body name="rotor" pos="0 0 -0.22"><joint name="wheel" axis="0 1 0" damping="0.0012"/>
<geom type="cylinder" size="0.06 0.008" zaxis="0 1 0" mass="0.25"/></body></body></worldbody>
<actuator><motor name="torque" joint="wheel"/></actuator></mujoco>"""


@case
def wheel_pendulum(rng):
    """Pendulum with a reaction wheel at its end, torque of the wheel in N m, angle and wheel speed, samples of 20 ms.

    A magnet that parks the beam stands beside its way, at 0.22 rad: it pulls towards itself, by 0.11 N m at most, a
    quarter of it from 0.17 rad on (the well of a magnet that passes iron). The simulator is a model of MuJoCo.
    """

    def act(m, d, u, z, on):
        e = (d.qpos[0] - 0.22) / 0.09
        return [-on[0] * 0.17 * 2 * e / (1 + e * e) ** 2, 0], u(), z

    sim = MuJoCoSimulator(
        WHEEL, outputs=["pivot.pos", "wheel.vel"], params=["pivot.damping", "wheel.damping", "rotor.mass"], dt=0.02,
    )  # fmt: skip
    made, begins, n = [], [], 350
    for r in range(5):
        torque = sines(rng, n, 0.02, 0.07 + 0.01 * r, 0.6, 1.6, 7) + steps(rng, n, -0.03, 0.03, 50)
        made.append(np.round(torque * np.minimum(1, np.arange(n) / 30), 4)[:, None])
        begins.append(np.array([rng.uniform(-0.4, 0.4), 0, 0, 0]))
    data = rig("wheel_pendulum", rng, sim, made, begins, act, 0.01)
    return sim, *data, "unknown at pivot (a magnet that pulls around 0.22 rad)"


ACCEPTED["wheel_pendulum"] = [["unknown", "a law of pivot.pos at pivot"]]
NEAR["wheel_pendulum"] = [
    "constant_bias, end_stop, gravity_tilt, cubic_stiffness, linear_loss or hysteresis@pivot, said to be partial",
    "parameter_error, said to be partial",
]  # fmt: skip
WRONG["wheel_pendulum"] = [
    "any name at wheel or torque, any friction@pivot, or a sensor effect", "any name of the catalogue said to be all",
]  # fmt: skip


# ------------------------------------------------------------------------------------------ no effect


@case
def none_rotary_upright(rng):
    """Rotary inverted pendulum that its own sampled controller keeps upright, samples of 5 ms; nothing is missing.

    A reference of the arm and a torque that is added for the identification are the inputs. The simulator is a known
    loop around a right-hand side with a mass matrix of two by two.
    """
    p = {"J": 0.006, "m": 0.12, "l": 0.16, "r": 0.18, "I": 0.0011, "ba": 0.012, "bp": 0.0006}

    def nom(t, x, u, p):
        _, q, wa, wq = x
        s, c, h = np.sin(q), np.cos(q), p["m"] * p["l"]
        A, B, D = p["J"] + p["m"] * p["r"] ** 2 + h * p["l"] * s * s, h * p["r"] * c, p["I"] + h * p["l"]
        f = u[0] + u[1] - p["ba"] * wa - 2 * h * p["l"] * s * c * wa * wq + h * p["r"] * s * wq * wq
        g = h * p["l"] * s * c * wa * wa + h * 9.81 * s - p["bp"] * wq
        det = A * D - B * B
        return wa, wq, (D * f - B * g) / det, (A * g - B * f) / det

    F = np.array([(np.array(nom(0, e, [0, 0], p)) - nom(0, -e, [0, 0], p)) / 2e-6 for e in 1e-6 * np.eye(4)]).T
    G = np.array(nom(0, np.zeros(4), [1.0, 0], p))[:, None]
    F, G = np.eye(4) + 0.005 * F + 0.0000125 * F @ F, 0.005 * G + 0.0000125 * F @ G
    P = solve_discrete_are(F, G, np.diag([2.0, 4.0, 0.05, 0.05]), [[30.0]])
    K = np.linalg.solve(30 + G.T @ P @ G, G.T @ P @ F)[0]

    def speeds(x, y):  # filters of 8 ms
        return [(b - f) / 0.008 for f, b in zip(x, y)]

    def hold(x, u):
        return -K[0] * (u[1] - u[0]) - K[1] * u[2] - sum(k * v for k, v in zip(K[2:], speeds(x, u[1:])))

    plant = ODESimulator(
        nom, states=["arm", "pend", "wa", "wp"], inputs=["torque", "added"], outputs=["arm", "pend"], params=p,
        dt=0.005,
    )  # fmt: skip
    hand = StepSimulator(
        lambda t, x, u, p, dt: [f + dt * v for f, v in zip(x, speeds(x, u[1:]))], states=["fa", "fp"],
        inputs=["aim", "arm", "pend"], outputs=["torque"], output=lambda t, x, u, p: [hold(x, u)], dt=0.005, x0=[0, 0],
    )  # fmt: skip
    sim = ClosedLoopSimulator(plant, hand, outputs=["arm", "pend", "torque"])
    made, begins, n = [], [], 500
    for r in range(4):
        added = sines(rng, n, 0.005, 0.03 + 0.005 * r, 0.5, 6, 7)
        aim = steps(rng, n, -0.6, 0.6, 160)
        made.append(np.c_[np.round(added, 4), np.round(led_in(aim - aim[0]), 2)])
        begins.append(np.zeros(6))

    def campaign(*on):
        out = []
        for U in made:
            f, V = np.zeros(2), np.c_[np.zeros(n), U]

            def loop(x, k, row, f=f):
                u = hold(f, [row[2], *x[:2]])
                f += 0.005 * np.array(speeds(f, x[:2]))
                return u, *row[1:]

            X = play(lambda t, x, u, d: nom(t, x, u, p), np.zeros(4), V, quiet(n), 0.005, 0.01, loop=loop)
            out.append(np.c_[X[:, :2], V[:, 0]])
        return np.vstack(out)

    e = rng.normal(size=(sum(len(U) for U in made), 3))
    data = hand_in("none_rotary_upright", rng, sim, made, begins, campaign, e, 0.012)
    return sim, *data, "none"


ACCEPTED["none_rotary_upright"] = [[]]
NEAR["none_rotary_upright"], WRONG["none_rotary_upright"] = [], ["any name"]


if __name__ == "__main__":
    main(ACCEPTED, 91)
