"""From the parameters of a network, as the user typed them, to what the training takes."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.neural._network import ACTIVATIONS, Layers
from sksurrogate.neural._problems import Rows, Smoothness

#: Rows of a mini-batch of the solvers in torch where the data are too many to be taken whole at every step.
MANY_ROWS, BATCH = 20_000, 500
#: Steps of the solvers in torch with mini-batches.
TORCH_STEPS = 10_000


def read_sizes(sizes: Any) -> tuple[int, ...]:
    """``hidden_layer_sizes`` as a checked tuple."""
    given = (sizes,) if isinstance(sizes, Integral) else tuple(sizes)
    if any(not isinstance(size, Integral) or size < 1 for size in given):
        raise DataError(f"hidden_layer_sizes={sizes!r} must be positive integers, for example (5,) or (20, 10).")
    return tuple(int(size) for size in given)


def read_activations(activation: str | Sequence[str], hidden: tuple[int, ...]) -> tuple[str, ...]:
    """``activation`` of every layer, the output layer included."""
    if isinstance(activation, str):
        return (activation,) * len(hidden) + ("identity",)
    given = tuple(activation)
    unknown = [kind for kind in given if kind not in ACTIVATIONS]
    if unknown:
        raise DataError(f"activation={given!r}: {unknown[0]!r} is unknown; there are {sorted(ACTIVATIONS)}.")
    if len(given) not in (len(hidden), len(hidden) + 1):
        raise DataError(
            f"activation={given!r} has {len(given)} entries; hidden_layer_sizes={hidden!r} asks for {len(hidden)} "
            f"(output layer identity) or {len(hidden) + 1} (output layer named too)."
        )
    given = given if len(given) > len(hidden) else (*given, "identity")
    if given[-1] == "binary_step":
        raise DataError(
            'activation: an output layer of "binary_step" cannot be trained, its slope is zero everywhere; take '
            '"logistic" and round, or "identity" above a hidden "binary_step" layer.'
        )
    return given


def read_smoothness(slope: float, curvature: float, activations: tuple[str, ...]) -> Smoothness | None:
    """The smoothness asked for."""
    if not slope and not curvature:
        return None
    if "binary_step" in activations:
        raise DataError(
            f'slope={slope!r}, curvature={curvature!r}: a network with "binary_step" has neither; take "logistic", or 0.'
        )
    return Smoothness(float(slope), float(curvature))


def read_batch(batch_size: int | None, n_rows: int) -> int:
    """Rows of a mini-batch; -1 for all."""
    if batch_size is not None:
        return int(batch_size)
    return -1 if n_rows <= MANY_ROWS else BATCH


def epochs_of(solver: str, batch_size: int | None, n_rows: int) -> int:
    """Iterations where the user does not say."""
    if solver in ("lm", "lbfgs"):
        return 200 if solver == "lm" else 1000
    size = read_batch(batch_size, n_rows)
    return 1000 if size < 0 or size >= n_rows else min(1000, max(10, -(-TORCH_STEPS * size // n_rows)))


def read_options(solver: str, momentum: float, betas: Any, net_params: dict[str, Any] | None) -> dict[str, Any]:
    """Parameters of the optimizer (paper, Table 2), then those of ``net_params``, which win."""
    options: dict[str, Any] = {}
    if solver in ("momentum", "nesterov"):
        if solver == "nesterov" and not momentum:
            raise DataError('momentum=0 leaves nothing to look ahead with: take solver="gd", or momentum=0.9.')
        options["optimizer__momentum"] = float(momentum)
    if solver in ("adam", "adamw"):
        given = np.asarray(betas, dtype=float)
        if given.shape != (2,) or not ((given >= 0) & (given < 1)).all():
            raise DataError(
                f"betas={betas!r} must be two numbers from 0 up to but without 1, for example (0.9, 0.999)."
            )
        options["optimizer__betas"] = tuple(given.tolist())
    return {**options, **(net_params or {})}


def read_device(device: str) -> str:
    """The device, where this machine has it."""
    import torch

    try:
        torch.empty(1, device=device).cpu()
    except (RuntimeError, AssertionError) as error:
        kinds = ["cpu", *(kind for kind in ("cuda", "mps", "xpu") if getattr(torch, kind).is_available())]
        raise DataError(f"device={device!r} cannot be used: {error}. There are {kinds} here.") from None
    return device


def read_prior(theta0: Any, sizes: tuple[int, ...], activations: tuple[str, ...], rows: Rows) -> np.ndarray | None:
    """``theta0``, a fitted network or (coefs, intercepts) for raw data, as weights for the standardised ones."""
    if theta0 is None:
        return None
    if "binary_step" in activations:
        raise DataError('theta0: layers up to a "binary_step" are drawn and not trained; take "logistic", or None.')
    if hasattr(theta0, "coefs_"):
        theta0 = (theta0.coefs_, theta0.intercepts_)
    try:
        coefs, intercepts = theta0
        weights = tuple(np.array(w, dtype=float) for w in coefs)
        biases = tuple(np.array(b, dtype=float) for b in intercepts)
    except (TypeError, ValueError):
        raise DataError(
            f"theta0={theta0!r} must be a fitted FNNRegressor, or (coefs, intercepts) of lists of arrays as in coefs_ "
            "and intercepts_."
        ) from None
    wanted = [*zip(sizes[:-1], sizes[1:])], [(n,) for n in sizes[1:]]
    if ([w.shape for w in weights], [b.shape for b in biases]) != wanted:
        raise DataError(
            f"theta0 has weights of shapes {[w.shape for w in weights]} and biases of shapes {[b.shape for b in biases]}; "
            f"hidden_layer_sizes and the data ask for {wanted[0]} and {wanted[1]}."
        )
    raw = Layers(weights, biases, activations)
    return raw.scaled(rows.mean, rows.scale, rows.shift, rows.gain).theta
