"""What does a point of a MuJoCo model cost: forward dynamics, a sample, parameters that differ; peers mj_forward, mj_step and its batched rollout.

Medians of the ratios of a round, processor time. Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_mujoco.py``
"""

import time

import mujoco
import numpy as np

from sksurrogate.physics import MuJoCoSimulator

ROUNDS = 9


def chain(n_joints, friction=0.0):
    """A hanging chain of bars with a motor at every joint."""
    bodies, motors = "", ""
    for k in reversed(range(n_joints)):
        place = "0 0 -0.3" if k else "0 0 0"
        axis = "0 1 0" if k % 2 == 0 else "1 0 0"
        bodies = (
            f'<body name="bar{k}" pos="{place}"><joint name="j{k}" axis="{axis}" damping="0.1" frictionloss="{friction}"/>'
            f'<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1" contype="0" conaffinity="0"/>{bodies}</body>'
        )
        motors = f'<motor name="m{k}" joint="j{k}"/>{motors}'
    return f"<mujoco><worldbody>{bodies}</worldbody><actuator>{motors}</actuator></mujoco>"


BOX = """<mujoco><worldbody><geom type="plane" size="2 2 0.1"/><body pos="0 0 0.1"><freejoint/>
<geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody></mujoco>"""


def own_forward(model, x, u):
    """Accelerations by mj_forward, point by point."""
    data = mujoco.MjData(model)
    out = np.empty((model.nv, x.shape[1]))
    for k in range(x.shape[1]):
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[: model.nq, k], x[model.nq :, k], u[:, k]
        mujoco.mj_forward(model, data)
        out[:, k] = data.qacc
    return out


def own_steps(model, x, u, n_steps):
    """States after some steps by mj_step, point by point."""
    data = mujoco.MjData(model)
    out = np.empty_like(x)
    for k in range(x.shape[1]):
        data.qacc_warmstart[:] = 0.0
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[: model.nq, k], x[model.nq :, k], u[:, k]
        mujoco.mj_step(model, data, n_steps)
        out[: model.nq, k], out[model.nq :, k] = data.qpos, data.qvel
    return out


def microseconds(function, n_points):
    start = time.process_time()
    function()
    return (time.process_time() - start) / n_points * 1e6


def asked_of(text, n_points):
    """What is timed for a model, by name."""
    simulator = MuJoCoSimulator(text)
    model, own, five = mujoco.MjModel.from_xml_string(text), simulator.params, 5 * simulator.timestep
    rng = np.random.default_rng(0)
    x = simulator.x0[:, None] + 0.01 * rng.normal(size=(len(simulator.states), n_points))
    u = rng.normal(size=(len(simulator.inputs), n_points))
    few, many = 0.1 + 0.01 * (np.arange(n_points) % 10), 0.1 + 1e-4 * np.arange(n_points)
    varied = next(iter(own))
    return {
        "forward": lambda: own_forward(model, x, u),
        "rhs": lambda: simulator.rhs(0.0, x, u, own),
        "steps": lambda: own_steps(model, x, u, 5),
        "step": lambda: simulator.step(0.0, x, u, own, five),
        "few": lambda: simulator.step(0.0, x, u, {varied: few}, five),
        "many": lambda: simulator.step(0.0, x, u, {varied: many}, five),
    }


def beside_the_rollout(name, text, n_points=8000):
    """Forward dynamics and samples by equations of motion, and the same points by MuJoCo's batched rollout."""
    simulator = MuJoCoSimulator(text)
    engine, rng = simulator._engine(), np.random.default_rng(0)
    x = rng.normal(size=(len(simulator.states), n_points))
    u = rng.normal(size=(len(simulator.inputs), n_points))
    taken = []
    for _ in range(ROUNDS):
        for equations in (False, True):
            engine.__dict__.pop("_equations", None) if equations else engine.__dict__.update(_equations=None)
            simulator.rhs(0.0, x, u, {})
            taken.append(microseconds(lambda: simulator.rhs(0.0, x, u, {}), n_points))
            taken.append(microseconds(lambda: simulator.step(0.0, x, u, {}, 5 * simulator.timestep), n_points))
    rates, samples, own_rates, own_samples = np.reshape(taken, (ROUNDS, 4)).T
    print(
        f"| {name} | {np.median(rates):.2f} | {np.median(rates / own_rates):.1f} | {np.median(samples):.1f} "
        f"| {np.median(samples / own_samples):.1f} |"
    )


def main():
    n_points = 2000
    print(
        "| model | mj_forward loop, us | / rhs | mj_step loop, 5 steps, us | / step | 10 sets / 1 set | 2000 sets / 1 set |"
    )
    print("|---|---|---|---|---|---|---|")
    texts = {f"{n} joints": chain(n) for n in (1, 2, 6)}
    texts |= {"6 joints, dry friction": chain(6, 0.1), "a box on the floor": BOX}
    for name, text in texts.items():
        asked = asked_of(text, n_points)
        for function in asked.values():
            function()
        taken = np.array([[microseconds(function, n_points) for function in asked.values()] for _ in range(ROUNDS)])
        forward, rhs, steps, step, few_sets, many_sets = taken.T
        ratios = [np.median(a / b) for a, b in ((forward, rhs), (steps, step), (few_sets, step), (many_sets, step))]
        print(
            f"| {name} | {np.median(forward):.1f} | {ratios[0]:.2f} | {np.median(steps):.1f} | {ratios[1]:.2f} "
            f"| {ratios[2]:.2f} | {ratios[3]:.2f} |"
        )
    print("\n| model | rollout, us | / equations | rollout, 5 steps, us | / equations |\n|---|---|---|---|---|")
    for n in (2, 3, 4, 6):
        beside_the_rollout(f"{n} joints", chain(n))
        beside_the_rollout(f"{n} joints, dry friction", chain(n, 0.1))


if __name__ == "__main__":
    main()
