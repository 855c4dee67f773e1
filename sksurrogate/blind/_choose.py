"""How a case is composed: experiments, the effect and its place, the size that makes a given gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.blind._excite import EXCITATIONS, Controller, coloured, initial_states, inputs
from sksurrogate.blind._inexact import INEXACT
from sksurrogate.blind._laws import GROUPS, family
from sksurrogate.blind._march import Course, march
from sksurrogate.blind._plants import PlantSpec
from sksurrogate.blind._truths import KINDS, NOVEL, Kind, Scene, Truth

#: Effects of a shape of their own: without them and their twins nothing left in the catalogue draws it.
DISTINCT = [
    "coulomb_friction",
    "asymmetric_friction",
    "stribeck_friction",
    "end_stop",
    "state_saturation",
    "input_dead_zone",
    "input_saturation",
    "input_backlash",
    "hysteresis",
    "hidden_mode",
    "hidden_relaxation",
    "periodic_disturbance",
    "step_disturbance",
    "input_quantization",
    "sensor_quantization",
    "sensor_saturation",
    "sensor_rectification",
    "input_delay",
    "sensor_delay",
    "rate_limit",
    "gravity_tilt",
    "cubic_stiffness",
    "input_curve",
]
REGIONAL = [name for name, kind in KINDS.items() if "region" in kind.marks]
TIMED = [name for name, kind in KINDS.items() if "time" in kind.marks]
#: Effects that may begin at some time, or end: a constant that begins is a step disturbance, and has a name of its own.
STARTING = [
    name
    for name, kind in KINDS.items()
    if name not in ("constant_bias", "periodic_disturbance", "sensor_rectification", "parameter_drift", *TIMED)
    and kind.place not in ("port", "element")
]
#: Shares of a run within which they begin.
ONSETS = (0.25, 0.75)
#: Effects that make a response late: several of them are not distinguished.
LATE = {"input_delay", "input_lag", "sensor_delay", "sensor_lag", "rate_limit"}
#: How often each place is drawn.
PLACES = {"balance": 0.32, "input": 0.24, "sensor": 0.18, "parameter": 0.1, "hidden": 0.1, "limit": 0.06}
#: Largest multiplier of the sizes tried.
LARGEST_MULTIPLIER = 6.0


@dataclass
class Setting:
    """Everything but the effect."""

    plant: PlantSpec
    outputs: tuple[str, ...]
    excitation: str
    U: np.ndarray
    X0: np.ndarray
    noise: float
    nominal: Course
    scale: np.ndarray
    controller: Controller | None = None
    repeats: bool = False
    force: tuple[str, np.ndarray] | None = None

    @property
    def read(self) -> list[int]:
        """Positions of the measured outputs."""
        return [self.plant.outputs.index(name) for name in self.outputs]


def fine(truths: Sequence[Truth]) -> int:
    """Steps in a sample: more where there are kinks."""
    return 24 if truths else 8


def make_setting(rng: np.random.Generator, plant: PlantSpec, runs: Any, arm: str) -> Setting | None:
    """Experiments and sensors."""
    partial = len(plant.partial) < len(plant.outputs) and rng.random() < 0.4
    outputs = plant.partial if partial else plant.outputs
    noise = float(rng.choice([0.01, 0.02] if arm == "law" else [0.005, 0.01, 0.02]))
    if runs is not None:
        shortest = min(len(run) for run in runs)
        excitation, repeats = "recorded", False
        U = np.stack([np.asarray(run, dtype=float)[:shortest] for run in runs])
    else:
        excitation = str(rng.choice(list(EXCITATIONS), p=list(EXCITATIONS.values())))
        n_runs = int(rng.choice([1, 2, 4, 6, 8], p=[0.1, 0.15, 0.3, 0.35, 0.1]))
        n_samples = {1: 1000, 2: 600, 4: 400, 6: 300, 8: 200}[n_runs]
        U = inputs(rng, plant, excitation, n_runs, n_samples)
        repeats = n_runs >= 4 and rng.random() < 0.25
    X0 = initial_states(rng, plant, len(U))
    if repeats:
        U, X0 = np.repeat(U[::2], 2, axis=0)[: len(U)], np.repeat(X0[::2], 2, axis=0)[: len(U)]
    nominal = march(plant, U, X0, substeps=8)
    if not (np.isfinite(nominal.outputs).all() and plant.holds(nominal.states)):
        return None
    scale = nominal.outputs.reshape(-1, len(plant.outputs)).std(axis=0)
    if np.any(scale <= 1e-9 * np.abs(nominal.outputs).max()):
        return None
    setting = Setting(plant, outputs, excitation, U, X0, noise, nominal, scale, repeats=repeats)
    if excitation == "closed_loop":
        setting.controller = _controller(rng, setting)
    return setting


def _controller(rng: np.random.Generator, setting: Setting) -> Controller:
    """A proportional controller with the plant's sign."""
    y, u = setting.nominal.outputs[..., 0], setting.U[..., 0]
    sign = np.sign(np.sum((y - y.mean()) * (u - u.mean()))) or 1.0
    gain = float(sign * rng.uniform(0.2, 0.6) * u.std() / y.std())
    noise = setting.noise * setting.scale[0] * rng.normal(size=y.shape)
    return Controller(setting.plant.drives[0], setting.U.copy(), float(y.mean()), gain, noise)


Chosen = tuple[str, str, str | None, Kind, Scene]


def choose(rng: np.random.Generator, arm: str, setting: Setting) -> list[Chosen] | None:
    """Names, places and variables of the effects of a case; None where the plant does not allow them."""
    if arm in ("none", "disturbed", "coloured", "spikes", "tails", "trends"):
        return []
    if arm == "two":
        pair = [_one(rng, _any_name(rng), setting) for _ in range(2)]
        if pair[0] is None or pair[1] is None:
            return None
        names, places = {pair[0][0], pair[1][0]}, [one[3].place for one in pair if one is not None]
        if len(names) == 1 or names <= LATE or (places[0] == places[1] and places[0] in ("input", "sensor")):
            return None
        return [pair[0], pair[1]]
    if arm == "outside":
        name = str(rng.choice(DISTINCT))
    elif arm == "outside_disturbed":
        name = str(rng.choice([*DISTINCT, *NOVEL]))
    elif arm == "novel":
        name = str(rng.choice(list(NOVEL)))
    elif arm == "law":
        groups, shares = zip(*GROUPS)
        name = str(rng.choice(list(groups[int(rng.choice(len(groups), p=shares))])))
    elif arm == "inexact":
        name = str(rng.choice(list(INEXACT)))
    elif arm == "three":
        return several(rng, setting, 3)
    elif arm == "region":
        name = str(rng.choice(REGIONAL))
    elif arm == "time":
        name = str(rng.choice(TIMED))
    elif arm == "onset":
        one = _one(rng, str(rng.choice(STARTING)), setting)
        return None if one is None else [_later(one, one[4].duration * float(rng.uniform(*ONSETS)))]
    elif arm == "unexcited":
        name = str(rng.choice([*REGIONAL, "rate_limit"]))
    else:
        name = _any_name(rng)
        if arm in ("detuned", "far") and KINDS[name].place == "parameter":
            return None
    one = _one(rng, name, setting)
    return None if one is None else [one]


def _later(one: Chosen, moment: float) -> Chosen:
    """The same effect from a moment on; a parameter error until then, for one that begins is a step, and has a name of its own."""
    name, location, variable, kind, scene = one
    edge = "end" if kind.place == "parameter" else "onset"
    return name, location, variable, replace(kind, size=lambda m, s: {**kind.size(m, s), edge: moment}), scene


def several(rng: np.random.Generator, setting: Setting, count: int) -> list[Chosen] | None:
    """Effects of different names, no two that may twist one signal alike; None where the plant does not allow them."""
    found = [_one(rng, _any_name(rng), setting) for _ in range(count)]
    chosen = [one for one in found if one is not None]
    names, places = {one[0] for one in chosen}, [(one[3].place, one[1]) for one in chosen]
    late = [one for one in chosen if one[0] in LATE]
    doubled = [place for place in places if places.count(place) > 1 and place[0] in ("input", "sensor", "parameter")]
    return chosen if len(names) == count and len(late) < 2 and not doubled else None


def _any_name(rng: np.random.Generator) -> str:
    """A name, places weighted."""
    place = str(rng.choice(list(PLACES), p=list(PLACES.values())))
    return str(rng.choice([name for name, kind in KINDS.items() if kind.place == place]))


def _one(rng: np.random.Generator, name: str, setting: Setting) -> Chosen | None:
    """Where an effect sits and what drives it."""
    plant, kind = setting.plant, family(name)
    if (kind.needs == "positive" and not plant.positive) or (kind.needs == "warm" and not plant.warm):
        return None
    places: Sequence[str] = {
        "parameter": tuple(plant.params),
        "input": plant.inputs,
        "sensor": setting.outputs,
    }.get(kind.place, plant.balances)
    location = str(rng.choice(list(places)))
    found, variable = _variable(rng, kind, location, setting)
    if not found:
        return None
    x = _signal(setting, location, kind.place)
    v, w = x, np.ones_like(x)
    if variable is not None:
        first, *second = variable.split("*")
        v = _signal(setting, first, kind.place)
        w = _signal(setting, second[0], kind.place) if second else w
    crossing = v.size > 0 and 0.1 < float(np.mean(v > 0)) < 0.9
    if kind.needs in ("speed", "crossing") and not crossing:
        return None
    rate = 0.0
    if location in plant.states and kind.place in ("balance", "hidden", "limit"):
        path = setting.nominal.states[..., plant.states.index(location)]
        rate = float(np.mean(np.abs(np.diff(path, axis=1)))) / plant.dt
    scene = Scene(x, v, w, rate + 1e-12, plant.dt, setting.U.shape[1] * plant.dt, rng.random(4))
    return name, location, variable, kind, scene


def _variable(rng: np.random.Generator, kind: Kind, location: str, setting: Setting) -> tuple[bool, str | None]:
    """Whether there is a variable of the kind wanted, and its name."""
    plant = setting.plant
    choices: list[str]
    if kind.variable == "":
        return True, None
    if kind.variable == "speed":
        choices = [location]
    elif kind.variable == "position":
        choices = [q for q, v in plant.kinematic.items() if v == location] or [location]
    elif kind.variable == "angle":
        choices = [name for name in plant.states if name not in plant.kinematic.values()]
    elif kind.variable in ("state", "gate"):
        choices = list(plant.states)
        if kind.variable == "gate":
            choices = [f"{a}*{b}" for a in plant.states for b in plant.inputs]
    elif kind.variable == "signal":
        choices = [*plant.states, *plant.inputs]
    elif kind.variable == "product":
        choices = ["*".join(sorted((a, b))) for a in plant.states for b in plant.inputs]
    else:
        everything = {"other": plant.states, "input": plant.inputs, "output": setting.outputs}[kind.variable]
        choices = [name for name in everything if name != location]
    return (True, str(rng.choice(choices))) if choices else (False, None)


def _signal(setting: Setting, name: str, place: str) -> np.ndarray:
    """Samples of a signal in the nominal runs, runs pooled."""
    plant = setting.plant
    if place == "parameter" and name in plant.params:
        return np.zeros(1)
    if place == "sensor":
        return setting.nominal.outputs[..., plant.outputs.index(name)].ravel()
    if name in plant.inputs:
        return setting.U[..., plant.inputs.index(name)].ravel()
    return setting.nominal.states[..., plant.states.index(name)].ravel()


def as_truth(name: str, location: str, variable: str | None, kind: Kind, scene: Scene, m: Any) -> Truth:
    """An effect at a size; m = 0: limits just out of reach, others absent."""
    width = 3e-3 * scene.spread()
    if np.isscalar(m) and m == 0.0:
        beyond = 0.05 + 0.25 * scene.dice[1]
        if name == "rate_limit":
            params: dict[str, Any] = {"limit": (1 + beyond) * 2.0 * float(np.ptp(scene.x)) / scene.dt}
        elif name == "end_stop":
            edge = float(np.max(scene.v) + beyond * np.ptp(scene.v))
            params = {"stiffness": scene.rate / scene.spread(), "edge": edge}
        else:
            reached = np.abs(scene.x) if name == "input_saturation" else scene.x
            params = {**kind.size(1.0, scene), "limit": float(np.max(reached) + beyond * np.ptp(scene.x))}
        return Truth(name, location, variable, params, width)
    return Truth(name, location, variable, kind.size(m, scene), width)


def sized(setting: Setting, name: str, location: str, variable: str | None, kind: Kind, scene: Scene,
           target: float, least: float, variant: str = "") -> Truth | None:  # fmt: skip
    """The effect (or a variant of it) at the size that makes the gap ``target`` times the noise."""
    few = min(2, len(setting.U))

    def gaps(sizes: np.ndarray) -> np.ndarray:
        m = np.repeat(sizes, few)
        truth = replace(as_truth(name, location, variable, kind, scene, m), variant=variant)
        params = {k: np.broadcast_to(np.asarray(value, dtype=float), m.shape) for k, value in truth.params.items()}
        return _gaps(setting, replace(truth, params=params), len(sizes), few)

    if not kind.size(1.0, scene):
        return as_truth(name, location, variable, kind, scene, 1.0) if gaps(np.ones(1))[0] >= least else None
    sizes = np.geomspace(1e-3, LARGEST_MULTIPLIER, 15)
    for _ in range(2):
        found = gaps(sizes)
        reached = np.flatnonzero(found >= target)
        if not reached.size:
            best = int(np.argmax(np.where(np.isfinite(found), found, -1.0)))
            if not found[best] >= max(least, 0.5 * target):
                return None
            sizes = sizes[[best]]
            break
        upper = int(reached[0])
        if upper == 0:
            return None
        sizes = np.geomspace(sizes[upper - 1], sizes[upper], 6)
    m = float(sizes[-1] if len(sizes) == 1 else sizes[int(np.argmin(np.abs(gaps(sizes) - target)))])
    truth = as_truth(name, location, variable, kind, scene, m)
    return replace(truth, variant=variant, params={key: float(value) for key, value in truth.params.items()})


def _gaps(setting: Setting, truth: Truth, times: int, few: int) -> np.ndarray:
    """Gap over noise for several sizes, runs at once; inf where the plant diverges."""
    U, X0 = np.tile(setting.U[:few], (times, 1, 1)), np.tile(setting.X0[:few], (times, 1))
    policy = setting.controller.tiled(times, few) if setting.controller else None
    course = march(setting.plant, U, X0, [truth], policy=policy, substeps=6)
    nominal = setting.nominal.outputs[:few]
    if policy is not None:
        nominal = march(setting.plant, course.inputs, X0, substeps=6).outputs
    else:
        nominal = np.tile(nominal, (times, 1, 1))
    with np.errstate(all="ignore"):
        error = ((course.outputs - nominal) / (setting.noise * setting.scale))[..., setting.read]
        gap = np.sqrt(np.mean(error.reshape(times, -1) ** 2, axis=1))
        wild = np.abs(course.outputs).reshape(times, -1).max(axis=1) > 20 * np.abs(nominal).max() + 1.0
    return np.where(np.isfinite(gap) & ~wild, gap, np.inf)


def disturbance(rng: np.random.Generator, setting: Setting, level: float) -> tuple[str, np.ndarray]:
    """A coloured force on one balance that moves the outputs by ``level`` of their standard deviation."""
    plant = setting.plant
    state = str(rng.choice(list(plant.balances)))
    size = setting.nominal.states[..., plant.states.index(state)].std() / plant.dt
    force = 1e-4 * size * coloured(rng, setting.U.shape[:2], float(rng.uniform(5, 20)))
    course = march(plant, setting.U, setting.X0, force=(state, force), substeps=6)
    moved = ((course.outputs - setting.nominal.outputs) / setting.scale)[..., setting.read]
    return state, force * level / (float(np.sqrt(np.mean(moved**2))) + 1e-12)
