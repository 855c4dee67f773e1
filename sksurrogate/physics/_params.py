"""Named parameters of a simulator as scikit-learn parameters ``params__<name>``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._simulator import BaseSimulator


def numbers_of(params: Any) -> dict[str, float]:
    """Parameters as numbers.

    Raises SimulatorError: ``params`` is no dict, or a value is no number.

    >>> numbers_of({"k": "2"}), numbers_of(None)
    ({'k': 2.0}, {})
    """
    if not isinstance(params or {}, Mapping):
        raise SimulatorError(f"params={params!r}: expected a dict of names and values, for example {{'k': 1.0}}.")
    found = {}
    for name, value in dict(params or {}).items():
        try:
            number = float(value)
        except (TypeError, ValueError) as error:
            raise SimulatorError(f"params: {name}={value!r}, expected a number.") from error
        if number != number:
            raise SimulatorError(f"params: {name}=nan, expected a number.")
        found[str(name)] = number
    return found


class ParametricSimulator(BaseSimulator):
    """Base of simulators with a dict ``params``: single entries are reached as ``params__k``."""

    params: Any

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Constructor arguments; with ``deep`` also every parameter as ``params__<name>``."""
        out = super().get_params(deep=False)
        if deep and isinstance(out.get("params"), Mapping):
            out.update({f"params__{name}": value for name, value in out["params"].items()})
        return out

    def set_params(self, **params: Any) -> ParametricSimulator:
        """Set constructor arguments, or single parameters as ``params__k=2.0`` (in a new dict; the user's is never written)."""
        single = {key.removeprefix("params__"): params.pop(key) for key in list(params) if key.startswith("params__")}
        if params:
            super().set_params(**params)
        if single:
            known = dict(self.params or {})
            unknown = sorted(set(single) - set(known))
            if unknown:
                raise ValueError(
                    f"params__{unknown[0]}: the simulator has no parameter {unknown[0]!r}; it has {sorted(known)}."
                )
            self.params = {**known, **single}
        return self
