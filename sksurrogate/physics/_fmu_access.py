"""What a unit gives: a right-hand side, a step, or trajectories alone; found out once and believed only when proven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._fmu_events import EventSteps
from sksurrogate.physics._fmu_exchange import ExchangeUnit
from sksurrogate.physics._fmu_signals import Signals, Unfit, read_signals
from sksurrogate.physics._fmu_steps import CoSteps

#: Rows of the run by which a step is proven.
_PROOF_ROWS = 100
#: Largest difference between steps and a run that goes through, relative to the range of a signal: an inner solver that
#: begins anew at each sample departs by its own tolerance.
_SAME = 1e-4

Engine = ExchangeUnit | EventSteps | CoSteps
#: Inputs (n_samples, n_inputs) and names -> their values along a run that goes through, (n_samples, n_names).
Through = Callable[[np.ndarray, list[str]], np.ndarray]


@dataclass(frozen=True)
class Question:
    """What is asked of a unit.

    Attributes
    ----------
    folder : str
    kinds : tuple of str
        Interfaces that may be used.
    wanted : str or None
        Access that is asked for; None: the finest.
    inputs, outputs : tuple of str
    initial : tuple of str or None
    params : tuple of (str, float)
    dt : float
    """

    folder: str
    kinds: tuple[str, ...]
    wanted: str | None
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    initial: tuple[str, ...] | None
    params: tuple[tuple[str, float], ...]
    dt: float


@dataclass(frozen=True, eq=False)
class Access:
    """What a unit gives."""

    kind: str  #: "ModelExchange" or "CoSimulation"
    access: str  #: {"rhs", "step", "trajectory"}
    reasons: tuple[str, ...]  #: Why it is not finer
    signals: Signals | None = None
    start: np.ndarray | None = None  #: (n_states,): the unit's own initial states
    #: Whether outputs depend on the inputs of their own sample. A master of a co-simulation reads them before it sets
    #: these.
    direct: bool = False


def open_engine(found: Access, question: Question, description: Any) -> Engine:
    """An instance that answers for the equations."""
    assert found.signals is not None
    names = tuple(name for name, _ in question.params)
    if found.kind == "CoSimulation":
        return CoSteps(question.folder, description, found.signals, names)
    unit = ExchangeUnit(question.folder, description, found.signals, names)
    return unit if found.access == "rhs" else EventSteps(unit)


def find_access(question: Question, description: Any, through: Through) -> Access:
    """The finest access, or the one that is asked for.

    ``through``: runs the unit for co-simulation from its own start.
    Raises SimulatorError where the access that is asked for is not there; the message says why.
    """
    reasons = []
    for kind in ("ModelExchange", "CoSimulation"):
        if kind not in question.kinds or question.wanted == "trajectory":
            continue
        try:
            if kind == "ModelExchange":
                return _exchanged(question, description)
            return _stepped(question, description, through)
        except Unfit as reason:
            reasons.append(f"{kind}: {reason}")
        except Exception as error:  # whatever a binary and its wrapper raise: it can still be run as a whole
            reasons.append(f"{kind}: {type(error).__name__}: {error}")
    if question.wanted in ("rhs", "step"):
        raise SimulatorError(
            f"access={question.wanted!r}: the unit does not give it ({'; '.join(reasons)}); leave access out for the finest it has."
        )
    kind = "CoSimulation" if "CoSimulation" in question.kinds else "ModelExchange"
    return Access(kind, "trajectory", tuple(reasons) or ('access="trajectory" was asked for',))


def _signals(question: Question, description: Any, kind: str) -> Signals:
    names = [name for name, _ in question.params]
    return read_signals(description, kind, question.inputs, question.outputs, names, question.initial)


def _exchanged(question: Question, description: Any) -> Access:
    """A right-hand side where there are no events, else a step."""
    signals = _signals(question, description, "ModelExchange")
    values = tuple(value for _, value in question.params)
    unit = ExchangeUnit(question.folder, description, signals, tuple(name for name, _ in question.params))
    steps = EventSteps(unit)
    try:
        event = unit.begin(values, signals.start_inputs)
        start = unit.states()
        if not (signals.events or np.isfinite(event) or question.wanted == "step"):
            return Access("ModelExchange", "rhs", (), signals, start)
        if question.wanted == "rhs":
            raise Unfit('it has events, so that it is known by its map from sample to sample: access="step"')
        t = question.dt * np.arange(_PROOF_ROWS)
        for U in _excitations(signals, len(t)):
            X, Y = steps.run(t, U, None, values)
            if np.all(np.isfinite(X)):
                break
        _prove(question, signals, steps, t, U, X, Y, U)
        why = () if question.wanted == "step" else ("ModelExchange: it has events",)
        return Access("ModelExchange", "step", why, signals, start)
    finally:
        steps.close()


def _stepped(question: Question, description: Any, through: Through) -> Access:
    """A step of a unit for co-simulation."""
    if question.wanted == "rhs":
        raise Unfit("a right-hand side needs model exchange")
    if not description.coSimulation.canGetAndSetFMUstate and question.wanted != "step":
        raise Unfit(
            'it offers no copy of its state (canGetAndSetFMUstate); access="step" tries to restart it at every sample'
        )
    signals = _signals(question, description, "CoSimulation")
    known = {variable.name: variable for variable in description.modelVariables}
    for name in signals.states:
        if known[name].initial not in ("exact", "approx") and known[name].causality != "input":
            raise Unfit(f"its state {name!r} cannot be set")
    t = question.dt * np.arange(_PROOF_ROWS)
    names = [*signals.states, *question.outputs]
    for U in _excitations(signals, len(t)):
        try:
            both = through(U, names)
            break
        except SimulatorError:
            if not len(signals.inputs) or not np.any(U - signals.start_inputs):
                raise
    X, Y = both[:, : len(signals.states)], both[:, len(signals.states) :]
    steps = CoSteps(question.folder, description, signals, tuple(name for name, _ in question.params))
    try:
        before = np.concatenate([U[:1], U[:-1]])  # the run shows every row under the inputs that led to it
        _prove(question, signals, steps, t, U, X, Y, before)
        now = steps.outputs(t, X.T, U.T, dict(question.params)).T
        direct = bool(np.any(np.abs(now - Y) > _room(Y)))
    finally:
        steps.close()
    return Access("CoSimulation", "step", ("CoSimulation gives no right-hand side",), signals, X[0], direct)


def _excitations(signals: Signals, n_rows: int) -> list[np.ndarray]:
    """Inputs around their start values, and these alone for a unit that takes no others."""
    u = signals.start_inputs
    wave = 0.1 * np.maximum(np.abs(u), 0.1) * np.sin(0.3 * np.arange(n_rows)[:, None] + np.arange(len(u)))
    return [u + wave, np.tile(u, (n_rows, 1))]


def _prove(
    question: Question, signals: Signals, steps: EventSteps | CoSteps, t: np.ndarray, U: np.ndarray, X: np.ndarray, Y: np.ndarray,
    shown_under: np.ndarray,
) -> None:  # fmt: skip
    """A chain of single steps from the states alone must give the run that went through: else the unit remembers more.

    ``shown_under`` (n_samples, n_inputs) are the inputs under which that run shows its outputs Y.
    """
    params = dict(question.params)
    chain = np.full_like(X, np.nan)
    chain[0] = X[0]
    for k in range(len(t) - 1):
        chain[k + 1] = steps.sample(t[k], chain[k][:, None], U[k][:, None], params, question.dt)[:, 0]
    seen = np.array(steps.outputs(t, chain.T, shown_under.T, params)).T
    for names, found, expected in ((signals.states, chain, X), (question.outputs, seen, Y)):
        wrong = ~(np.abs(found - expected) <= _room(expected))
        if wrong.any():
            k, i = np.argwhere(wrong)[0]
            raise Unfit(
                f"its states {list(signals.states)} do not determine its future: {names[i]!r} at t={t[k]:g} is {expected[k, i]:.6g}, "
                f"{found[k, i]:.6g} when it restarts at every sample{steps_said(steps)}"
            )


def _room(values: np.ndarray) -> np.ndarray:
    """Differences of signals (n_samples, n_signals) that count as none."""
    return np.asarray(_SAME * np.maximum(np.ptp(values, axis=0), 1e-3 * np.max(np.abs(values), axis=0)) + 1e-12)


def steps_said(steps: EventSteps | CoSteps) -> str:
    """What the unit said meanwhile."""
    messages = steps.unit.messages if isinstance(steps, EventSteps) else steps.messages
    return str(messages)
