"""Constructor arguments that are read as what they mean for a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError

__all__ = ["Resolved", "known_names", "listed", "whole_steps"]


class Resolved:
    """A constructor argument that is kept as given and read through the method ``_read_<name>(given)``."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __set__(self, obj: Any, value: Any) -> None:
        obj.__dict__[self.name] = value

    def __get__(self, obj: Any, owner: type | None = None) -> Any:
        return self if obj is None else getattr(obj, f"_read_{self.name}")(obj.__dict__[self.name])


def listed(names: Any) -> list[str]:
    """One name or several."""
    return [names] if isinstance(names, str) else [str(name) for name in names]


def known_names(names: list[str], known: Sequence[str], argument: str, fault: str) -> list[str]:
    """Names that the model has, each once."""
    for k, name in enumerate(names):
        if name not in known:
            raise SimulatorError(f"{argument}: {name!r} {fault} of the model; it has {list(known)}.")
        if name in names[:k]:
            raise SimulatorError(f"{argument}: {name!r} is listed twice; list each name once.")
    return names


def whole_steps(widths: np.ndarray, step: float, what: str) -> np.ndarray:
    """How many steps of the model there are in each width."""
    with np.errstate(invalid="ignore"):
        counts = np.rint(widths / step)
        off = ~((counts >= 1) & (np.abs(widths - counts * step) <= 1e-6 * widths))  # times are sums of rounded numbers
    if np.any(off):
        raise SimulatorError(
            f"{what} {widths[np.argmax(off)]:g}, expected a positive multiple of the model's timestep {step:g}: change it, "
            'or the timestep (<option timestep="..."/> in the MJCF).'
        )
    return counts.astype(int)
