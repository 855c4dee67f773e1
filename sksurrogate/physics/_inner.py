"""Simulators whose runs are those of another one of this package."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate.exceptions import SimulatorError


def held_over_samples(hold: Any, method: Any = "auto") -> None:
    """A map from sample to sample knows neither inputs between samples nor an integrator."""
    for name, value, only in (("hold", hold, "zoh"), ("method", method, "auto")):
        if value != only:
            raise SimulatorError(
                f"{name}={value!r}: a system that goes from sample to sample holds its inputs and is not integrated; leave {name} out."
            )


class InnerRunsMixin:
    """Free runs of the same system as an ODESimulator or a StepSimulator."""

    def _inner(self) -> Any:
        """That simulator."""

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs)."""
        return self._inner().simulate(U, x0, t)

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length, all at once: (n_runs, n_samples, n_inputs) -> (n_runs, n_samples, n_outputs)."""
        return self._inner().simulate_batch(U, X0, t)

    @available_if(lambda self: getattr(self, "dt", None) is not None and hasattr(self._inner(), "held_map"))
    def held_map(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, G and g of ``x_next = F x + G u + g``, where the system is linear."""
        return self._inner().held_map()

    @available_if(lambda self: hasattr(self, "rhs"))
    def substeps(self, U: Any, x0: Any = None, t: Any = None) -> int:
        """Runge-Kutta steps per sample that :meth:`simulate` takes for these inputs."""
        return int(self._inner().substeps(U, x0, t))

    @available_if(lambda self: hasattr(self, "rhs"))
    def simulate_states(self, U: Any, x0: Any = None, t: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """States and their derivatives of one run, both (n_samples, n_states)."""
        return self._inner().simulate_states(U, x0, t)
