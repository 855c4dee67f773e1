"""The effects that a plant can have and its simulator lacks: own equations, sizes, twins.

The names are the canonical ones; the equations are written here a second time, so that a diagnosis that names them is
not checked by its own arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import erf

Params = Mapping[str, Any]


@dataclass(frozen=True)
class Truth:
    """One effect of a plant."""

    name: str
    location: str
    variable: str | None
    params: Params  #: Magnitude first; while sizes are searched, arrays with one value a column
    width: float = 0.0  #: Width over which a sign is smoothed (units of the variable)
    variant: str = ""  #: Which inexact form of the effect acts; its own by default

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Name, location, variable."""
        return self.name, self.location, self.variable

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        params = {key: float(value) for key, value in self.params.items()}
        found = {"name": self.name, "location": self.location, "variable": self.variable, "params": params}
        return {**found, "variant": self.variant} if self.variant else found


@dataclass(frozen=True)
class Scene:
    """The nominal behaviour by which sizes are chosen, pooled over runs and samples."""

    x: np.ndarray  #: (n_points,): signal at the location: state, input or output; empty for a parameter
    v: np.ndarray  #: (n_points,): the variable, or the location's own signal
    w: np.ndarray  #: (n_points,): second factor of a variable ``v*w``, else ones
    rate: float  #: Typical size of the state's derivative
    dt: float
    duration: float
    dice: np.ndarray  #: (4,): uniform numbers that choose shapes

    @property
    def sign(self) -> float:
        """Plus or minus one."""
        return 1.0 if self.dice[3] < 0.5 else -1.0

    def spread(self) -> float:
        """Standard deviation of the variable."""
        return float(np.std(self.v)) + 1e-12

    def mean_step(self) -> float:
        """Typical change of the location's signal in a sample."""
        return float(np.sqrt(np.mean(np.diff(self.x) ** 2))) + 1e-12


Term = Callable[[Any, Any, Any, Any, Params, float], Any]
Size = Callable[[Any, Scene], dict[str, Any]]


@dataclass(frozen=True)
class Kind:
    """A family of effects."""

    place: str  #: {"parameter", "element", "balance", "port", "hidden", "limit", "input", "sensor"}
    size: Size  #: ``size(m, scene) -> params``: m = 0 is not an effect, m about 1 a clear one
    #: Names that can imitate it on some data; they leave the catalogue with it in the unknown arm
    twins: tuple[str, ...] = ()
    form: Term | None = None  #: The equation: ``form(t, x, v, w, params, width)``
    #: Which signals drive it: "", "state", "angle", "own", "speed", "other", "product", "input", "output", "signal"
    variable: str = ""
    needs: str = ""  #: What the plant must be: "", "positive", "warm", "speed"
    marks: tuple[str, ...] = field(default=())


def sign(v: Any, width: float) -> Any:
    """A sign with a smooth middle: the error function."""
    return erf(v / width)


def unit(form: Term, scene: Scene, params: Params) -> float:
    """Coefficient that makes a term as large as 0.3 of the state's typical derivative."""
    t = np.linspace(0.0, scene.duration, scene.v.size)
    values = form(t, scene.x, scene.v, scene.w, {**params, _first(params): 1.0}, 1e-2 * scene.spread())
    return 0.3 * scene.rate / (float(np.sqrt(np.mean(np.square(values)))) + 1e-12)


def _first(params: Params) -> str:
    return next(iter(params))


def term(form: Term, twins: str, variable: str = "", *, first: str = "coefficient", either: bool = False, needs: str = "",
         shape: Callable[[Scene], dict[str, Any]] | None = None, marks: str = "") -> Kind:  # fmt: skip
    """A term of a balance, sized by the derivative it adds."""

    def size(m: Any, scene: Scene) -> dict[str, Any]:
        params: dict[str, Any] = {first: 1.0, **(shape(scene) if shape else {})}
        return {**params, first: m * unit(form, scene, params) * (scene.sign if either else 1.0)}

    return Kind("balance", size, tuple(twins.split()), form, variable, needs, tuple(marks.split()))


def _asymmetric(m: Any, scene: Scene) -> dict[str, Any]:
    c = m * unit(lambda t, x, v, w, p, h: -sign(v, h), scene, {"level": 1.0})
    return {"level": c, "offset": c * scene.sign * (0.4 + 0.4 * scene.dice[0])}


def _stribeck(m: Any, scene: Scene) -> dict[str, Any]:
    c = m * unit(lambda t, x, v, w, p, h: -sign(v, h), scene, {"level": 1.0})
    return {
        "level": c,
        "static_level": c * (1.6 + scene.dice[0]),
        "velocity": scene.spread() * (0.25 + 0.3 * scene.dice[1]),
    }


def _lugre(m: Any, scene: Scene) -> dict[str, Any]:
    c = m * unit(lambda t, x, v, w, p, h: -sign(v, h), scene, {"level": 1.0})
    travel = scene.spread() * scene.dt * (1.0 + 3.0 * scene.dice[2])
    return {
        "stiffness": c / travel,
        "level": c,
        "static_level": c * (1.3 + 0.7 * scene.dice[0]),
        "velocity": scene.spread() * (0.2 + 0.3 * scene.dice[1]),
    }


def _hysteresis(m: Any, scene: Scene) -> dict[str, Any]:
    limit = scene.spread() * (0.2 + 0.4 * scene.dice[0])
    return {"stiffness": m * 0.3 * scene.rate / limit, "limit": limit}


def _relaxation(m: Any, scene: Scene) -> dict[str, Any]:
    return {
        "coefficient": m * 0.5 * scene.rate / scene.spread(),
        "time_constant": scene.dt * (8.0 + 20.0 * scene.dice[0]),
    }


#: Share of its value by which a parameter that depends on a signal changes at most: a resistance is not negative anywhere.
MOST_CHANGED = 0.9


def _dependence(m: Any, scene: Scene) -> dict[str, Any]:
    """The parameter has its nominal value where the signal has its mean, and keeps its sign along the signal."""
    mean = float(np.mean(scene.v))
    most = MOST_CHANGED / max(float(np.max(np.abs(scene.v - mean))), 1e-300)
    slope = scene.sign * np.minimum(0.25 * m / scene.spread(), most)
    return {"slope": slope, "relative_error": -slope * mean}


def _mode(m: Any, scene: Scene) -> dict[str, Any]:
    w = 1.0 / (scene.dt * (2.0 + 5.0 * scene.dice[0]))
    return {
        "gain": m * 0.5 * scene.rate / scene.spread(),
        "angular_frequency": w,
        "damping": 0.05 + 0.2 * scene.dice[1],
    }


def _quantile(values: np.ndarray, share: Any) -> Any:
    """Level that a share of the samples exceeds."""
    return np.quantile(values, np.clip(1.0 - np.asarray(share), 0.0, 1.0))


def _edge(scene: Scene) -> dict[str, Any]:
    return {"edge": float(np.quantile(scene.v, 0.75 + 0.15 * scene.dice[0]))}


def _moment(scene: Scene) -> dict[str, Any]:
    return {"time": float(scene.duration * (0.3 + 0.4 * scene.dice[0]))}


def _wave(scene: Scene) -> dict[str, Any]:
    period = scene.dt * np.exp(np.log(20.0) + scene.dice[0] * np.log(5.0))
    return {"angular_frequency": float(2 * np.pi / period), "phase": float(np.pi * (2 * scene.dice[1] - 1))}


def _stribeck_form(t: Any, x: Any, v: Any, w: Any, p: Params, h: float) -> Any:
    level = p["level"] + (p["static_level"] - p["level"]) * np.exp(-((v / p["velocity"]) ** 2))
    return -level * sign(v, h)


_DRY = "coulomb_friction asymmetric_friction stribeck_friction load_friction lugre_friction hysteresis input_dead_zone input_backlash power_law"
_SMOOTH = "parameter_dependence linear_loss quadratic_loss quadratic_drag cubic_stiffness power_law sqrt_leak parameter_error exchange gravity_tilt bilinear radiation"
_TIME = "drift step_disturbance periodic_disturbance parameter_step parameter_drift constant_bias sensor_drift sensor_bias input_bias"
_STOP = "end_stop state_saturation overflow sensor_saturation cubic_stiffness quadratic_loss power_law quadratic_drag"
_LATE = (
    "input_delay input_lag sensor_delay sensor_lag hidden_relaxation hidden_mode rate_limit input_backlash hysteresis"
)
_ACT = "parameter_dependence input_gain input_bias input_curve input_dead_zone input_saturation input_quantization parameter_error power_law constant_bias"

_BALANCE = {
    "constant_bias": term(lambda t, x, v, w, p, h: p["value"] + 0.0 * x, _TIME + " input_bias parameter_error parameter_drift",
                          first="value", either=True),
    "linear_loss": term(lambda t, x, v, w, p, h: -p["coefficient"] * v, _SMOOTH, "state", either=True),
    "quadratic_loss": term(lambda t, x, v, w, p, h: -p["coefficient"] * v * v, _SMOOTH, "state", either=True),
    "quadratic_drag": term(lambda t, x, v, w, p, h: -p["coefficient"] * v * np.abs(v), _SMOOTH + " " + _DRY, "speed"),
    "coulomb_friction": term(lambda t, x, v, w, p, h: -p["level"] * sign(v, h), _DRY, "speed", first="level", needs="speed"),
    "asymmetric_friction": Kind("balance", _asymmetric, tuple(_DRY.split()),
                                lambda t, x, v, w, p, h: -p["level"] * sign(v, h) - p["offset"], "speed", "speed"),
    "stribeck_friction": Kind("balance", _stribeck, tuple(_DRY.split()), _stribeck_form, "speed", "speed"),
    "cubic_stiffness": term(lambda t, x, v, w, p, h: -p["coefficient"] * v**3, _SMOOTH + " end_stop", "state"),
    "sqrt_leak": term(lambda t, x, v, w, p, h: -p["coefficient"] * np.sqrt(np.maximum(v, 0.0)), _SMOOTH, "state",
                      needs="positive"),
    "power_law": term(lambda t, x, v, w, p, h: -p["coefficient"] * np.maximum(v, 1e-12) ** p["exponent"] * w, _SMOOTH,
                      "state", needs="positive", shape=lambda s: {"exponent": float(1.35 + 0.5 * s.dice[0])}),
    "exchange": term(lambda t, x, v, w, p, h: p["coefficient"] * (v - x), _SMOOTH, "other", either=True),
    "radiation": term(lambda t, x, v, w, p, h: p["coefficient"] * (v**4 - x**4), _SMOOTH, "other", needs="warm"),
    "bilinear": term(lambda t, x, v, w, p, h: p["coefficient"] * v * w, _SMOOTH, "product", either=True),
    "gravity_tilt": term(lambda t, x, v, w, p, h: -p["level"] * np.sin(v), _SMOOTH, "angle", first="level"),
    "end_stop": term(lambda t, x, v, w, p, h: -p["stiffness"] * np.maximum(v - p["edge"], 0.0), _STOP, "state",
                     first="stiffness", shape=_edge, marks="region"),
    "drift": term(lambda t, x, v, w, p, h: p["rate"] * t + 0.0 * x, _TIME, first="rate", either=True),
    "periodic_disturbance": term(
        lambda t, x, v, w, p, h: p["amplitude"] * np.sin(p["angular_frequency"] * t + p["phase"]) + 0.0 * x,
        _TIME, first="amplitude", shape=_wave),
    "step_disturbance": term(lambda t, x, v, w, p, h: p["size"] * (t >= p["time"]) + 0.0 * x, _TIME, first="size",
                             either=True, shape=_moment, marks="time"),
}  # fmt: skip

#: Laws at an input, driven by a state; the arms of forces and robots draw them.
_PORT = {
    "load_friction": Kind(
        "port",
        lambda m, s: {"coefficient": 0.1 * m, "level": 0.1 * m * s.dice[0] * float(np.sqrt(np.mean(s.x**2)))},
        (*_DRY.split(), "input_gain"),
        lambda t, u, v, w, p, h: -(p["level"] + p["coefficient"] * np.abs(u)) * sign(v, h),
        "speed",
        "speed",
    ),
}
_HIDDEN = {
    "hysteresis": Kind("hidden", _hysteresis, tuple((_DRY + " hidden_relaxation").split()), variable="position"),
    "lugre_friction": Kind("hidden", _lugre, tuple(_DRY.split()), variable="speed", needs="speed"),
    "hidden_relaxation": Kind("hidden", _relaxation, tuple(_LATE.split()), variable="state"),
    "hidden_mode": Kind("hidden", _mode, tuple(_LATE.split()), variable="state"),
}
_LIMIT = {
    "state_saturation": Kind(
        "limit", lambda m, s: {"limit": _quantile(s.x, 0.12 * m)}, tuple(_STOP.split()), marks=("region",)
    ),
    "overflow": Kind(
        "limit",
        lambda m, s: {"limit": _quantile(s.x, 0.12 * m), "share": 0.3 + 0.6 * s.dice[0]},
        tuple(_STOP.split()),
        variable="other",
        needs="positive",
        marks=("region",),
    ),
}

_INPUT = {
    "input_gain": Kind("input", lambda m, s: {"relative_error": s.sign * 0.15 * m}, tuple(_ACT.split()),
                       lambda t, u, v, w, p, h: (1 + p["relative_error"]) * u),
    "input_bias": Kind("input", lambda m, s: {"value": s.sign * 0.15 * m * s.spread()}, tuple(_ACT.split()),
                       lambda t, u, v, w, p, h: u + p["value"]),
    "input_curve": Kind("input", lambda m, s: {"coefficient": s.sign * 0.1 * m / (np.sqrt(np.mean(s.x**2)) + 1e-12)},
                        (*_ACT.split(), "quadratic_loss", "quadratic_drag"),
                        lambda t, u, v, w, p, h: u + p["coefficient"] * u * np.abs(u)),
    "input_coupling": Kind("input", lambda m, s: {"coefficient": s.sign * 0.15 * m * np.std(s.x) / s.spread()},
                           (*_ACT.split(), "bilinear", "linear_loss", "input_coupling"),
                           lambda t, u, v, w, p, h: u + p["coefficient"] * v, "input"),
    "input_dead_zone": Kind("input", lambda m, s: {"half_width": 0.3 * m * s.spread()}, (*_ACT.split(), *_DRY.split()),
                            lambda t, u, v, w, p, h: np.sign(u) * np.maximum(np.abs(u) - p["half_width"], 0.0)),
    "input_backlash": Kind("input", lambda m, s: {"half_width": 0.3 * m * s.spread()}, (*_LATE.split(), *_DRY.split())),
    "input_saturation": Kind("input", lambda m, s: {"limit": _quantile(np.abs(s.x), 0.12 * m)},
                             (*_ACT.split(), "input_curve"),
                             lambda t, u, v, w, p, h: np.clip(u, -p["limit"], p["limit"]), marks=("region",)),
    "rate_limit": Kind("input", lambda m, s: {"limit": s.mean_step() / s.dt / (0.1 + 2.0 * m)}, tuple(_LATE.split())),
    "input_quantization": Kind("input", lambda m, s: {"step": 0.4 * m * s.spread()}, tuple(_ACT.split()),
                               lambda t, u, v, w, p, h: p["step"] * np.floor(u / p["step"] + 0.5)),
    "input_delay": Kind("input", lambda m, s: {"delay": 1.7 * m * s.dt}, tuple(_LATE.split())),
    "input_lag": Kind("input", lambda m, s: {"time_constant": 2.0 * m * s.dt}, tuple(_LATE.split())),
}  # fmt: skip

_READ = "parameter_dependence sensor_gain sensor_bias sensor_nonlinearity sensor_coupling sensor_drift sensor_saturation sensor_quantization sensor_rectification parameter_error constant_bias"
_SENSOR = {
    "sensor_lag": Kind("sensor", lambda m, s: {"time_constant": 2.0 * m * s.dt}, tuple(_LATE.split())),
    "sensor_delay": Kind("sensor", lambda m, s: {"delay": 1.6 * m * s.dt}, tuple(_LATE.split())),
    "sensor_coupling": Kind("sensor", lambda m, s: {"coefficient": s.sign * 0.1 * m * np.std(s.x) / s.spread()},
                            tuple(_READ.split()), lambda t, y, v, w, p, h: y + p["coefficient"] * v, "output"),
    "sensor_nonlinearity": Kind("sensor", lambda m, s: {"coefficient": s.sign * 0.1 * m / (np.sqrt(np.mean(s.x**2)) + 1e-12)},
                                tuple(_READ.split()), lambda t, y, v, w, p, h: y + p["coefficient"] * y * y),
    "sensor_gain": Kind("sensor", lambda m, s: {"relative_error": s.sign * 0.1 * m}, tuple(_READ.split()),
                        lambda t, y, v, w, p, h: (1 + p["relative_error"]) * y),
    "sensor_bias": Kind("sensor", lambda m, s: {"value": s.sign * 0.2 * m * np.std(s.x)}, tuple(_READ.split()),
                        lambda t, y, v, w, p, h: y + p["value"]),
    "sensor_drift": Kind("sensor", lambda m, s: {"rate": s.sign * 0.3 * m * np.std(s.x) / s.duration},
                         (*_READ.split(), *_TIME.split()), lambda t, y, v, w, p, h: y + p["rate"] * t),
    "sensor_rectification": Kind("sensor", lambda m, s: {}, (*_READ.split(), *_DRY.split()),
                                 lambda t, y, v, w, p, h: np.abs(y), needs="crossing"),
    "sensor_saturation": Kind("sensor", lambda m, s: {"limit": _quantile(s.x, 0.12 * m)}, (*_READ.split(), *_STOP.split()),
                              lambda t, y, v, w, p, h: np.minimum(y, p["limit"]), marks=("region",)),
    "sensor_quantization": Kind("sensor", lambda m, s: {"step": 0.3 * m * np.std(s.x)}, tuple(_READ.split()),
                                lambda t, y, v, w, p, h: p["step"] * np.floor(y / p["step"] + 0.5)),
}  # fmt: skip
_PARAMETER = {
    "parameter_error": Kind("parameter", lambda m, s: {"relative_error": s.sign * 0.15 * m}, (*_SMOOTH.split(), *_ACT.split())),
    "parameter_drift": Kind("parameter", lambda m, s: {"rate": s.sign * 0.3 * m / s.duration}, tuple(_TIME.split())),
    "parameter_dependence": Kind("parameter", _dependence, (*_SMOOTH.split(), *_ACT.split()), variable="signal"),
    "parameter_step": Kind("parameter", lambda m, s: {"relative_error": s.sign * 0.2 * m, **_moment(s)}, tuple(_TIME.split()),
                           marks=("time",)),
}  # fmt: skip

#: Elements between two parts, which few plants have; no arm draws them.
_ELEMENT = {
    "backlash": Kind(
        "element",
        lambda m, s: {"half_width": 0.3 * m * s.spread()},
        ("parameter_dependence", "parameter_error", "input_backlash", "input_dead_zone"),
    )
}
#: Canonical name -> family: what can be withheld.
KINDS: dict[str, Kind] = {**_PARAMETER, **_ELEMENT, **_BALANCE, **_PORT, **_LIMIT, **_HIDDEN, **_INPUT, **_SENSOR}


def scaled(v: Any, p: Params) -> Any:
    return (v - p["middle"]) / p["scale"]


def _shape(scene: Scene) -> dict[str, Any]:
    return {"middle": float(np.mean(scene.v)), "scale": scene.spread()}


#: Effects that no catalogue holds.
NOVEL: dict[str, Kind] = {
    "novel_ripple": term(lambda t, x, v, w, p, h: p["size"] * np.sin(4.0 * scaled(v, p)), "", "state", first="size",
                         shape=_shape),
    "novel_bump": term(lambda t, x, v, w, p, h: p["size"] * np.exp(-3.0 * (scaled(v, p) - 0.4) ** 2), "", "state",
                       first="size", either=True, shape=_shape),
    "novel_even_power": term(lambda t, x, v, w, p, h: p["size"] * np.abs(scaled(v, p)) ** 1.5 * np.cos(3.0 * scaled(v, p)),
                             "", "state", first="size", either=True, shape=_shape),
    "novel_gate": term(lambda t, x, v, w, p, h: p["size"] * np.tanh(6.0 * scaled(v, p)) * np.sin(w * 2.5), "", "gate",
                       first="size", shape=_shape),
}  # fmt: skip


def twins_of(name: str) -> tuple[str, ...]:
    """Names that can imitate an effect on some data, without itself.

    >>> "sensor_lag" in twins_of("input_delay")
    True
    """
    kind = KINDS.get(name) or NOVEL[name]
    return tuple(dict.fromkeys(twin for twin in kind.twins if twin != name))


def remaining(names: list[str]) -> list[str]:
    """The canonical names that are left when these effects and their twins leave the catalogue.

    >>> "coulomb_friction" in remaining(["stribeck_friction"])
    False
    """
    gone = {twin for name in names for twin in (name, *twins_of(name))}
    return [name for name in KINDS if name not in gone]
