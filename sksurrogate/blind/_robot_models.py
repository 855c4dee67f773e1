"""Robots drawn at random: chains of 2 to 6 joints as MJCF, with the inputs that move them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import require

#: How often each number of joints is drawn.
JOINTS = {2: 0.35, 3: 0.3, 4: 0.25, 6: 0.1}
NAMES = ("base", "shoulder", "elbow", "wrist", "pitch", "roll")
#: Timestep of the model and sample time of the record.
CLOCKS = ((0.005, 0.01), (0.004, 0.012), (0.002, 0.01))


@dataclass(frozen=True)
class RobotSpec:
    """A robot."""

    joints: tuple[str, ...]  #: From the base on; joint k has the actuator ``drive_<joint>``, its link ``link_<joint>``
    servo: bool  #: Position servos (inputs are targets) or motors (inputs are torques)
    gravity: bool
    timestep: float
    dt: float
    axes: tuple[str, ...]
    #: lengths, masses, damping, armature, kp, kv: one for each joint
    lengths: tuple[float, ...]
    masses: tuple[float, ...]
    damping: tuple[float, ...]
    armature: tuple[float, ...]
    kp: tuple[float, ...]
    kv: tuple[float, ...]
    amplitude: tuple[float, ...]  #: Of the inputs
    inertia: tuple[float, ...]  #: Of the arm about each joint, stretched out

    def mjcf(self, payload: float = 0.0) -> str:
        """The model; with a payload, a sphere of that mass at its tip."""
        body, close = "", ""
        for k, joint in enumerate(self.joints):
            at = f"0 0 {-self.lengths[k - 1]:.6g}" if k else "0 0 0"
            body += (
                f'<body name="link_{joint}" pos="{at}"><joint name="{joint}" axis="{self.axes[k]}" '
                f'damping="{self.damping[k]:.6g}" armature="{self.armature[k]:.6g}"/>'
                f'<geom type="capsule" size="0.02" fromto="0 0 0 0 0 {-self.lengths[k]:.6g}" mass="{self.masses[k]:.6g}" '
                'contype="0" conaffinity="0"/>'
            )
            close += "</body>"
        if payload:
            body += (
                f'<geom type="sphere" size="0.02" pos="0 0 {-self.lengths[-1]:.6g}" mass="{payload:.9g}" contype="0" '
                'conaffinity="0"/>'
            )
        drives = "".join(self._drive(k) for k in range(len(self.joints)))
        gravity = "0 0 -9.81" if self.gravity else "0 0 0"
        return (
            f'<mujoco><option timestep="{self.timestep}" gravity="{gravity}"/><worldbody>{body}{close}</worldbody>'
            f"<actuator>{drives}</actuator></mujoco>"
        )

    def _drive(self, k: int) -> str:
        """The actuator of joint k."""
        name = f'name="drive_{self.joints[k]}" joint="{self.joints[k]}"'
        return f'<position {name} kp="{self.kp[k]:.6g}" kv="{self.kv[k]:.6g}"/>' if self.servo else f"<motor {name}/>"


def draw_robot(rng: np.random.Generator) -> RobotSpec:
    """A robot that moves by about a radian in about a second."""
    mujoco = require("mujoco", "mujoco")
    n = int(rng.choice(list(JOINTS), p=list(JOINTS.values())))
    timestep, dt = CLOCKS[int(rng.integers(len(CLOCKS)))]
    lengths = rng.uniform(0.2, 0.45, n) * 0.85 ** np.arange(n)
    masses = rng.uniform(0.4, 1.5, n) * 0.7 ** np.arange(n)
    axes = ["0 1 0"] * n
    for k in range(1, n):
        axes[k] = str(rng.choice(["0 1 0", "1 0 0"], p=[0.7, 0.3]))
    armature = rng.uniform(0.002, 0.02, n)
    none = (0.0,) * n
    bare = RobotSpec(
        NAMES[:n], False, bool(rng.random() < 0.6), timestep, dt, tuple(axes), tuple(lengths), tuple(masses), none,
        tuple(armature), none, none, none, none,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(bare.mjcf())
    data, M = mujoco.MjData(model), np.zeros((n, n))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M) if _new(mujoco) else mujoco.mj_fullM(model, M, data.qM)
    inertia = np.diag(M).copy()
    servo = bool(rng.random() < 0.4)
    frequency = rng.uniform(6.0, 12.0, n)
    weight = [9.81 * float(np.sum(masses[k:])) * float(lengths[k]) for k in range(n)] if bare.gravity else np.zeros(n)
    torque = inertia * rng.uniform(6.0, 15.0, n) + 0.3 * np.array(weight)
    values = {
        "servo": servo, "damping": tuple(inertia * rng.uniform(0.7, 2.5, n)), "kp": tuple(inertia * frequency**2),
        "kv": tuple(1.2 * inertia * frequency), "amplitude": tuple(rng.uniform(0.4, 0.9, n) if servo else torque),
        "inertia": tuple(inertia),
    }  # fmt: skip
    return RobotSpec(**{**bare.__dict__, **values})


def _new(mujoco: Any) -> bool:
    """Whether ``mj_fullM`` takes the data itself, as newer versions do."""
    return tuple(int(part) for part in mujoco.__version__.split(".")[:2]) >= (3, 4)


def robot_inputs(rng: np.random.Generator, robot: RobotSpec, n_runs: int, n_samples: int) -> np.ndarray:
    """Steps or sums of sines on every actuator, (n_runs, n_samples, n_joints)."""
    n, size = len(robot.joints), np.array(robot.amplitude)
    if rng.random() < 0.6:
        hold = int(rng.integers(12, 35))
        levels = rng.uniform(-1, 1, (n_runs, n_samples // hold + 1, n))
        return size * np.repeat(levels, hold, axis=1)[:, :n_samples]
    t = robot.dt * np.arange(n_samples)[None, :, None, None]
    f = rng.uniform(0.3, 3.0, (n_runs, 1, n, 3))
    waves = np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi, f.shape))
    return size * waves.sum(axis=3) / 2.0
