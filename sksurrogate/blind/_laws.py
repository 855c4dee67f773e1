"""Laws that are withheld: forms that no catalogue holds, in a balance, at an input or a sensor, of two signals, of the recent past.

Their equations are written here for the plant alone; a diagnosis has to find them as formulae.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.blind._truths import KINDS, NOVEL, Kind, Params, Scene, Term, scaled, unit


def _places(scene: Scene) -> dict[str, Any]:
    """Where a law bends, and over what width, in units of its signal."""
    dice, spread = scene.dice, scene.spread()
    return {
        "middle": float(np.mean(scene.v) + (dice[0] - 0.5) * spread),
        "scale": float(spread * (0.4 + 0.6 * dice[1])),
    }


def _about_zero(scene: Scene) -> dict[str, Any]:
    """A width about zero."""
    return {"scale": float(scene.spread() * (0.3 + 0.6 * scene.dice[1]))}


def _half(scene: Scene) -> dict[str, Any]:
    """A level at which half is reached, of what is positive."""
    return {"scale": float(np.median(np.abs(scene.v)) * (0.3 + 0.9 * scene.dice[1]))}


def _waves(scene: Scene) -> dict[str, Any]:
    """One to two periods over the range."""
    reach = float(np.ptp(scene.v)) + 1e-12
    return {"frequency": 2 * np.pi * (0.8 + scene.dice[1]) / reach, "phase": float(2 * np.pi * scene.dice[0])}


def _late(scene: Scene) -> dict[str, Any]:
    """A recent past of 5 to 25 samples."""
    return {**_about_zero(scene), "time_constant": scene.dt * (5.0 + 20.0 * scene.dice[0])}


def _law(place: str, form: Term, shape: Any, variable: str, equivalents: str, needs: str = "") -> Kind:
    """A law sized as the derivative, or as the share of the signal, that it adds; ``equivalents``: shapes that write it."""

    def size(m: Any, scene: Scene) -> dict[str, Any]:
        params: dict[str, Any] = {"size": 1.0, **shape(scene)}
        if place in ("input", "sensor"):
            t = np.zeros(scene.v.size)
            added = form(t, scene.x, scene.v, scene.w, params, 0.0) - scene.x
            one = 0.3 * float(np.std(scene.x)) / (float(np.std(added)) + 1e-12)
        else:
            one = unit(form, scene, params)
        return {**params, "size": m * one * scene.sign}

    return Kind(place, size, (), form, variable, needs, tuple(equivalents.split()))


def _added(form: Any) -> Term:
    """What an actuator or a sensor adds to its signal."""
    return lambda t, x, v, w, p, h: x + form(t, x, v, w, p, h)


def _tanh(t: Any, x: Any, v: Any, w: Any, p: Params, h: float) -> Any:
    return p["size"] * np.tanh(scaled(v, p)) * w


def _sine(t: Any, x: Any, v: Any, w: Any, p: Params, h: float) -> Any:
    return p["size"] * np.sin(p["frequency"] * v + p["phase"]) * w


def _bell(t: Any, x: Any, v: Any, w: Any, p: Params, h: float) -> Any:
    return p["size"] * np.exp(-(scaled(v, p) ** 2)) * w


def _monod(t: Any, x: Any, v: Any, w: Any, p: Params, h: float) -> Any:
    return p["size"] * v / (p["scale"] + v) * w


_IN_BALANCES = {
    "law_tanh": _law("balance", lambda t, x, v, w, p, h: p["size"] * np.tanh(v / p["scale"]), _about_zero, "state",
                     "tanh bending clip switch"),
    "law_sine": _law("balance", _sine, _waves, "state", "swing wave sine cosine"),
    "law_bell": _law("balance", _bell, _places, "state", "bell"),
    "law_gate": _law("balance", lambda t, x, v, w, p, h: p["size"] / (1.0 + np.exp(-2.0 * scaled(v, p))), _places, "state",
                     "switch tanh"),
    "law_exponential": _law("balance", lambda t, x, v, w, p, h: p["size"] * np.exp(scaled(v, p)), _places, "state", "exp"),
    "law_play": _law("balance", lambda t, x, v, w, p, h: p["size"] * np.sign(v) * np.maximum(np.abs(v) - p["scale"], 0.0),
                     _about_zero, "state", "dead_zone", "crossing"),
    "law_fading": _law("balance", lambda t, x, v, w, p, h: p["size"] * v / (1.0 + (v / p["scale"]) ** 2), _half, "state",
                       "fading"),
    "law_monod": _law("balance", _monod, _half, "state", "saturating inhibited hill", "positive"),
    "law_logarithm": _law("balance", lambda t, x, v, w, p, h: p["size"] * np.sign(v) * np.log1p(np.abs(v) / p["scale"]),
                          _half, "state", "logarithm"),
}  # fmt: skip
_SIGNALS = {
    f"law_{place}_{name}": _law(place, _added(form), shape, "", equivalents)
    for place in ("input", "sensor")
    for name, form, shape, equivalents in (
        ("tanh", _tanh, _places, "tanh switch bending"),
        ("sine", _sine, _waves, "swing wave sine cosine"),
        ("bell", _bell, _places, "bell"),
    )
}
_WIDER = {
    "law_tanh_times": _law("balance", _tanh, _places, "gate", "switch tanh"),
    "law_sine_times": _law("balance", _sine, _waves, "gate", "swing wave"),
    "law_bell_times": _law("balance", _bell, _places, "gate", "bell"),
    "law_monod_times": _law("balance", _monod, _half, "gate", "saturating inhibited hill", "positive"),
    "law_late_square": _law("hidden", lambda t, x, v, w, p, h: p["size"] * v**2, _late, "state", "square"),
    "law_late_tanh": _law("hidden", lambda t, x, v, w, p, h: p["size"] * np.tanh(v / p["scale"]), _late, "state",
                          "tanh bending clip switch"),
}  # fmt: skip

#: Name -> family.
WITHHELD: dict[str, Kind] = {**_IN_BALANCES, **_SIGNALS, **_WIDER}
#: Groups with the share of the cases that each takes.
GROUPS: tuple[tuple[tuple[str, ...], float], ...] = (
    (tuple(_IN_BALANCES), 0.5),
    (tuple(_SIGNALS), 0.25),
    (tuple(_WIDER), 0.25),
)


def family(name: str) -> Kind:
    """The family of an effect by its name: canonical, novel or withheld."""
    found = KINDS.get(name) or NOVEL.get(name) or WITHHELD[name]
    return found
