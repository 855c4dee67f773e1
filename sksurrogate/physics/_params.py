"""Named parameters of a simulator as scikit-learn parameters ``params__<name>``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sksurrogate.physics._simulator import BaseSimulator

__all__ = ["ParametricSimulator"]


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
