"""Free run of one short run: the recursion written out as plain Python numbers, without one array inside."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import tanh

import numpy as np

from sksurrogate.kernels.net import LagNet

#: Networks with more products a step gain nothing from being written out.
MAX_PRODUCTS = 400

_ACTIVATE = {
    "tanh": "tanh({})",
    "identity": "{}",
    "relu": "{0} if {0} > 0.0 else 0.0",
}


def scalar_run(model: LagNet, sums: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Free run of one run.

    ``model``: folded.
    ``sums`` (n_units, n): share of inputs and bias in the first layer's sums.
    ``first`` (n_first, n_outputs): outputs before the first step, at least as many as the longest output lag.
    Returns (n, n_outputs).
    """
    net, o = model.net, model.n_outputs
    run = _written(tuple(w.shape for w in net.weights), net.activations, model.output_lags, o)
    longest = max(model.output_lags)
    start = [float(first[len(first) - k, i]) for k in range(1, longest + 1) for i in range(o)]
    numbers = np.concatenate(
        [net.weights[0][: model.n_past].ravel(), *(part.ravel() for part in net.weights[1:]), *net.biases[1:]]
    )
    flat: list[float] = []
    run(flat, start, numbers.tolist(), *(row.tolist() for row in sums))
    return np.array(flat).reshape(sums.shape[1], o)


@lru_cache(maxsize=64)
def _written(
    shapes: tuple[tuple[int, ...], ...], activations: tuple[str, ...], lags: tuple[int, ...], o: int
) -> Callable[..., None]:
    """The function for one structure; its weights are arguments."""
    past = [f"y{k}_{i}" for k in range(1, max(lags) + 1) for i in range(o)]
    used = [f"y{k}_{i}" for k in lags for i in range(o)]
    units = [f"z0_{j}" for j in range(shapes[0][1])]
    names = [f"w0_{i}_{j}" for i in range(len(used)) for j in range(shapes[0][1])]
    for layer, shape in enumerate(shapes[1:], 1):
        names += [f"w{layer}_{i}_{j}" for i in range(shape[0]) for j in range(shape[1])]
    for layer, shape in enumerate(shapes[1:], 1):
        names += [f"b{layer}_{j}" for j in range(shape[1])]
    body = [
        f"        z0_{j} += " + " + ".join(f"w0_{i}_{j} * {name}" for i, name in enumerate(used))
        for j in range(len(units))
    ]
    for layer, shape in enumerate(shapes[1:], 1):
        kind = _ACTIVATE[activations[layer - 1]]
        body += [f"        h{layer}_{i} = " + kind.format(f"z{layer - 1}_{i}") for i in range(shape[0])]
        for j in range(shape[1]):
            terms = " + ".join(f"w{layer}_{i}_{j} * h{layer}_{i}" for i in range(shape[0]))
            body.append(f"        z{layer}_{j} = b{layer}_{j} + {terms}")
    last = [f"z{len(shapes) - 1}_{i}" for i in range(o)]
    body.append(f"        {', '.join(past)} = {', '.join([*last, *past[: len(past) - o]])}")
    body += [f"        add({name})" for name in last]
    loop = f"for {units[0]} in sums0:" if len(units) == 1 else f"for {', '.join(units)} in zip({_list(len(units))}):"
    lines = [
        f"def run(out, start, numbers, {_list(len(units))}):",
        "    add = out.append",
        f"    {', '.join(past)}, = start",
        f"    {', '.join(names)}, = numbers",
        f"    {loop}",
        *body,
    ]
    space: dict[str, object] = {"tanh": tanh}
    exec("\n".join(lines), space)  # names are made here from integers alone
    return space["run"]  # type: ignore[return-value]


def _list(n: int) -> str:
    return ", ".join(f"sums{j}" for j in range(n))
