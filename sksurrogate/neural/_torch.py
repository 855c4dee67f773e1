"""Networks in torch, trained through skorch. The classes are made on first use, so that torch is imported only then."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from sksurrogate.neural._network import ACTIVATIONS, Layers
from sksurrogate.neural._problems import CURVATURE_STEP

#: Solver -> optimizer of torch.optim and its parameters (None: our own line search).
OPTIMIZERS: dict[str, tuple[str | None, dict[str, Any]]] = {
    "gd": ("SGD", {}),
    "line_search": (None, {}),
    "momentum": ("SGD", {"momentum": 0.9}),
    "nesterov": ("SGD", {"momentum": 0.9, "nesterov": True}),
    "adam": ("Adam", {}),
    "adamw": ("AdamW", {}),
    "rmsprop": ("RMSprop", {}),
}


@cache
def _modules() -> list[type]:
    """The layers."""
    import torch

    class BinaryStep(torch.nn.Module):
        """0 below zero, 1 from zero on."""

        def forward(self, z: Any) -> Any:
            return (z >= 0).to(z.dtype)

    class Chain(torch.nn.Module):
        """Dense layers in a row; ``w`` (weights of the rows) passes by, for the loss."""

        def __init__(self, sizes: tuple, activations: tuple, dtype: str = "float64", fixed: int = 0):
            super().__init__()
            parts: list[Any] = []
            for k, (n_in, n_out, kind) in enumerate(zip(sizes[:-1], sizes[1:], activations)):
                dense = torch.nn.Linear(n_in, n_out, dtype=getattr(torch, dtype))
                dense.requires_grad_(k >= fixed)
                name = ACTIVATIONS[kind].torch_name
                parts += [dense, BinaryStep() if name is None else getattr(torch.nn, name)()]
            self.layers = torch.nn.Sequential(*parts)

        def forward(self, X: Any, w: Any = None) -> Any:
            return self.layers(X)

    return [BinaryStep, Chain]


def squared_size(module: Any, theta0: np.ndarray | None) -> Any:
    """Sum of squared weights, or the squared distance of weights and biases from ``theta0``."""
    import torch

    total, place = 0.0, 0
    for name, part in module.named_parameters():
        if theta0 is None:
            total = total + ((part**2).sum() if name.endswith("weight") else 0.0)
            continue
        piece = torch.as_tensor(theta0[place : place + part.numel()]).to(part)
        # arrays lie inputs first, layers of torch outputs first
        piece = piece.reshape(part.shape[::-1]).T if part.ndim == 2 else piece
        total, place = total + ((part - piece) ** 2).sum(), place + part.numel()
    return total


@cache
def _nets() -> list[type]:
    """The skorch net with our loss."""
    import torch
    from skorch import NeuralNetRegressor

    class Net(NeuralNetRegressor):
        """Weighted mean of squares as the loss, and the ridge on weights (not on biases)."""

        def __init__(
            self,
            *args: Any,
            alpha: float = 0.0,
            theta0: np.ndarray | None = None,
            loss: str = "mse",
            slope: float = 0.0,
            curvature: float = 0.0,
            **kwargs: Any,
        ):
            super().__init__(*args, **kwargs)
            self.alpha = alpha
            self.theta0 = theta0
            self.slope = slope
            self.curvature = curvature
            self.loss = loss
            self.unit = 1.0  # mean weight of the rows

        def get_loss(self, y_pred: Any, y_true: Any, X: Any = None, training: bool = False) -> Any:
            w = X.get("w") if isinstance(X, dict) else None  # of mean 1 over all rows
            square = ((y_pred - y_true.to(y_pred.device)) ** 2).sum(dim=1)
            value = square.mean() if w is None else (w.to(square.device) * square).mean()
            if training and self.alpha:
                value = value + self.alpha * squared_size(self.module_, self.theta0)
            if training and (self.slope or self.curvature):
                value = value + self.roughness(X["X"], y_pred, w)
            if self.loss == "rmse":
                return torch.sqrt(value)
            return value * len(square) * self.unit if self.loss == "rss" else value

        def roughness(self, x: Any, here: Any, w: Any) -> Any:
            """Weighted mean squared slopes and curvatures, by the same differences as in least squares."""
            x, total = x.to(here.device), 0.0
            for move in CURVATURE_STEP * torch.eye(x.shape[1], dtype=x.dtype, device=x.device):
                up, down = self.module_(x + move), self.module_(x - move)
                square = self.slope * (((up - down) / (2 * CURVATURE_STEP)) ** 2).sum(dim=1)
                square = square + self.curvature * (((up - 2 * here + down) / CURVATURE_STEP**2) ** 2).sum(dim=1)
                total = total + (square if w is None else w.to(square.device) * square).mean()
            return total

        def infer(self, x: Any, **fit_params: Any) -> Any:
            dtype = next(self.module_.parameters()).dtype
            if isinstance(x, dict):
                return super().infer({key: torch.as_tensor(part).to(dtype) for key, part in x.items()}, **fit_params)
            return super().infer(torch.as_tensor(x).to(dtype), **fit_params)

    return [Net]


@cache
def _loops() -> list[type]:
    """Mini-batches and the line search."""
    import torch

    class Batches:
        """Slices of whole tensors: a data loader that gathers single rows costs more than the step itself."""

        def __init__(self, dataset: Any, batch_size: int = -1, shuffle: bool = False, seed: int = 0):
            self.X, self.y = dataset.X, dataset.y
            self.n_rows = len(self.y)
            self.batch_size = self.n_rows if batch_size == -1 else batch_size
            self.generator = np.random.default_rng(seed) if shuffle else None

        def __iter__(self) -> Iterator[Any]:
            if self.batch_size >= self.n_rows:
                yield self.X, self.y
                return
            order = np.arange(self.n_rows) if self.generator is None else self.generator.permutation(self.n_rows)
            for first in range(0, self.n_rows, self.batch_size):
                rows = torch.from_numpy(order[first : first + self.batch_size])
                X = {key: part[rows] for key, part in self.X.items()} if isinstance(self.X, dict) else self.X[rows]
                yield X, self.y[rows]

    class LineSearch(torch.optim.Optimizer):
        """Steepest descent; the rate doubles while it helps and is halved until the loss falls enough (Armijo)."""

        def __init__(self, params: Any, lr: float = 1.0):
            super().__init__(params, {"lr": lr})

        def step(self, closure: Any = None) -> Any:
            with torch.enable_grad():
                before = closure().detach()
            group = self.param_groups[0]
            params = [p for p in group["params"] if p.grad is not None]
            old = [p.detach().clone() for p in params]
            slopes = [p.grad.detach().clone() for p in params]
            steepness = float(sum((g**2).sum() for g in slopes))
            rate = 2.0 * group["lr"]
            for _ in range(40):
                with torch.no_grad():
                    for p, start, g in zip(params, old, slopes):
                        p.copy_(start - rate * g)
                with torch.enable_grad():
                    after = closure().detach()
                if float(after) <= float(before) - 1e-4 * rate * steepness:
                    group["lr"] = rate
                    return before
                rate *= 0.5
                if rate * steepness < 1e-16 * abs(float(before)):  # below rounding: nothing left to gain
                    break
            with torch.no_grad():
                for p, start in zip(params, old):
                    p.copy_(start)
            group["lr"] = rate
            return before

    return [Batches, LineSearch]


@cache
def _classes() -> dict[str, type]:
    """The classes that derive from torch and skorch."""
    found = {kind.__name__: kind for kind in (*_modules(), *_nets(), *_loops())}
    for kind in found.values():  # so that nets pickle: the names are found through __getattr__ below
        kind.__module__, kind.__qualname__ = __name__, kind.__name__
    return found


def __getattr__(name: str) -> Any:
    if name in ("BinaryStep", "Chain", "Net", "Batches", "LineSearch"):
        return _classes()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def write_layers(net: Any, layers: Layers) -> None:
    """Put weights into a net."""
    import torch

    dense = [part for part in net.module_.layers if isinstance(part, torch.nn.Linear)]
    with torch.no_grad():
        for part, w, b in zip(dense, layers.weights, layers.biases):
            part.weight.copy_(torch.from_numpy(np.ascontiguousarray(w.T)))
            part.bias.copy_(torch.from_numpy(np.ascontiguousarray(b)))


def read_layers(net: Any, activations: tuple[str, ...]) -> Layers:
    """The weights of a net as arrays (float64)."""
    import torch

    dense = [part for part in net.module_.layers if isinstance(part, torch.nn.Linear)]
    weights = tuple(part.weight.detach().cpu().numpy().T.astype(float) for part in dense)
    return Layers(weights, tuple(part.bias.detach().cpu().numpy().astype(float) for part in dense), activations)


def build_net(
    layers: Layers,
    *,
    solver: str = "adam",
    dtype: str = "float64",
    device: str = "cpu",
    alpha: float = 0.0,
    theta0: np.ndarray | None = None,
    slope: float = 0.0,
    curvature: float = 0.0,
    loss: str = "mse",
    learning_rate: float = 0.01,
    batch_size: int = -1,
    max_epochs: int = 1,
    fixed: int = 0,
    seed: int = 0,
    options: dict[str, Any] | None = None,
) -> Any:
    """An initialised skorch net with these weights; the torch generator of the caller stays as it is.

    ``fixed`` layers at the bottom are not trained; ``options`` are further parameters of the skorch net.
    """
    import torch

    kinds = _classes()
    name, parameters = OPTIMIZERS[solver]
    settings: dict[str, Any] = {
        "module__sizes": layers.sizes,
        "module__activations": layers.activations,
        "module__dtype": dtype,
        "module__fixed": fixed,
        "optimizer": kinds["LineSearch"] if name is None else getattr(torch.optim, name),
        **{f"optimizer__{key}": value for key, value in parameters.items()},
        "alpha": alpha,
        "theta0": theta0,
        "slope": slope,
        "curvature": curvature,
        "loss": loss,
        "lr": learning_rate,
        "batch_size": batch_size,
        "max_epochs": max_epochs,
        "device": device,
        "train_split": None,
        "iterator_train": kinds["Batches"],
        "iterator_train__shuffle": True,
        "iterator_train__seed": seed,
        "callbacks__print_log": None,
        "callbacks__valid_loss": None,
        "verbose": 0,
        **(options or {}),
    }
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = kinds["Net"](kinds["Chain"], **settings).initialize()
    write_layers(net, layers)
    return net


def train_net(net: Any, X: np.ndarray, Y: np.ndarray, weights: np.ndarray | None, after: Any = None) -> list[float]:
    """Train on (already scaled) rows; ``after(net) -> bool`` is asked after each epoch whether to stop.

    Returns training loss of every epoch.
    """
    import torch
    from skorch.callbacks import Callback

    dtype = next(net.module_.parameters()).dtype
    rows: Any = {"X": torch.as_tensor(X).to(dtype)}
    if weights is not None:
        net.unit = float(weights.mean())
        rows["w"] = torch.as_tensor(weights / net.unit).to(dtype)

    class Ask(Callback):
        """Early stopping by the caller."""

        def on_epoch_end(self, net: Any, **kwargs: Any) -> None:
            if after is not None and after(net):
                raise KeyboardInterrupt

    epochs = len(net.history)
    asked = Ask()
    net.callbacks_.append(("ask", asked))
    try:
        with torch.random.fork_rng(devices=[]):
            net.partial_fit(rows, torch.as_tensor(Y).to(dtype))
    finally:
        net.callbacks_.remove(("ask", asked))
    return [float(row["train_loss"]) for row in net.history[epochs:]]
