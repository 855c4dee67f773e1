"""The discrete hot loop: free runs of lag models, by whichever of three routes is fast for their number and length."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sksurrogate.kernels.net import LagNet, Net, lag_rows
from sksurrogate.kernels.scalar import MAX_PRODUCTS, scalar_run

#: A run with more steps is cut into pieces.
LONG = 4000

#: Bytes of the time-major buffer.
BUFFER = 2**20

#: Runs that go at once in one block of the time-major loop, so that a window stays in the cache.
RUNS_IN_BLOCK = 2048


def march(
    step: Callable[[np.ndarray], np.ndarray],
    U: np.ndarray,
    first: np.ndarray,
    output_lags: Sequence[int],
    input_terms: Sequence[tuple[int, int]],
    limits: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Free run of any one-step model, all runs at once, one call per step.

    ``step``: (n_runs, n_features) -> (n_runs, n_outputs); features are past outputs lag by lag, then inputs.
    ``U`` (n_runs, n_steps, n_inputs).
    ``first`` (n_runs, n_first, n_outputs): outputs at the first steps, as many as the longest lag at least.
    ``input_terms`` sequence of (int, int): column and lag of every input feature.
    ``limits`` (ndarray, ndarray): lowest and highest outputs, (n_outputs,) each, with which ``step`` is called again.
    Returns (n_runs, n_steps, n_outputs): nan after a run became infinite or nan or the limits.
    """
    n_runs, n_steps, _ = U.shape
    n_first, o = first.shape[1:]
    y = np.full((n_runs, n_steps, o), np.nan)
    y[:, :n_first] = first[:, :n_steps]
    if n_steps <= n_first:
        return y
    known = lag_rows(U, input_terms, n_first).reshape(-1, n_runs, n_steps - n_first)
    alive = np.arange(n_runs)
    for t in range(n_first, n_steps):
        phi = np.concatenate([*(y[alive, t - k] for k in output_lags), known[:, alive, t - n_first].T], axis=1)
        found = step(phi)
        y[alive, t] = found
        low, high = limits or (-np.inf, np.inf)
        within = np.isfinite(found) & (found >= low) & (found <= high)
        if not within.all():
            alive = alive[within.all(axis=1)]
            if not len(alive):
                break
    return y


def free_run(model: LagNet, U: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Free runs of a network.

    Many runs go at once, one product a step; a long run goes as pieces at once; a short one as plain numbers.

    ``U`` (n_runs, n_steps, n_inputs).
    ``first`` (n_runs, n_first, n_outputs): outputs at the first steps, as many as the longest lag at least.
    Returns (n_runs, n_steps, n_outputs): not finite from where a run diverged.
    """
    n_runs, n_steps, _ = U.shape
    n_first = first.shape[1]
    if n_steps <= n_first:
        return np.array(first[:, :n_steps])
    folded = model.folded()
    small = sum(w.size for w in folded.net.weights) <= MAX_PRODUCTS
    # measured: a step at once costs about 7 us for all runs, as plain numbers 0.7 us a run, in pieces 0.07 us a run
    if n_steps > LONG and n_runs <= 64:
        return np.stack([long_run(folded, U[r], first[r]) for r in range(n_runs)])
    if small and n_runs <= 8:
        return np.stack([one_run(folded, U[r], first[r]) for r in range(n_runs)])
    return runs_at_once(folded, U, first)


def runs_at_once(model: LagNet, U: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Time-major loop over steps for all runs together; arguments as for :func:`free_run`, model folded.

    A buffer holds outputs and inputs of one step as rows and runs as columns, so that all that a step needs is one
    contiguous block and the first layer is one product. The last bias is kept out of the stored outputs.
    """
    n_runs, n_steps, m = U.shape
    n_first, o = first.shape[1:]
    if n_runs > RUNS_IN_BLOCK:
        blocks = range(0, n_runs, RUNS_IN_BLOCK)
        return np.concatenate(
            [runs_at_once(model, U[r : r + RUNS_IN_BLOCK], first[r : r + RUNS_IN_BLOCK]) for r in blocks]
        )
    net, width, longest = model.net, o + m, model.longest
    shift = net.biases[-1]
    window = np.zeros((len(net.biases[0]), longest + 1, width))
    for k, lag in enumerate(model.output_lags):
        window[:, longest - lag, :o] = net.weights[0][k * o : (k + 1) * o].T
    for k, (j, lag) in enumerate(model.input_terms):
        window[:, longest - lag, o + j] = net.weights[0][model.n_past + k]
    bias = net.biases[0] + window[:, :, :o].sum(axis=1) @ shift
    if len(net.weights) == 1:
        bias = bias - shift
    matrix = window.reshape(len(window), -1)
    bias = np.repeat(bias[:, None], n_runs, axis=1)
    y = np.empty((n_runs, n_steps, o))
    y[:, :n_first] = first
    # a block of steps at a time: what is turned from run-major to time-major stays in the cache
    n_block = max(min(BUFFER // (8 * width * n_runs), n_steps - n_first), 1)
    buffer = np.zeros((longest + n_block, width, n_runs))
    buffer[:longest, :o] = (first[:, n_first - longest :] - shift).transpose(1, 2, 0)
    buffer[:longest, o:] = U[:, n_first - longest : n_first].transpose(1, 2, 0)
    for start in range(n_first, n_steps, n_block):
        stop = min(start + n_block, n_steps)
        rows = slice(longest, longest + stop - start)
        buffer[rows, :o] = 0.0  # outputs to come are in the window with weight 0: no nan may stand there
        buffer[rows, o:] = U[:, start:stop].transpose(1, 2, 0)
        _loop(net, matrix, bias, buffer, o, longest, stop - start)
        np.add(buffer[rows, :o].transpose(2, 0, 1), shift, out=y[:, start:stop])
        buffer[:longest] = buffer[stop - start : stop - start + longest].copy()
    return y


def _loop(net: Net, matrix: np.ndarray, bias: np.ndarray, buffer: np.ndarray, o: int, longest: int, n: int) -> None:
    """Fill the outputs of n steps in the buffer, one after the other, without making an array."""
    width, n_runs = buffer.shape[1:]
    flat = buffer.reshape(-1, n_runs)
    sums = [np.empty((w.shape[1], n_runs)) for w in net.weights]
    inner = [(np.ascontiguousarray(w.T), b[:, None]) for w, b in zip(net.weights[1:], net.biases[1:])]
    last = len(inner) - 1
    with np.errstate(over="ignore", invalid="ignore"):
        for t in range(n):
            z = np.matmul(matrix, flat[t * width : (t + longest + 1) * width], out=sums[0])
            z += bias
            for k, (w, b) in enumerate(inner):
                kind = net.activations[k]
                if kind == "tanh":
                    np.tanh(z, out=z)
                elif kind == "relu":
                    np.maximum(z, 0.0, out=z)
                if k == last:
                    break
                z = np.matmul(w, z, out=sums[k + 1])
                z += b
            if inner:
                np.matmul(inner[last][0], z, out=buffer[longest + t, :o])
            else:
                buffer[longest + t, :o] = z


def one_run(model: LagNet, U: np.ndarray, first: np.ndarray) -> np.ndarray:
    """One short run, or the rest of a piece, (n_steps, n_outputs), from (n_steps, n_inputs); model folded."""
    if sum(w.size for w in model.net.weights) > MAX_PRODUCTS:
        return runs_at_once(model, U[None], first[None])[0]
    sums = known_sums(model, U[None], len(first))
    return np.concatenate([first, scalar_run(model, sums, first)])


def long_run(model: LagNet, U: np.ndarray, first: np.ndarray) -> np.ndarray:
    """One long run, (n_steps, n_outputs), from (n_steps, n_inputs): cut into pieces that run at once; model folded.

    Every piece first starts some steps early from the first rows: a model that forgets its past has forgotten part of
    them where the piece begins to count. Pieces whose neighbour ended elsewhere run again from there, all at once while
    that brings ends and starts together, then one after the other, so that the result is the plain recursion whatever
    the model does; a model that never forgets costs as much as :func:`one_run`.
    """
    n_steps, n_first, longest = len(U), len(first), model.longest
    n = n_steps - n_first
    warm = 40 + 4 * longest
    length = max(int(np.sqrt(n / 2)), 2 * warm)
    begins = np.arange(n_first, n_steps, length)
    y = np.empty((n_first + len(begins) * length, first.shape[1]))
    y[:n_first] = first
    tail = y[n_first:].reshape(len(begins), length, -1)
    before = begins[:, None] + np.arange(-longest, 0)
    rows = begins[:, None] + np.arange(-warm - longest, length)
    inputs = U[np.clip(rows, 0, n_steps - 1)]
    found = runs_at_once(model, inputs, np.repeat(first[None, -longest:], len(begins), axis=0))
    tail[:] = found[:, warm + longest :]
    used, inputs = found[:, warm : warm + longest], inputs[:, warm:]
    tolerance, last = 1e-13 * np.abs(y[np.isfinite(y)]).max(initial=1e-300), np.inf
    with np.errstate(invalid="ignore"):
        while True:
            apart = np.abs(used - y[before]).max(axis=(1, 2))
            bad = np.flatnonzero(~(apart <= tolerance))
            total = float(np.minimum(apart[bad], 1.0).sum())
            if len(bad) < 4 or not total < 0.1 * last:
                break
            last, used[bad] = total, y[before[bad]]
            tail[bad] = runs_at_once(model, inputs[bad], used[bad])[:, longest:]
        for k in range(bad[0] if len(bad) else len(begins), len(begins)):
            start = y[before[k]]
            if not np.isfinite(start).all():
                y[begins[k] :] = np.nan
                break
            if not np.abs(used[k] - start).max() <= tolerance:
                tail[k] = one_run(model, inputs[k], start)[longest:]
    return y[:n_steps]


def known_sums(model: LagNet, U: np.ndarray, n_first: int) -> np.ndarray:
    """Share of inputs and bias in the first layer's sums, (n_units, n_runs * n)."""
    net = model.net
    if not model.input_terms:
        return np.repeat(net.biases[0][:, None], U.shape[0] * (U.shape[1] - n_first), axis=1)
    return net.weights[0][model.n_past :].T @ model.input_rows(U, n_first) + net.biases[0][:, None]
