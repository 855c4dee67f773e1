"""The two maps of a state-space model, affine or affine plus a tanh network, with their slopes."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np


@dataclass(frozen=True)
class Block:
    """``z -> z W + b + network(z)``; without hidden layers an affine map."""

    n_in: int
    n_out: int
    hidden: tuple[int, ...] = ()  #: Units of the tanh layers of the network

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Of W, b, and the network's weights and biases."""
        sizes = [self.n_in, *self.hidden, self.n_out] if self.hidden else []
        layers = [shape for a, b in zip(sizes[:-1], sizes[1:]) for shape in ((a, b), (b,))]
        return [(self.n_in, self.n_out), (self.n_out,), *layers]

    @property
    def size(self) -> int:
        """Number of parameters."""
        return sum(prod(shape) for shape in self.shapes)

    @property
    def penalised(self) -> np.ndarray:
        """Which parameters are weights of the network, (size,) of bool."""
        return np.concatenate([np.full(prod(s), k > 1 and len(s) == 2) for k, s in enumerate(self.shapes)])

    def parts(self, theta: np.ndarray) -> list[np.ndarray]:
        """Cut flat parameters."""
        out, place = [], 0
        for shape in self.shapes:
            n = prod(shape)
            out.append(theta[place : place + n].reshape(shape))
            place += n
        return out

    def value(self, theta: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(n_rows, n_in) -> (n_rows, n_out)."""
        return self.value_of(self.parts(theta), z)

    @staticmethod
    def value_of(parts: list[np.ndarray], z: np.ndarray) -> np.ndarray:
        """:meth:`value` of parameters that are cut already."""
        W, b, *layers = parts
        out = z @ W + b
        if layers:
            for k in range(0, len(layers) - 2, 2):
                z = np.tanh(z @ layers[k] + layers[k + 1])
            out = out + z @ layers[-2] + layers[-1]
        return out

    def slopes(self, theta: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value, and slopes by z (n_rows, n_out, n_in)."""
        W, b, *layers = self.parts(theta)
        value, by_z = z @ W + b, np.broadcast_to(W.T, (len(z), *W.T.shape))
        if layers:
            values = [z]
            for k in range(0, len(layers) - 2, 2):
                values.append(np.tanh(values[-1] @ layers[k] + layers[k + 1]))
            value = value + values[-1] @ layers[-2] + layers[-1]
            back = layers[-2].T
            for k in range(len(values) - 1, 0, -1):
                back = (back * (1.0 - values[k] ** 2)[:, None, :]) @ layers[2 * k - 2].T
            by_z = by_z + back
        return value, by_z

    def jacobians(self, theta: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Value, slopes by z (n_rows, n_out, n_in) and by theta (n_rows, n_out, size)."""
        W, b, *layers = self.parts(theta)
        n, eye = len(z), np.broadcast_to(np.eye(self.n_out), (len(z), self.n_out, self.n_out))
        by_theta = [(z[:, None, :, None] * eye[:, :, None, :]).reshape(n, self.n_out, -1), eye]
        value, by_z = z @ W + b, np.broadcast_to(W.T, (n, *W.T.shape))
        if layers:
            values = [z]
            for k in range(0, len(layers) - 2, 2):
                values.append(np.tanh(values[-1] @ layers[k] + layers[k + 1]))
            value = value + values[-1] @ layers[-2] + layers[-1]
            back: np.ndarray = eye
            found: list[np.ndarray] = []
            for k in range(len(values) - 1, -1, -1):
                found[:0] = [(values[k][:, None, :, None] * back[:, :, None, :]).reshape(n, self.n_out, -1), back]
                back = back @ layers[2 * k].T
                if k:
                    back = back * (1.0 - values[k] ** 2)[:, None, :]
            by_theta += found
            by_z = by_z + back
        return value, by_z, np.concatenate(by_theta, axis=2)


@dataclass(frozen=True)
class StateModel:
    """f on (x, u) and g on x, or on (x, u) with feedthrough."""

    n_states: int
    n_inputs: int
    n_outputs: int
    hidden: tuple[int, ...] = ()
    feedthrough: bool = False

    @property
    def f(self) -> Block:
        """The next state."""
        return Block(self.n_states + self.n_inputs, self.n_states, self.hidden)

    @property
    def g(self) -> Block:
        """The output."""
        return Block(self.n_states + self.n_inputs * self.feedthrough, self.n_outputs, self.hidden)

    def following(self, theta: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The states one sample later."""
        return self.f.value(theta[: self.f.size], np.concatenate([x, u], axis=1))

    def seen(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What g sees."""
        return np.concatenate([x, u], axis=1) if self.feedthrough else x

    def output(self, theta: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Outputs at states and inputs."""
        return self.g.value(theta[self.f.size :], self.seen(x, u))

    def affine(
        self, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, b: np.ndarray, c: np.ndarray
    ) -> np.ndarray:
        """Parameters of ``x' = A x + B u + b``, ``y = C x + D u + c`` with networks at zero."""
        seen = np.concatenate([C, D], axis=1) if self.feedthrough else C
        flat = []
        for block, W, bias in ((self.f, np.concatenate([A, B], axis=1), b), (self.g, seen, c)):
            theta = np.zeros(block.size)
            theta[: W.size + len(bias)] = np.concatenate([W.T.ravel(), bias])
            flat.append(theta)
        return np.concatenate(flat)

    @property
    def penalised(self) -> np.ndarray:
        """Which parameters are weights of the networks."""
        return np.concatenate([self.f.penalised, self.g.penalised])
