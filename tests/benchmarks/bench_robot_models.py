"""What is named in models of the kinds that MuJoCo users write, and how does the model that is written back follow unseen runs?

A cart and pole, with and without stops, an arm of two links, one with a passive elbow, a gripper with a tendon and an equality
constraint, a leg with contact, and arms of three and six joints with servos. The real one is the same model with one effect, marched by ``mj_step``.
"""

import argparse
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sksurrogate.effects import save_augmented
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import MuJoCoSimulator

#: Noise over the deviation of each output; runs that are held back.
NOISE, UNSEEN = 0.004, 2
CART = """<mujoco model="cart and pole"><compiler angle="radian"/><option timestep="0.005"/>
<default><joint damping="0.05"/><geom contype="0" conaffinity="0"/></default><worldbody>
<body><joint name="slider" type="slide" axis="1 0 0" damping="1"/><geom type="box" size="0.1 0.05 0.05" mass="1"/>
<body><joint name="hinge" axis="0 1 0" damping="0.002"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.5" mass="0.2"/></body>
</body></worldbody><actuator>{}</actuator>
<sensor><jointpos name="x" joint="slider"/><jointpos name="theta" joint="hinge"/></sensor></mujoco>"""
CART_SERVO = CART.format('<position name="drive" joint="slider" kp="100" kv="15"/>')
CART_MOTOR = CART.format('<motor name="drive" joint="slider" gear="10" ctrllimited="true" ctrlrange="-1 1"/>')
CART_STOPS = CART_MOTOR.replace('axis="1 0 0" damping="1"', 'axis="1 0 0" damping="1" limited="true" range="-0.5 0.5"')
ARM = """<mujoco model="arm"><option timestep="0.005"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
<body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.1" armature="0.01"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.7"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/>{}</actuator></mujoco>"""
PASSIVE, ARM = ARM.format(""), ARM.format('<motor name="elbow" joint="elbow"/>')
GRIPPER = """<mujoco model="gripper"><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body pos="-0.05 0 0"><joint name="left" type="slide" axis="1 0 0" damping="2" range="-0.05 0.05" stiffness="20"/>
<geom type="box" size="0.005 0.01 0.04" mass="0.1"/></body>
<body pos="0.05 0 0"><joint name="right" type="slide" axis="-1 0 0" damping="2" range="-0.05 0.05" stiffness="20"/>
<geom type="box" size="0.005 0.01 0.04" mass="0.1"/></body></worldbody>
<tendon><fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>
<equality><joint joint1="left" joint2="right" polycoef="0 1 0 0 0"/></equality>
<actuator><general name="fingers" tendon="split" gainprm="60" biasprm="0 -60 -2" biastype="affine"
ctrlrange="-0.04 0.04" ctrllimited="true"/></actuator></mujoco>"""
LEG = """<mujoco model="leg"><compiler angle="degree"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom condim="3" friction="0.9 0.1 0.1"/><joint armature="0.01" damping="0.3"/>
<motor ctrllimited="true" ctrlrange="-1 1"/></default><worldbody><geom name="floor" type="plane" size="5 5 0.1"/>
<body name="torso" pos="0 0 0.62"><joint name="height" type="slide" axis="0 0 1" armature="0" damping="0.5"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.05"/>
<body name="thigh"><joint name="hip" axis="0 1 0" range="-60 60"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
<body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" range="-120 10" stiffness="8" springref="-20"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.28" size="0.025"/><geom name="foot" type="sphere" pos="0 0 -0.28" size="0.04"/>
</body></body></body></worldbody>
<actuator><motor name="hip" joint="hip" gear="12"/><motor name="knee" joint="knee" gear="12"/></actuator></mujoco>"""


def chain(n: int) -> str:
    """An arm of up to six joints with position servos."""
    axes, masses = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1"), (2, 1.5, 1, 0.6, 0.4, 0.2)
    lengths, kp, kv = (0.12, 0.25, 0.22, 0.1, 0.08, 0.05), (120, 160, 100, 30, 20, 8), (8, 12, 7, 2, 1, 0.4)
    body, drives = "", ""
    for k in range(n):
        body += (
            f'<body pos="0 0 {lengths[k - 1] if k else 0}"><joint name="j{k + 1}" axis="{axes[k]}" damping="{0.4 * 0.7**k:.3f}" '
            f'armature="{0.05 * 0.7**k:.4f}"/><geom type="capsule" size="0.03" fromto="0 0 0 0 0.02 {lengths[k]}" mass="{masses[k]}"/>'
        )
        drives += f'<position name="a{k + 1}" joint="j{k + 1}" kp="{kp[k]}" kv="{kv[k]}"/>'
    head = '<option timestep="0.004" integrator="implicitfast"/><default><geom contype="0" conaffinity="0"/></default>'
    return f"<mujoco>{head}<worldbody>{body}{n * '</body>'}</worldbody><actuator>{drives}</actuator></mujoco>"


@dataclass(frozen=True)
class Case:
    """A model and what acts in the real one."""

    model: str
    amplitude: tuple[float, ...]
    right: tuple[tuple[str, str], ...] = ()
    outputs: tuple[str, ...] | None = ("shoulder.pos", "elbow.pos")
    dt: float = 0.01
    numbers: tuple[tuple[str, str, float], ...] = ()  #: (field of a model, element, value)
    real: str | None = None  #: another model
    late: int = 0  #: steps of the model
    play: tuple[int, float] | None = None  #: input, width
    offset: tuple[int, float] | None = None  #: output, size
    stribeck: tuple[str, float, float, float] | None = None  #: joint, level, level at rest, speed
    spread: float = 0.2  #: of the initial positions


def parameter(element: str, quantity: str, law: str = "", port: str = "") -> tuple[tuple[str, str], ...]:
    """A parameter, or the law that it is."""
    return (("parameter_error", f"{element}.{quantity}"), *([(law, port or element)] if law else []))


def friction(joint: str, port: str = "") -> tuple[tuple[str, str], ...]:
    return parameter(joint, "frictionloss", "coulomb_friction", port)


SIX, TARGETS = tuple(f"j{k}.pos" for k in range(1, 7)), (0.6, 0.4, 0.5, 0.6, 0.6, 0.8)
FINGERS, JOINTS_OF_LEG = ("left.pos", "right.pos"), ("height.pos", "hip.pos", "knee.pos")
LOADED = ARM.replace('mass="0.7"/>', 'mass="0.7"/><geom type="sphere" size="0.02" pos="0 0 -0.3" mass="0.2"/>')
GRIP: dict[str, Any] = {"outputs": FINGERS, "spread": 0.0}
WALK: dict[str, Any] = {"outputs": JOINTS_OF_LEG, "spread": 0.0}
CASES = {
    "cart_none": Case(CART_SERVO, (0.4,), outputs=None),
    "cart_pole_friction": Case(CART_SERVO, (0.4,), friction("hinge"), None, numbers=(("dof_frictionloss", "hinge", 0.012),)),
    "cart_rail_friction": Case(CART_MOTOR, (0.8,), friction("slider"), None, numbers=(("dof_frictionloss", "slider", 0.8),)),
    "cart_delay": Case(CART_MOTOR, (0.8,), (("input_delay", "drive"),), None, late=6),
    "cart_gear": Case(CART_MOTOR, (0.8,), parameter("drive", "gear", "input_gain"), None, numbers=(("actuator_gear", "drive", 8.5),)),
    "stops_none": Case(CART_STOPS, (0.5,), outputs=None, dt=0.02),
    "stops_friction": Case(CART_STOPS, (0.5,), friction("hinge"), None, 0.02, numbers=(("dof_frictionloss", "hinge", 0.012),)),
    "stops_gear": Case(CART_STOPS, (0.5,), parameter("drive", "gear", "input_gain"), None, 0.02, numbers=(("actuator_gear", "drive", 8.5),)),
    "arm_payload": Case(ARM, (3.0, 1.5), parameter("lower", "load"), real=LOADED),
    "arm_stribeck": Case(ARM, (3.0, 1.5), (("stribeck_friction", "elbow.force"),), stribeck=("elbow", 0.1, 0.22, 0.4)),
    "arm_armature": Case(ARM, (3.0, 1.5), parameter("elbow", "armature"), numbers=(("dof_armature", "elbow", 0.02),)),
    "arm_offset": Case(ARM, (3.0, 1.5), (("sensor_bias", "shoulder.pos"),), offset=(0, 0.05)),
    "passive_damping": Case(PASSIVE, (3.0,), parameter("elbow", "damping", "linear_loss"), numbers=(("dof_damping", "elbow", 0.16),)),
    "passive_friction": Case(PASSIVE, (3.0,), friction("elbow"), numbers=(("dof_frictionloss", "elbow", 0.08),)),
    "grip_none": Case(GRIPPER, (0.035,), **GRIP),
    "grip_friction": Case(GRIPPER, (0.035,), friction("left"), numbers=(("dof_frictionloss", "left", 0.25),), **GRIP),
    "grip_damping": Case(GRIPPER, (0.035,), parameter("right", "damping", "linear_loss"), numbers=(("dof_damping", "right", 4.0),), **GRIP),
    "leg_none": Case(LEG, (0.6, 0.6), **WALK),
    "leg_gear": Case(LEG, (0.6, 0.6), parameter("knee", "gear", "input_gain"), numbers=(("actuator_gear", "knee", 10.0),), **WALK),
    "leg_friction": Case(LEG, (0.6, 0.6), friction("knee", "knee.force"), numbers=(("dof_frictionloss", "knee", 0.6),), **WALK),
    "three_backlash": Case(chain(3), TARGETS[:3], (("input_backlash", "a2"),), SIX[:3], 0.02, play=(1, 0.06)),
    "six_armature": Case(chain(6), TARGETS, parameter("j3", "armature"), SIX, 0.02, numbers=(("dof_armature", "j3", 0.25),)),
    "arm_friction_payload": Case(
        ARM, (3.0, 1.5), parameter("lower", "load") + friction("shoulder", "shoulder.force"), real=LOADED,
        numbers=(("dof_frictionloss", "shoulder", 0.15),),
    ),
    "arm_friction_both": Case(
        ARM, (3.0, 1.5), friction("shoulder", "shoulder.force") + friction("elbow", "elbow.force"),
        numbers=(("dof_frictionloss", "shoulder", 0.15), ("dof_frictionloss", "elbow", 0.08)),
    ),
    "cart_gear_friction": Case(
        CART_MOTOR, (0.8,), parameter("drive", "gear", "input_gain") + friction("slider"), None,
        numbers=(("actuator_gear", "drive", 9.0), ("dof_frictionloss", "slider", 0.5)),
    ),
    "six_friction": Case(chain(6), TARGETS, friction("j2"), SIX, 0.02, numbers=(("dof_frictionloss", "j2", 3.0),)),
}  # fmt: skip


def march(case: Case, U: np.ndarray, X0: np.ndarray) -> np.ndarray:
    """Outputs (n_runs, n_samples, n_outputs) of the real one."""
    model = mujoco.MjModel.from_xml_string(case.real or case.model)
    for field, name, value in case.numbers:
        values = getattr(model, field)
        if field.startswith("dof"):
            values[model.jnt_dofadr[model.joint(name).id]] = value
        else:
            values[model.actuator(name).id, 0] = value
    mujoco.mj_setConst(model, mujoco.MjData(model))
    joints = [name.removesuffix(".pos") for name in case.outputs or ()]
    places = [model.jnt_qposadr[model.joint(name).id] for name in joints] or model.jnt_qposadr[model.sensor_objid]
    ratio, Y = round(case.dt / model.opt.timestep), np.empty((*U.shape[:2], len(places)))
    for run, start, out in zip(U, X0, Y):
        held, data = np.repeat(run, ratio, axis=0), mujoco.MjData(model)
        held = np.concatenate([np.repeat(held[:1], case.late, axis=0), held])
        if case.play is not None:
            j, width = case.play
            at = held[0, j]
            for k, value in enumerate(held[:, j]):
                held[k, j] = at = min(max(at, value - width / 2), value + width / 2)
        data.qpos[:], data.qvel[:] = start[: model.nq], start[model.nq :]
        for k in range(len(run)):
            out[k] = data.qpos[places]
            for control in held[k * ratio : (k + 1) * ratio]:
                data.ctrl[:] = control
                if case.stribeck is not None:
                    joint, level, rest, speed = case.stribeck
                    dof = model.jnt_dofadr[model.joint(joint).id]
                    v = data.qvel[dof]
                    data.qfrc_applied[dof] = -(level + (rest - level) * np.exp(-((v / speed) ** 2))) * np.tanh(v / 0.01)
                mujoco.mj_step(model, data)
    if case.offset is not None:
        Y[:, :, case.offset[0]] += case.offset[1]
    return Y


def inputs(case: Case, rng: np.random.Generator) -> np.ndarray:
    """Steps; sums of sines for backlash: (n_runs, n_samples, n_inputs)."""
    n, few = len(case.amplitude), case.outputs in (FINGERS, JOINTS_OF_LEG) or case.dt > 0.01
    n_runs, n_samples, hold = 5 if case.dt > 0.01 else 6, 120 if few else 150, 15 if few else 20
    if case.play is None:
        return (
            np.repeat(rng.uniform(-1, 1, (n_runs, n_samples // hold + 1, n)), hold, axis=1)[:, :n_samples]
            * case.amplitude
        )
    t, f = case.dt * np.arange(n_samples)[None, :, None, None], rng.uniform(0.3, 2.5, (n_runs, 1, n, 3))
    return np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28, f.shape)).sum(axis=3) / 2 * case.amplitude


def ask(name: str, seed: int) -> str:
    """A row of the table."""
    case, rng = CASES[name], np.random.default_rng([seed, len(name)])
    U = inputs(case, rng)
    arguments: dict[str, Any] = {"outputs": None if case.outputs is None else list(case.outputs), "dt": case.dt}
    simulator = MuJoCoSimulator(case.model, **arguments)
    half = len(simulator.states) // 2
    X0 = np.tile(simulator.x0, (len(U), 1))
    X0[:, :half] += case.spread * rng.normal(size=(len(U), half))
    real = march(case, U, X0)
    noise = NOISE * real.std(axis=(0, 1))
    y, n = real + noise * rng.normal(size=real.shape), len(U) - UNSEEN

    def error(other: Any) -> str:
        """Over the noise, on unseen runs."""
        runs = [other.simulate(u, x0=x) for u, x in zip(U[n:], X0[n:])]
        return f"{np.sqrt(np.mean(((runs - real[n:]) / noise) ** 2)):.2f}"

    began, groups = time.process_time(), np.repeat(np.arange(n), U.shape[1])
    diagnoser = GapDiagnoser(simulator, n_jobs=1, random_state=0)
    diagnoser.fit(np.concatenate(U[:n]), np.concatenate(y[:n]), groups=groups)
    seconds, report = time.process_time() - began, diagnoser.report_
    found = [{(e.name, e.location), *((o[0], o[1]) for o in e.equivalents)} for e in report.effects]
    named = report.verdict in ("explained", "partial") and bool(found) and all(one & set(case.right) for one in found)
    right = named if case.right else report.verdict == "none"
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        save_augmented(diagnoser.augmented_, Path(folder) / "model.xml")
        written = error(MuJoCoSimulator(Path(folder) / "model.xml", **arguments))
    effects = ", ".join(f"{e.name} at {e.location}" for e in report.effects)
    whole = "" if not said else " (says what it lacks)"
    parts = (
        name,
        f"{report.verdict} {effects}",
        "yes" if right else "**no**",
        error(simulator),
        error(diagnoser.augmented_),
    )
    return f"| {' | '.join(parts)} | {written}{whole} | {seconds:.0f} |"


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print(
        "| case | answer | right | model | with its effects | as written | seconds |\n| --- | --- | --- | --- | --- | --- | --- |"
    )
    for one in given.cases:
        try:
            print(ask(one, given.seed), flush=True)
        except SurrogateError as fault:
            print(f"| {one} | {type(fault).__name__}: {fault} | **no** | | | | |", flush=True)
