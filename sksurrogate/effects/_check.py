"""``check_effect``: does an effect keep the contract of :class:`~sksurrogate.effects.BaseEffect`?"""

from __future__ import annotations

import inspect
import pickle
from typing import Any, cast

import numpy as np
from sklearn.base import clone

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import check_place
from sksurrogate.effects._model import AugmentedModel, BoundModel
from sksurrogate.effects._parts import Probe
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.effects._variable import value_of
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._simulator import Plant, describe


def _tanks(t: Any, x: Any, u: Any, p: Any) -> tuple[Any, Any]:
    """Two heated tanks one behind the other: states and outputs stay positive."""
    upper, lower = x
    return (
        p["gain"] * u[0] - p["outflow"] * upper + p["back"] * (lower - upper),
        p["outflow"] * upper - p["outflow"] * lower + p["gain"] * u[1],
    )


def _default_plant() -> ODESimulator:
    """Two states, two inputs, two outputs."""
    return ODESimulator(
        _tanks,
        states=["upper", "lower"],
        inputs=["first", "second"],
        outputs=["upper", "lower"],
        params={"gain": 1.0, "outflow": 0.8, "back": 0.3},
        dt=0.1,
        x0=[1.0, 0.5],
    )


def check_effect(effect: BaseEffect | type[BaseEffect], simulator: Any = None) -> None:
    """Check that an effect keeps its contract, on a simulator with a right-hand side.

    Parameters
    ----------
    effect : subclass of BaseEffect, or an instance
        An instance with a location is checked there, otherwise every place and variable of the simulator is tried.
    simulator : object, optional
        With ``rhs``; by default two tanks with states and outputs "upper" and "lower", inputs "first" and "second",
        parameters "gain", "outflow" and "back".

    Raises
    ------
    AssertionError
        The sentence says which part of the contract is not kept, and where.

    Notes
    -----
    Checked: name and parameters are declared; the constructor only assigns (clone, pickle, repr); the null value gives
    the simulator back; candidates computed at once in columns equal the same one by one; arguments are not written;
    starting values are finite, within their bounds, and change something; the change is in proportion to the magnitude
    where ``linear`` says so.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE
    >>> from sksurrogate.testing import check_effect
    >>> check_effect(CATALOGUE["coulomb_friction"])
    """
    given = cast("BaseEffect | None", effect if isinstance(effect, BaseEffect) else None)
    cls: Any = effect if given is None else type(given)
    assert issubclass(cls, BaseEffect), f"{cls.__name__} is not a subclass of BaseEffect"
    _check_declaration(cls)
    plant = describe(_default_plant() if simulator is None else simulator)
    assert plant.access == "rhs", f"check_effect needs a simulator with rhs and states, got {plant.simulator!r}"
    model = PlantModel(plant)
    if given is not None and given.location is not None:
        check_place(given, plant)
        instances = [given]
    else:
        balances = [name for name in plant.states if name not in kinematic_states(model)]
        instances = list(cls.instances(plant, balances))
        assert instances, f"{cls.__name__}.instances() finds no place in {plant.simulator!r}: give another simulator"
    record, X = _experiment(plant)
    for one in instances:
        _check_estimator(one)
        _check_on(one, plant, model, record, X)


def _check_declaration(cls: type[BaseEffect]) -> None:
    """Class attributes."""
    who = cls.__name__
    assert not inspect.isabstract(cls), f"{who} lacks {sorted(cls.__abstractmethods__)}"
    assert isinstance(cls.name, str) and cls.name, f"{who}.name must be a non-empty str"
    assert cls.kind in ("parameter", "state", "input", "output"), (
        f"{who}.kind={cls.kind!r}: subclass one of the families"
    )
    assert cls.access in ("trajectory", "step"), f'{who}.access={cls.access!r} must be "trajectory" or "step"'
    names = [parameter.name for parameter in cls.parameters]
    assert len(set(names)) == len(names), f"{who}.parameters has a name twice: {names}"
    for parameter in cls.parameters:
        inside = parameter.low <= parameter.null <= parameter.high
        assert inside, (
            f"{who}: null {parameter.null} of {parameter.name!r} is not in [{parameter.low}, {parameter.high}]"
        )
    assert cls.equation, f"{who}.equation is empty: write the form in words, for example '- c sign(v)'"


def _check_estimator(effect: BaseEffect) -> None:
    """Clone, pickle, repr."""
    own = effect.get_params()
    assert clone(effect).get_params() == own, f"clone({effect!r}) differs"
    assert pickle.loads(pickle.dumps(effect)).get_params() == own, f"{effect!r} does not survive pickle"
    assert type(effect).__name__ in repr(effect), f"repr of {type(effect).__name__} does not name it"


def _experiment(plant: Plant) -> tuple[Record, np.ndarray]:
    """Two runs of 40 samples with inputs of both signs held for four samples; their states (n_states, n_samples)."""
    random = np.random.default_rng(0)
    n = 40
    U = [np.repeat(0.3 + random.normal(size=(n // 4, len(plant.inputs))), 4, axis=0) for _ in range(2)]
    t = plant.dt * np.arange(n)
    X0 = [plant.x0 + spread * np.maximum(np.abs(plant.x0), 0.1) for spread in (0.0, 0.2)]
    Y = [np.zeros((n, len(plant.outputs)))] * 2
    record = Record.from_runs(U, Y, [t, t], plant.dt)
    whole = AugmentedModel(PlantModel(plant), (), (), record, n_sub=2, scale=np.ones(len(plant.states)))
    bound = whole.bind(np.zeros((0, 1)))
    X = np.empty((len(plant.states), record.n_samples))
    x = np.stack(X0, axis=1)[:, None]
    for k in range(n):
        X[:, record.starts + k] = x[:, 0]
        x = bound(x, record.starts + k)
    assert np.all(np.isfinite(X)), f"{plant.simulator!r} diverges under a random input: give a stable simulator"
    return record, X


def _probe(effect: BaseEffect, plant: Plant, record: Record, X: np.ndarray, Y: np.ndarray) -> Probe:
    """What the experiment shows at the place of the effect."""
    states, inputs, outputs = dict(zip(plant.states, X)), dict(zip(plant.inputs, record.u)), dict(zip(plant.outputs, Y))
    signals = {**inputs, **{"input": {}, "output": outputs}.get(effect.kind, states)}
    factors = tuple(signals[name] for name in effect.signals)
    x = signals.get(str(effect.location), X[0])
    v = value_of(effect.variable, factors) if factors else (x if effect.kind in ("input", "output") else None)
    rate = float(np.sqrt(np.mean(np.gradient(x, record.dt) ** 2))) if effect.kind == "state" else 0.0
    return Probe(v, x, rate, record.dt, record.dt * 40, record.starts, factors if len(factors) == 2 else ())


def _check_on(effect: BaseEffect, plant: Plant, model: PlantModel, record: Record, X: np.ndarray) -> None:
    """Null, columns, starting values, proportion at one place."""
    who = f"{effect!r}: "
    scale = np.maximum(np.std(X, axis=1), 1e-9)
    bare = AugmentedModel(model, (), (), record, n_sub=2, scale=scale).bind(np.zeros((0, 1)))
    whole = AugmentedModel(model, (effect,), (), record, n_sub=2, scale=scale)
    x = np.zeros((whole.n_states, 1, record.n_samples))
    x[: len(X)] = X[:, None]
    before, Y = bare(X[:, None]), bare.outputs(X[:, None])
    starts = effect.starts(_probe(effect, plant, record, X, Y[:, 0]))
    null = np.array([[parameter.null] for parameter in effect.parameters]).reshape(-1, 1)
    if effect.parameters:
        states, readings = _results(whole.bind(null), x, len(X))
        off = max(_distance(states, before), _distance(readings, Y))
        assert off < 1e-8, f"{who}its null value {null.ravel().tolist()} changes the simulator by {off:.2g}"
    for theta in starts:
        numbers = len(theta) == len(effect.parameters)
        assert numbers, f"{who}starts() gives {theta}, expected {[p.name for p in effect.parameters]}"
        fits = all(np.isfinite(c) and p.low <= c <= p.high for c, p in zip(theta, effect.parameters))
        assert fits, f"{who}starts() gives {theta}, which is not finite or not within the bounds"
    if not starts or not effect.parameters:
        return
    stretched = [(effect.parameters[0].null + 0.7 * (c - effect.parameters[0].null), *rest) for c, *rest in starts[:1]]
    finite = [theta for theta in stretched if np.all(np.isfinite(theta))]
    columns = np.array([*starts[:6], *finite]).T
    given = x.repeat(columns.shape[1], axis=1)
    kept = given.copy()
    together = _results(whole.bind(columns), given, len(X))
    assert np.array_equal(given, kept), f"{who}it writes into its arguments"
    for k in range(columns.shape[1]):
        alone = _results(whole.bind(columns[:, k : k + 1]), x, len(X))
        off = max(_distance(a[:, k : k + 1], b) for a, b in zip(together, alone))
        assert off < 1e-9, (
            f"{who}column {k} of several differs from the same alone by {off:.2g}: parameters are (n_columns, 1)"
        )
    hidden = whole.n_states > len(X)
    moved = max(_distance(together[0], before), _distance(together[1], Y))
    assert hidden or moved > 1e-9, f"{who}none of its starting values changes anything"
    if effect.linear and not hidden:
        _check_proportion(effect, whole, x, (before, Y), starts[0])


def _check_proportion(
    effect: BaseEffect, whole: AugmentedModel, x: np.ndarray, nominal: tuple[np.ndarray, ...], start: tuple[float, ...]
) -> None:
    """Twice the magnitude, twice the change."""
    magnitude = effect.parameters[0].null + 1e-3 * (start[0] - effect.parameters[0].null) * np.array([1.0, 2.0])
    theta = np.array([magnitude, *(np.full(2, value) for value in start[1:])])
    for result, bare in zip(_results(whole.bind(theta), x.repeat(2, axis=1), len(nominal[0])), nominal):
        once, twice = result[:, 0] - bare[:, 0], result[:, 1] - bare[:, 0]
        off = float(np.max(np.abs(twice - 2 * once)))
        close = off <= 0.05 * float(np.max(np.abs(twice))) + 1e-12
        assert close, f"{effect!r}: linear=True, but twice the magnitude is not twice the change"


def _results(bound: BoundModel, x: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The nominal states one sample later, and the readings."""
    return bound(x)[:n], bound.outputs(x)


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference over the size of ``b``; inf where not finite."""
    off = np.max(np.abs(a - b)) / max(float(np.max(np.abs(b))), 1e-12)
    return float(off) if np.isfinite(off) else np.inf
