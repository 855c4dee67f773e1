"""A feedforward network as plain arrays: values and slopes.

Inside, arrays lie features first, ``(n_units, n_rows)``: element-wise work then runs along the long side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf, expit


@dataclass(frozen=True)
class Activation:
    """sigma(z) and its slope, from z and the value; ``torch_name`` is the module in ``torch.nn`` (None: our own)."""

    value: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray, np.ndarray], np.ndarray]
    torch_name: str | None


def _silu_slope(z: np.ndarray, value: np.ndarray) -> np.ndarray:
    gate = expit(z)
    return gate + value * (1.0 - gate)


def _gelu_slope(z: np.ndarray, value: np.ndarray) -> np.ndarray:
    return 0.5 * (1.0 + erf(z / np.sqrt(2.0))) + z * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)


#: Table 1 of the paper, and the modern ones.
ACTIVATIONS: dict[str, Activation] = {
    "identity": Activation(lambda z: z, lambda z, a: np.ones_like(z), "Identity"),
    "binary_step": Activation(lambda z: (z >= 0).astype(z.dtype), lambda z, a: np.zeros_like(z), None),
    "logistic": Activation(expit, lambda z, a: a * (1.0 - a), "Sigmoid"),
    "tanh": Activation(np.tanh, lambda z, a: 1.0 - a * a, "Tanh"),
    "relu": Activation(lambda z: np.maximum(z, 0.0), lambda z, a: (z > 0).astype(z.dtype), "ReLU"),
    "leaky_relu": Activation(
        lambda z: np.where(z > 0, z, 0.01 * z), lambda z, a: np.where(z > 0, 1.0, 0.01), "LeakyReLU"
    ),
    "elu": Activation(
        lambda z: np.where(z > 0, z, np.expm1(np.minimum(z, 0.0))), lambda z, a: np.where(z > 0, 1.0, a + 1.0), "ELU"
    ),
    "silu": Activation(lambda z: z * expit(z), _silu_slope, "SiLU"),
    "gelu": Activation(lambda z: 0.5 * z * (1.0 + erf(z / np.sqrt(2.0))), _gelu_slope, "GELU"),
    "softplus": Activation(lambda z: np.logaddexp(0.0, z), lambda z, a: expit(z), "Softplus"),
    "softsign": Activation(lambda z: z / (1.0 + np.abs(z)), lambda z, a: (1.0 + np.abs(z)) ** -2, "Softsign"),
}


@dataclass(frozen=True)
class Layers:
    """Layers ``xi_l = sigma_l(xi_(l-1) @ W_l + b_l)`` (paper, section 3.2)."""

    weights: tuple[np.ndarray, ...]  #: tuple of (n_in, n_out)
    biases: tuple[np.ndarray, ...]  #: tuple of (n_out,)
    activations: tuple[str, ...]  #: One for each layer, the output layer included

    def __call__(self, X: np.ndarray) -> np.ndarray:
        """(n_rows, n_inputs) -> (n_rows, n_outputs)."""
        value = X
        for w, b, kind in zip(self.weights, self.biases, self.activations):
            value = value @ w
            value += b
            value = ACTIVATIONS[kind].value(value)
        return value

    @property
    def theta(self) -> np.ndarray:
        """Layer by layer the weights, then the biases."""
        return np.concatenate([part.ravel() for w, b in zip(self.weights, self.biases) for part in (w, b)])

    @property
    def is_weight(self) -> np.ndarray:
        """1.0 for the entries of theta that are weights, 0.0 for biases."""
        parts = [np.full(p.size, v) for w, b in zip(self.weights, self.biases) for p, v in ((w, 1.0), (b, 0.0))]
        return np.concatenate(parts)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of inputs, hidden units and outputs."""
        return (len(self.weights[0]), *(len(b) for b in self.biases))

    def at(self, theta: np.ndarray) -> Layers:
        """The same network with other weights."""
        weights, biases, place = [], [], 0
        for w, b in zip(self.weights, self.biases):
            weights.append(theta[place : place + w.size].reshape(w.shape))
            biases.append(theta[place + w.size : place + w.size + b.size])
            place += w.size + b.size
        return Layers(tuple(weights), tuple(biases), self.activations)

    def below(self, n_layers: int) -> Layers:
        """The first layers alone."""
        return Layers(self.weights[:n_layers], self.biases[:n_layers], self.activations[:n_layers])

    def above(self, n_layers: int) -> Layers:
        """What follows the first layers."""
        return Layers(self.weights[n_layers:], self.biases[n_layers:], self.activations[n_layers:])

    def joined(self, other: Layers) -> Layers:
        """This network followed by another."""
        return Layers(self.weights + other.weights, self.biases + other.biases, self.activations + other.activations)

    def unscaled(self, mean: np.ndarray, scale: np.ndarray, shift: np.ndarray, gain: np.ndarray) -> Layers:
        """The network of raw inputs and outputs from that of ``(x - mean) / scale`` and ``(y - shift) / gain``.

        ``shift`` and ``gain`` are folded into an output layer of identity activation and must be 0 and 1 otherwise.
        """
        weights, biases = list(self.weights), list(self.biases)
        weights[0] = weights[0] / scale[:, None]
        biases[0] = biases[0] - mean @ weights[0]
        if self.activations[-1] == "identity":
            weights[-1] = weights[-1] * gain
            biases[-1] = biases[-1] * gain + shift
        return replace(self, weights=tuple(weights), biases=tuple(biases))

    def scaled(self, mean: np.ndarray, scale: np.ndarray, shift: np.ndarray, gain: np.ndarray) -> Layers:
        """The network of ``(x - mean) / scale`` and ``(y - shift) / gain`` from that of raw inputs and outputs."""
        weights, biases = list(self.weights), list(self.biases)
        biases[0] = biases[0] + mean @ weights[0]
        weights[0] = weights[0] * scale[:, None]
        if self.activations[-1] == "identity":
            weights[-1] = weights[-1] / gain
            biases[-1] = (biases[-1] - shift) / gain
        return replace(self, weights=tuple(weights), biases=tuple(biases))

    def run(self, x: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Sums and values of every layer from inputs (n_inputs, n_rows), units first."""
        out, value = [], x
        for w, b, kind in zip(self.weights, self.biases, self.activations):
            z = w.T @ value
            z += b[:, None]
            value = ACTIVATIONS[kind].value(z)
            out.append((z, value))
        return out

    def back(
        self, x: np.ndarray, runs: list[tuple[np.ndarray, np.ndarray]], delta: np.ndarray, out: np.ndarray
    ) -> None:
        """Write the slopes by theta, (n_theta, n_rows), of an output whose slopes by the values on top are ``delta``."""
        end = len(out)
        for layer in range(len(self.weights) - 1, -1, -1):
            if self.activations[layer] != "identity":
                delta = delta * ACTIVATIONS[self.activations[layer]].slope(*runs[layer])
            n_out = len(delta)
            below = runs[layer - 1][1] if layer else x
            out[end - n_out : end] = delta
            start = end - n_out * (len(below) + 1)
            np.multiply(below[:, None], delta, out=out[start : end - n_out].reshape(len(below), n_out, -1))
            end = start
            if layer:
                delta = self.weights[layer] @ delta

    def jacobian(self, X: np.ndarray) -> np.ndarray:
        """Slopes of the outputs by the inputs, (n_rows, n_outputs, n_inputs)."""
        slopes: np.ndarray | None = None
        value = X
        for w, b, kind in zip(self.weights, self.biases, self.activations):
            z = value @ w + b
            value = ACTIVATIONS[kind].value(z)
            # chain from the input on: n_inputs columns go through every layer
            through = np.broadcast_to(w.T, (len(X), *w.T.shape)) if slopes is None else w.T @ slopes
            slopes = through * ACTIVATIONS[kind].slope(z, value)[:, :, None]
        assert slopes is not None
        return slopes


def draw_layers(sizes: Sequence[int], activations: Sequence[str], rng: np.random.Generator) -> Layers:
    """Random layers for standardised inputs.

    The first layer gets units in random directions whose centres are spread over three standard deviations (one in each
    equal part, up to chance) and whose steepness is 0.5 to 1.5: over Bishop's four functions this start reached a good
    minimum from 2 to 5 times as often as Glorot's or Nguyen and Widrow's. Layers above follow Glorot.
    """
    weights, biases = [], []
    for layer, (n_in, n_out) in enumerate(zip(sizes[:-1], sizes[1:])):
        if layer == 0 and len(sizes) > 2:
            w = rng.normal(size=(n_in, n_out))
            size = np.sqrt(np.sum(w * w, axis=0))
            w *= rng.uniform(0.5, 1.5, n_out) / np.where(size > 0, size, 1.0)
            centre = np.linspace(-1.5, 1.5, n_out) if n_out > 1 else np.zeros(1)
            centre = centre + 0.3 * rng.normal(size=n_out)
            b = -centre * np.sqrt(np.sum(w * w, axis=0))
        else:
            reach = np.sqrt(6.0 / (n_in + n_out))
            w, b = rng.uniform(-reach, reach, (n_in, n_out)), rng.uniform(-reach, reach, n_out)
        weights.append(w)
        biases.append(b)
    return Layers(tuple(weights), tuple(biases), tuple(activations))
