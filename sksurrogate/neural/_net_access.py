"""The fitted network as a skorch net."""

from __future__ import annotations

from typing import Any

from sklearn.utils.validation import check_is_fitted

from sksurrogate.neural._network import Layers
from sksurrogate.neural._training import GRADIENT

__all__ = ["NetAccess"]


class NetAccess:
    """Gives a network of arrays the attribute ``net_``, made on first access and left out of pickles."""

    _layers: Layers
    solver_: str
    dtype: str
    device: str
    learning_rate: float | None
    batch_size: int | None
    net_params: dict[str, Any] | None

    @property
    def net_(self) -> Any:
        """Initialised skorch net with the fitted weights, for raw inputs (n_samples, n_features)."""
        check_is_fitted(self, "coefs_")
        if "_net" not in self.__dict__:
            from sksurrogate.neural._torch import build_net

            solver = self.solver_ if self.solver_ in GRADIENT else "adam"
            self._net = build_net(
                self._layers,
                solver=solver,
                dtype=self.dtype,
                device=self.device,
                learning_rate=self.learning_rate or GRADIENT[solver],
                batch_size=self.batch_size or -1,
                options=self.net_params,
            )
        return self._net

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__().copy()  # type: ignore[misc, attr-defined]
        state.pop("_net", None)  # made again on access
        return state
