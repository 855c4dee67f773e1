"""Well-known dynamical systems from the literature, each with one term that a simulator may lack."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["SYSTEMS", "System"]


@dataclass(frozen=True)
class System:
    """A system without its term, the term, and where it starts.

    Attributes
    ----------
    states : tuple of str
    rest : callable (x) -> sequence
        Derivatives without the term.
    place : str
        State in whose balance the term stands.
    term : callable (x) -> value
    low, high : tuple of float
        Range of the initial states.
    dt : float
    n_samples : int
    """

    states: tuple[str, ...]
    rest: Callable[[Any], Any]
    place: str
    term: Callable[[Any], Any]
    low: tuple[float, ...]
    high: tuple[float, ...]
    dt: float
    n_samples: int = 200


def _two(rest: Any, place: str, term: Any, low: Any, high: Any, dt: float, n: int = 200) -> System:
    return System(("x", "y"), rest, place, term, low, high, dt, n)


def _three(rest: Any, place: str, term: Any, low: Any, high: Any, dt: float, n: int = 200) -> System:
    return System(("x", "y", "z"), rest, place, term, low, high, dt, n)


#: Name -> system; the term is what the simulator lacks.
SYSTEMS: dict[str, System] = {
    "lotka_volterra": _two(lambda x: [1.1 * x[0], 0.1 * x[0] * x[1] - 0.4 * x[1]], "x", lambda x: -0.4 * x[0] * x[1],
                           (2, 1), (8, 4), 0.1),
    "van_der_pol": _two(lambda x: [x[1], x[1] - x[0]], "y", lambda x: -x[0] ** 2 * x[1], (-2, -2), (2, 2), 0.05),
    "duffing": _two(lambda x: [x[1], x[0] - 0.2 * x[1]], "y", lambda x: -x[0] ** 3, (-1.5, -1), (1.5, 1), 0.05),
    "pendulum": _two(lambda x: [x[1], -0.2 * x[1]], "y", lambda x: -4.0 * np.sin(x[0]), (-2.5, -2), (2.5, 2), 0.05),
    "fitzhugh_nagumo": _two(lambda x: [x[0] - x[1] + 0.5, 0.08 * (x[0] + 0.7 - 0.8 * x[1])], "x",
                            lambda x: -x[0] ** 3 / 3, (-2, -0.5), (2, 1.5), 0.2),
    "brusselator": _two(lambda x: [1.0 - 4.0 * x[0], 3.0 * x[0] - x[0] ** 2 * x[1]], "x", lambda x: x[0] ** 2 * x[1],
                        (0.5, 1), (3, 4), 0.05),
    "selkov": _two(lambda x: [-x[0] + 0.08 * x[1] + x[0] ** 2 * x[1], 0.6 - 0.08 * x[1]], "y",
                   lambda x: -x[0] ** 2 * x[1], (0.3, 0.5), (2, 2.5), 0.1),
    "logistic": System(("x",), lambda x: [0.8 * x[0]], "x", lambda x: -0.08 * x[0] ** 2, (0.3,), (14.0,), 0.1, 120),
    "gompertz": System(("x",), lambda x: [0.0 * x[0]], "x", lambda x: -0.6 * x[0] * np.log(x[0] / 8.0), (0.3,), (14.0,), 0.1, 120),
    "allee": System(("x",), lambda x: [-0.2 * x[0]], "x", lambda x: 0.3 * x[0] ** 2 - 0.05 * x[0] ** 3, (0.5,), (7.0,), 0.1, 150),
    "rosenzweig_macarthur": _two(lambda x: [x[0] * (1 - x[0] / 6), 0.5 * x[0] * x[1] / (1 + x[0]) - 0.3 * x[1]], "x",
                                 lambda x: -x[0] * x[1] / (1 + x[0]), (1, 0.5), (5, 3), 0.1),
    "chemostat": _two(lambda x: [-0.3 * x[0], 0.3 * (5 - x[1]) - 2 * x[0] * x[1] / (0.5 + x[1])], "x",
                      lambda x: x[0] * x[1] / (0.5 + x[1]), (0.2, 0.2), (3, 4), 0.1),
    "haldane_chemostat": _two(lambda x: [-0.2 * x[0], 0.2 * (6 - x[1])], "y", lambda x: -x[0] * x[1] / (1 + x[1] + x[1] ** 2 / 4),
                              (0.3, 0.3), (3, 6), 0.1),
    "sir": _two(lambda x: [0.0 * x[0], 1.2 * x[0] * x[1] - 0.4 * x[1]], "x", lambda x: -1.2 * x[0] * x[1],
                (0.6, 0.02), (1.0, 0.2), 0.1),
    "michaelis_menten": System(("s",), lambda x: [0.4 + 0.0 * x[0]], "s", lambda x: -1.5 * x[0] / (1.0 + x[0]), (0.05,), (8.0,), 0.1, 120),
    "goodwin_repression": _two(lambda x: [-0.5 * x[0], x[0] - 0.5 * x[1]], "x", lambda x: 2.0 / (1 + (x[1] / 1.5) ** 4),
                               (0.1, 0.1), (3, 4), 0.1),
    "toggle_switch": _two(lambda x: [-x[0] + 3 / (1 + x[1] ** 2), -x[1]], "y", lambda x: 3 / (1 + x[0] ** 2), (0, 0), (3, 3), 0.05),
    "bistable_autoactivation": System(("x",), lambda x: [0.1 - x[0]], "x", lambda x: 2.0 * x[0] ** 2 / (1 + x[0] ** 2), (0.02,), (3.5,), 0.05, 150),
    "arrhenius_reactor": _two(lambda x: [1.0 - x[0], 1.0 - x[1]], "x", lambda x: -4.0 * x[0] * np.exp(-2.0 / x[1]),
                              (0.2, 0.6), (2.0, 3.0), 0.05),
    "torricelli": System(("h",), lambda x: [0.3 + 0.0 * x[0]], "h", lambda x: -0.5 * np.sqrt(np.maximum(x[0], 0)), (0.02,), (4.0,), 0.1, 120),
    "terminal_velocity": System(("v",), lambda x: [9.81 + 0.0 * x[0]], "v", lambda x: -0.1 * x[0] * np.abs(x[0]), (-15.0,), (25.0,), 0.05, 120),
    "josephson": _two(lambda x: [x[1], 0.5 - 0.6 * x[1]], "y", lambda x: -np.sin(x[0]), (-3, -1), (3, 1), 0.1),
    "genetic_decay_tanh": _two(lambda x: [-x[0], x[0] - x[1]], "x", lambda x: 2 * np.tanh(1.5 * x[0] - 2.0 * x[1]), (-2, -2), (2, 2), 0.05),
    "wilson_cowan_single": System(("e",), lambda x: [-x[0]], "e", lambda x: 1 / (1 + np.exp(-8 * (x[0] - 0.5))), (0.0,), (1.3,), 0.05, 120),
    "lorenz": _three(lambda x: [10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], -8 / 3 * x[2]], "z", lambda x: x[0] * x[1],
                     (-8, -8, 15), (8, 8, 30), 0.01, 150),
    "lorenz_damped": _three(lambda x: [10 * (x[1] - x[0]), 12 * x[0] - x[1], x[0] * x[1] - 8 / 3 * x[2]], "y",
                            lambda x: -x[0] * x[2], (-5, -5, 3), (5, 5, 15), 0.02, 150),
    "roessler": _three(lambda x: [-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 - 5.7 * x[2]], "z", lambda x: x[0] * x[2],
                       (-5, -5, 0), (5, 5, 1), 0.05),
    "chua_cubic": _three(lambda x: [5.0 * (x[1] - 0.1 * x[0]), x[0] - x[1] + x[2], -6 * x[1]], "x", lambda x: -0.3 * x[0] ** 3,
                         (-1, -0.3, -1), (1, 0.3, 1), 0.02),
    "thomas": _three(lambda x: [-0.2 * x[0], np.sin(x[2]) - 0.2 * x[1], np.sin(x[0]) - 0.2 * x[2]], "x",
                     lambda x: np.sin(x[1]), (-2, -2, -2), (2, 2, 2), 0.1),
    "rabinovich_fabrikant_term": _three(lambda x: [-0.2 * x[0] + x[1], -x[0] - 0.2 * x[1], -0.5 * x[2]], "z",
                                        lambda x: x[0] ** 2, (-2, -2, 0), (2, 2, 1), 0.05),
    "euler_rigid_body": _three(lambda x: [-0.3 * x[1] * x[2], 0.5 * x[0] * x[2], 0.0 * x[0]], "z", lambda x: -0.4 * x[0] * x[1],
                               (-1, -1, -1), (1, 1, 1), 0.1),
    "stuart_landau": _two(lambda x: [x[0] - 2 * x[1], 2 * x[0] + x[1] - x[1] * (x[0] ** 2 + x[1] ** 2)], "x",
                          lambda x: -x[0] ** 3 - x[0] * x[1] ** 2, (-1.5, -1.5), (1.5, 1.5), 0.03),
}  # fmt: skip
