"""Two simulators compared: what one has that the other lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.gap._diagnose import GapDiagnoser
from sksurrogate.gap.render._report import GapReport
from sksurrogate.physics._simulator import Plant, describe, simulated, units_of

#: Samples that a step is held at least; a line of a multisine has at least twice as many a period.
SHORTEST_HOLD = 4
#: Lines of a multisine, spread evenly over the logarithm of the frequency.
LINES = 12
#: Amplitudes of the runs in turn, over the range: large ones show limits, small ones dry friction and dead zones.
AMPLITUDES = (1.0, 0.5, 0.2)


def steps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Levels between 0 and 1, held for times that are spread evenly over their logarithm."""
    longest = max(n // 4, SHORTEST_HOLD + 1)
    out: list[np.ndarray] = []
    while sum(map(len, out)) < n:
        held = int(np.exp(rng.uniform(np.log(SHORTEST_HOLD), np.log(longest))))
        out.append(np.full(held, rng.uniform()))
    return np.concatenate(out)[:n]


def multisine(rng: np.random.Generator, n: int) -> np.ndarray:
    """Sines of random phases between 0 and 1, from one period in a run to :data:`SHORTEST_HOLD` samples a half."""
    fastest = max(n / (2 * SHORTEST_HOLD), 2.0)
    periods = np.geomspace(1.0, fastest, LINES)
    t = np.arange(n) / n
    wave = np.sin(2 * np.pi * np.outer(periods, t) + rng.uniform(0, 2 * np.pi, (LINES, 1))).sum(axis=0)
    return (wave - wave.min()) / max(float(np.ptp(wave)), 1e-300)


def excitation(
    limits: Sequence[tuple[float, float]], n_runs: int, n_samples: int, rng: np.random.Generator
) -> np.ndarray:
    """Runs of steps and of multisines in turn, at three amplitudes, within limits of every input: (n_runs, n_samples, n_inputs).

    >>> U = excitation([(-1.0, 2.0)], 4, 50, np.random.default_rng(0))
    >>> U.shape, bool(U.min() >= -1.0 and U.max() <= 2.0)
    ((4, 50, 1), True)
    """
    out = np.empty((n_runs, n_samples, len(limits)))
    for run in range(n_runs):
        shape, size = (steps, multisine)[run % 2], AMPLITUDES[(run // 2) % len(AMPLITUDES)]
        for i, (low, high) in enumerate(limits):
            middle = rng.uniform(size / 2, 1 - size / 2)
            out[run, :, i] = low + (high - low) * (middle + size * (shape(rng, n_samples) - 0.5))
    return out


#: A run shorter than this shows hardly more than its first steps.
FEWEST_SAMPLES = 10 * SHORTEST_HOLD


class ComparedRuns(NamedTuple):
    """What a comparison was made of.

    Attributes
    ----------
    X : ndarray (n_samples, n_inputs)
    y : ndarray (n_samples, n_outputs)
        Of the second simulator, with the noise.
    groups : ndarray of int (n_samples,)
    diagnoser : GapDiagnoser
        Fitted; ``augmented_`` is the first simulator with the missing effects.

    Examples
    --------
    >>> from sksurrogate.gap import ComparedRuns
    >>> ComparedRuns._fields
    ('X', 'y', 'groups', 'diagnoser')
    """

    X: np.ndarray
    y: np.ndarray
    groups: np.ndarray
    diagnoser: GapDiagnoser


def compare_simulators(
    a: Any,
    b: Any,
    *,
    limits: Any,
    duration: float,
    n_runs: int = 6,
    noise: float = 1e-3,
    random_state: Any = None,
    return_data: bool = False,
    **settings: Any,
) -> GapReport | tuple[GapReport, ComparedRuns]:
    """Name the effects that simulator ``b`` has and simulator ``a`` lacks.

    Steps and multisines at three amplitudes are made within the limits of the inputs. ``b`` is simulated as the plant, and ``a``
    is diagnosed.

    Parameters
    ----------
    a : simulator
        The one that may lack something; with a right-hand side or a step every effect can be named.
    b : simulator
        The one that may have it: ``simulate`` is enough. Its signals are found by the names of those of ``a``, else by position.
    limits : dict of (low, high), or sequence of (low, high)
        Range of every input of ``a``, by name or in their order.
    duration : float
        Of one run, in the unit of ``a.dt``.
    n_runs : int, default=6
    noise : float, default=1e-3
        White noise that is added to every output of ``b``, over its standard deviation: smaller differences do not count.
    random_state : int, RandomState or None, default=None
    return_data : bool, default=False
        Return the runs and the diagnoser too.
    **settings
        Of :class:`GapDiagnoser`, for instance ``free_params`` or ``effects``.

    Returns
    -------
    report : GapReport
    data : ComparedRuns
        Where ``return_data`` is true.

    Raises
    ------
    SimulatorError
        Signals or sample times of both do not fit.
    DataError
        ``limits``, ``duration``, ``n_runs`` or ``noise`` cannot be.

    Examples
    --------
    >>> from sksurrogate.gap import compare_simulators
    >>> from sksurrogate.physics import ODESimulator
    >>> def linear(t, x, u, p):
    ...     return [u[0] - x[0]]
    >>> def rough(t, x, u, p):
    ...     return [u[0] - x[0] - 0.3 * x[0] ** 3]
    >>> names = {"states": ["level"], "inputs": ["flow"], "outputs": ["level"], "params": {}, "dt": 0.1}
    >>> report = compare_simulators(
    ...     ODESimulator(linear, **names), ODESimulator(rough, **names), limits={"flow": (-2, 2)}, duration=15.0,
    ...     effects=["constant_bias", "linear_loss", "cubic_stiffness"], random_state=0,
    ... )
    >>> report.verdict, report.effects[0].name
    ('explained', 'cubic_stiffness')
    """
    first, second = describe(a), describe(b)
    _check_numbers(n_runs, noise)
    n_samples = _samples(first, second, duration)
    own_inputs, own_outputs = _places(first, second, "inputs"), _places(first, second, "outputs")
    _check_alike(first, second, own_inputs, own_outputs)
    random = check_random_state(random_state)
    rng = np.random.default_rng(random.randint(2**31 - 1))
    U = excitation(_limits(limits, first.inputs), int(n_runs), n_samples, rng)
    Y = np.stack([simulated(b, u[:, own_inputs]).reshape(n_samples, -1)[:, own_outputs] for u in U])
    if not np.isfinite(Y).all():
        raise SimulatorError(
            f"b={type(b).__name__} does not stay finite within limits={limits!r}: narrow them, or shorten duration={duration:g}."
        )
    y = Y.reshape(-1, Y.shape[2])
    y = y + noise * np.std(y, axis=0) * rng.normal(size=y.shape)
    X, groups = U.reshape(-1, U.shape[2]), np.repeat(np.arange(len(U)), n_samples)
    diagnoser = GapDiagnoser(a, random_state=random.randint(2**31 - 1), **settings).fit(X, y, groups=groups)
    return (diagnoser.report_, ComparedRuns(X, y, groups, diagnoser)) if return_data else diagnoser.report_


def _check_alike(first: Plant, second: Plant, own_inputs: Sequence[int], own_outputs: Sequence[int]) -> None:
    """Signals that both give a unit, and how both hold their inputs, are the same: else the difference would be named as an effect."""
    units = units_of(first.simulator), units_of(second.simulator)
    pairs = [(first.inputs[i], name) for i, name in zip(own_inputs, second.inputs)]
    pairs += [(name, second.outputs[i]) for name, i in zip(first.outputs, own_outputs)]
    pairs.append(("time", "time"))
    for ours, theirs in pairs:
        both = units[0].get(ours), units[1].get(theirs)
        if None not in both and both[0] != both[1]:
            raise SimulatorError(f"{ours!r} is in {both[0]} in a and in {both[1]} in b: give both one unit.")
    if hasattr(second.simulator, "hold") and first.hold != second.hold:
        raise SimulatorError(
            f"a takes its inputs with hold={first.hold!r}, b with hold={second.hold!r}: give both one, set_params(hold=...)."
        )


def _check_numbers(n_runs: Any, noise: Any) -> None:
    """Numbers that no comparison can be made of."""
    if isinstance(n_runs, bool) or not isinstance(n_runs, Integral) or n_runs < 1:
        raise DataError(f"n_runs={n_runs!r}: expected a positive integer; write n_runs=6.")
    if not isinstance(noise, Real) or not 0.0 < float(noise) < 1.0:
        raise DataError(
            f"noise={noise!r}: expected a share of the outputs' deviation between 0 and 1; write noise=1e-3."
        )


def _samples(first: Plant, second: Plant, duration: Any) -> int:
    """Samples of one run."""
    if second.dt and not np.isclose(first.dt, second.dt, rtol=1e-6, atol=0.0):
        raise SimulatorError(
            f"a has the sample time dt={first.dt:g}, b has dt={second.dt:g}: give both one, set_params(dt={first.dt:g})."
        )
    if not isinstance(duration, Real) or not 0.0 < float(duration) < np.inf:
        raise DataError(f"duration={duration!r}: expected the length of a run above 0, in the unit of dt.")
    n_samples = round(float(duration) / first.dt) + 1
    if n_samples < FEWEST_SAMPLES:
        raise DataError(
            f"duration={duration:g} is {n_samples} samples of dt={first.dt:g}, expected {FEWEST_SAMPLES} at least: write "
            f"duration={FEWEST_SAMPLES * first.dt:g} or more."
        )
    return n_samples


def _places(first: Plant, second: Plant, what: str) -> list[int]:
    """Inputs of ``a`` in the order of ``b``, or outputs of ``b`` in the order of ``a``: by name, else by position."""
    ours, theirs = getattr(first, what), getattr(second, what)
    if what == "inputs":
        ours, theirs = theirs, ours
    if set(ours) <= set(theirs):
        return [theirs.index(name) for name in ours]
    if len(ours) == len(theirs) or not ours or not theirs:  # names are made up where a simulator has none
        return list(range(max(len(ours), len(theirs))))
    raise SimulatorError(
        f"a has {what} {list(getattr(first, what))}, b has {list(getattr(second, what))}: give them the same names, or as many."
    )


def _limits(limits: Any, inputs: Sequence[str]) -> list[tuple[float, float]]:
    """(low, high) of every input."""
    if isinstance(limits, Mapping):
        unknown, missing = [n for n in limits if n not in inputs], [n for n in inputs if n not in limits]
        if unknown or missing:
            wrong = f"{unknown[0]!r} is not an input of a" if unknown else f"the input {missing[0]!r} is missing"
            raise DataError(f"limits={limits!r}: {wrong}; expected (low, high) for each of {list(inputs)}.")
        pairs = [limits[name] for name in inputs]
    else:
        pairs = list(limits) if isinstance(limits, Sequence | np.ndarray) else []
        if len(pairs) != len(inputs):
            raise DataError(
                f"limits={limits!r}: expected (low, high) for each of the inputs {list(inputs)}, in a dict."
            )
    out = []
    for name, pair in zip(inputs, pairs):
        try:
            low, high = (float(end) for end in pair)
        except (TypeError, ValueError):
            low, high = np.nan, np.nan
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise DataError(f"limits[{name!r}]={pair!r}: expected (low, high) with low < high, finite.")
        out.append((low, high))
    return out
