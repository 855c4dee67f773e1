"""``check_simulator``: does an object keep the protocol of a simulator?"""

from __future__ import annotations

import inspect
import pickle
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate.physics._simulator import describe


def check_simulator(simulator: Any, U: Any = None, x0: Any = None) -> None:
    """Check that an object keeps the protocol of a simulator.

    Parameters
    ----------
    simulator : object with ``simulate(U, x0=None, t=None)``
    U : array-like (n_samples, n_inputs), optional
        Inputs it can be run with, at least four rows; by default smooth ones around 1 (needs ``simulator.inputs``).
    x0 : array-like (n_states,), optional
        Initial state to run it with.

    Raises
    ------
    AssertionError
        The sentence says which part of the protocol is not kept.

    Notes
    -----
    Checked: shape and finiteness of outputs; arguments are not written; the same call twice gives the same; row k
    depends on ``U[0..k]`` only; ``simulate_batch`` and ``simulate_states`` agree with ``simulate`` where present; and for
    estimators: the constructor only assigns (get_params, clone, repr), pickle.

    Examples
    --------
    >>> from sksurrogate.physics import CallableSimulator
    >>> from sksurrogate.testing import check_simulator
    >>> check_simulator(CallableSimulator(lambda U: 2 * U, inputs=["u"]))
    """
    name = type(simulator).__name__
    assert callable(getattr(simulator, "simulate", None)), f"{name} has no method simulate(U, x0=None, t=None)"
    plant = describe(simulator)
    if U is None:
        assert plant.inputs, f"{name} does not name its inputs: hand check_simulator the inputs U to run it with"
        rows = np.arange(12.0)[:, None]
        U = 1.0 + 0.1 * np.sin(rows + np.arange(len(plant.inputs)))
    inputs = np.array(U, dtype=float)
    assert inputs.ndim == 2 and len(inputs) >= 4, f"U has shape {inputs.shape}, expected (n_samples >= 4, n_inputs)"
    kept = inputs.copy()
    Y = np.array(simulator.simulate(inputs, x0))
    assert np.array_equal(inputs, kept), f"{name}.simulate wrote into U"
    assert Y.ndim == 2 and len(Y) == len(inputs), (
        f"{name}.simulate returned shape {Y.shape}, expected ({len(inputs)}, n_outputs)"
    )
    if plant.outputs:
        assert Y.shape[1] == len(plant.outputs), (
            f"{name} names {len(plant.outputs)} outputs and returns {Y.shape[1]} columns"
        )
    assert np.all(np.isfinite(Y)), (
        f"{name}.simulate returned values that are not finite: raise SimulationDiverged instead"
    )
    again = np.array(simulator.simulate(inputs, x0))
    assert np.array_equal(Y, again), (
        f"{name}.simulate gave something else for the same call: a run must not depend on earlier ones"
    )
    half = len(inputs) // 2
    start = np.asarray(simulator.simulate(inputs[:half], x0))
    size = float(np.max(np.abs(Y))) + 1e-12
    assert np.allclose(start, Y[:half], rtol=1e-6, atol=1e-6 * size), f"{name}: row k depends on inputs after row k"
    _check_optional(simulator, plant, inputs, x0, Y, 1e-6 * size)
    if hasattr(simulator, "get_params"):
        _check_estimator(simulator, inputs, x0, Y)


def _check_optional(simulator: Any, plant: Any, inputs: np.ndarray, x0: Any, Y: np.ndarray, tolerance: float) -> None:
    """``simulate_batch``, ``simulate_states``."""
    name = type(simulator).__name__
    if callable(getattr(simulator, "simulate_batch", None)):
        start = None if x0 is None else np.repeat(np.reshape(np.asarray(x0, dtype=float), (1, -1)), 2, axis=0)
        batch = np.asarray(simulator.simulate_batch(np.stack([inputs, inputs]), start))
        assert batch.shape == (2, *Y.shape), (
            f"{name}.simulate_batch returned shape {batch.shape}, expected {(2, *Y.shape)}"
        )
        assert np.allclose(batch, Y, rtol=1e-6, atol=tolerance), f"{name}.simulate_batch differs from simulate"
    if callable(getattr(simulator, "simulate_states", None)) and plant.access != "trajectory":
        X, dXdt = simulator.simulate_states(inputs, x0)
        expected = (len(inputs), len(plant.states))
        assert np.shape(X) == expected and np.shape(dXdt) == expected, (
            f"{name}.simulate_states returned shapes {np.shape(X)} and {np.shape(dXdt)}, expected {expected} twice"
        )


def _check_estimator(simulator: Any, inputs: np.ndarray, x0: Any, Y: np.ndarray) -> None:
    """Parameters, clone, repr, pickle."""
    name = type(simulator).__name__
    for key, value in simulator.get_params(deep=False).items():
        if inspect.isdatadescriptor(getattr(type(simulator), key, None)):
            continue  # read as what it means for the simulator; the clone below shows that it is kept as given
        assert getattr(simulator, key) is value, f"{name}: the constructor must assign {key} as it is"
    assert isinstance(repr(simulator), str)
    assert np.array_equal(np.asarray(clone(simulator).simulate(inputs, x0)), Y), (
        f"a clone of {name} simulates something else"
    )
    try:
        copy = pickle.loads(pickle.dumps(simulator))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        if "<lambda>" in str(error) or "<locals>" in str(error) or "local object" in str(error):
            return  # a function without a module-level name is the user's choice, not a fault of the simulator
        raise AssertionError(f"{name} does not pickle: {error}") from error
    assert np.array_equal(np.asarray(copy.simulate(inputs, x0)), Y), f"a pickled {name} simulates something else"
