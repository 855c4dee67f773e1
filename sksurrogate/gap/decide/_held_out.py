"""How far the gap shrinks on runs left out: chosen and refitted on the others; beside it re-tuning alone, and a generic correction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import name_of
from sksurrogate.gap.decide._generic_correction import Correction
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import BEYOND_CHANCE
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._record_parts import blocked, run_folds
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.kernels.record import Record


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Free runs on runs left out of the choice of the names and of the refit of the parameters."""

    record: Record  #: Runs, or the blocks of the one run
    #: before, after, retuned, corrected: (n_outputs, n_samples): free runs of the simulator, with the effects, with
    #: parameters re-tuned only, with the generic correction; nan without
    before: np.ndarray
    after: np.ndarray
    retuned: np.ndarray
    corrected: np.ndarray
    same_names: float = float("nan")  #: Share of the folds whose other runs choose the effects that all runs choose
    law: np.ndarray | None = None  #: (n_outputs, n_samples): with a law without a name


def without_names(null: BaseCandidate, correction: Correction | None = None) -> HeldOut:
    """Free runs on runs left out of what needs no name: the simulator, ``after`` as ``before``, re-tuning alone, a generic correction."""
    record = blocked(null.problem.record)
    folds = run_folds(record)
    n_folds = int(folds.max()) + 1
    nominal, tuned = null.baselines(record)
    before = _by_fold(record, [nominal] * n_folds)
    lost = ~np.isfinite(before)
    before[lost] = np.repeat(record.level[:, None], record.n_samples, axis=1)[lost]
    retuned = _or_else(_by_fold(record, [tuned] * n_folds), before)
    corrected = np.full_like(before, np.nan) if correction is None else correction(record, folds)
    return HeldOut(record, before, before, retuned, corrected)


def held_out(finals: Sequence[BaseCandidate], without: HeldOut, same_names: float = float("nan")) -> HeldOut:
    """Refit on all runs but those of one fold, free run there with fitted initial states; every fold in turn.

    ``finals`` are the candidates that the other runs of each fold choose (`names_by_fold`).
    """
    after = _or_else(_by_fold(without.record, finals), without.before)
    return replace(without, after=after, same_names=same_names)


def law_held_out(finals: Sequence[BaseCandidate], held: HeldOut) -> HeldOut:
    """The same with a law: refitted on all runs but those of one fold, free run there; every fold in turn."""
    return replace(held, law=_or_else(_by_fold(held.record, finals), held.before))


def likelier_held_out(final: Evidence, held: HeldOut) -> bool:
    """Whether runs left out are likelier with the names than without, under the noise of the names."""
    disturbance, residual = final.candidate.disturbance.in_runs_from(held.record.starts), held.record.residual
    after, before = (disturbance.log_likelihood(residual(y), final.noise) for y in (held.after, held.before))
    return bool(after >= before)


def _by_fold(record: Record, candidates: Sequence[BaseCandidate | None]) -> np.ndarray:
    """Outputs on the runs of every fold, of its candidate refitted on the others; nan where it gives none."""
    fold = run_folds(record)
    out = np.full(record.y.shape, np.nan)
    for k, candidate in enumerate(candidates):
        test, train = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        predicted = candidate.left_out(record, train, test) if candidate is not None else None
        if predicted is not None:
            out[:, np.isin(record.run_of_row, test)] = predicted
    return out


def _or_else(predicted: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Samples without a finite prediction are those of the simulator."""
    return np.where(np.isfinite(predicted).all(axis=0), predicted, before)


@dataclass(frozen=True, eq=False)
class _Gaps:
    """Squared errors of free runs, and the gap above the noise where every run counts as often as it was drawn."""

    powers: dict[str, np.ndarray]  #: (n_runs, n_outputs): by kind of free run, in units of the outputs' variances
    counts: np.ndarray  #: (n_runs, n_outputs): measured values
    noise: np.ndarray  #: (n_outputs,): its power in the same units

    @classmethod
    def of(cls, held: HeldOut, floor: np.ndarray) -> _Gaps:
        """Of all kinds of free runs that there are."""
        record, spread = held.record, held.record.spread[:, None]
        runs = {"before": held.before, "after": held.after, "retuned": held.retuned, "corrected": held.corrected}
        runs |= {} if held.law is None else {"law": held.law}
        squares = {name: (record.residual(y) / spread) ** 2 for name, y in runs.items()}
        powers = {name: np.add.reduceat(square, record.starts, axis=1).T for name, square in squares.items()}
        return cls(powers, record.counts, (floor / record.spread) ** 2)

    def mean_square(self, name: str, drawn: np.ndarray) -> np.ndarray:
        """Of every output over its measured values; nan without any."""
        count = drawn @ self.counts
        return (drawn @ self.powers[name]) / np.where(count > 0, count, np.nan)

    def gap(self, name: str, drawn: np.ndarray) -> float:
        """RMS above the noise, all outputs together."""
        mean = _mean_of_known(self.mean_square(name, drawn), drawn @ self.counts)
        return float(np.sqrt(max(mean - float(np.mean(self.noise)), 0.0))) if np.isfinite(mean) else np.nan

    def closed(self, name: str, drawn: np.ndarray, power: int = 1) -> float:
        """Share of the gap that is closed, in amplitude, or in power where that is 2; nan without a gap."""
        before = self.gap("before", drawn)
        return float(1.0 - (self.gap(name, drawn) / before) ** power) if name in self.powers and before > 0 else np.nan


def measure(held: HeldOut, floor: np.ndarray, outputs: tuple[str, ...], random_state: int) -> Shrink:
    """Errors before and after, above the floor, with a bootstrap over runs.

    ``floor`` (n_outputs,): sensor noise.
    """
    record, gaps = held.record, _Gaps.of(held, floor)
    spread, n_runs, noise = record.spread, len(record.starts), float(np.mean(gaps.noise))
    draws = np.random.default_rng(random_state).integers(0, n_runs, size=(400, n_runs))
    samples = [gaps.closed("after", np.bincount(draw, minlength=n_runs).astype(float)) for draw in draws]
    finite = np.array([value for value in samples if np.isfinite(value)])
    interval = (
        (float(np.quantile(finite, 0.05)), float(np.quantile(finite, 0.95))) if len(finite) > 20 else (np.nan, np.nan)
    )
    once = np.ones(n_runs)
    counts = once @ record.counts
    squares = {name: gaps.mean_square(name, once) for name in gaps.powers}
    rmse = {name: np.sqrt(_mean_of_known(values, counts)) for name, values in squares.items()}
    # A mean square of n white values has the variance 2 sigma^4 / n.
    spread_of_noise = noise * np.sqrt(2.0 / record.n_values)
    excess = _mean_of_known(squares["before"] - gaps.noise, counts)
    return Shrink(
        before=rmse["before"],
        after=rmse["after"],
        floor=float(np.sqrt(noise)),
        fraction=gaps.closed("after", once),
        interval=interval,
        by_output=_by_output(outputs, np.sqrt(squares["before"]) * spread, np.sqrt(squares["after"]) * spread, floor),
        after_retuning=rmse["retuned"],
        fraction_retuning=gaps.closed("retuned", once),
        after_correction=rmse["corrected"],
        fraction_correction=gaps.closed("corrected", once),
        fraction_power=gaps.closed("after", once, 2),
        measurable=bool(excess > BEYOND_CHANCE * spread_of_noise),
        same_names=held.same_names,
        after_law=rmse.get("law", np.nan),
        fraction_law=gaps.closed("law", once),
        fraction_power_law=gaps.closed("law", once, 2),
    )


def _mean_of_known(values: np.ndarray, counts: np.ndarray) -> float:
    """Mean over the outputs of which anything was measured; nan without any."""
    known = counts > 0
    return float(np.mean(values[known])) if known.any() else float("nan")


def shares(final: BaseCandidate, total: float) -> tuple[list[float], float]:
    """Shares of the gap's power of every effect, and of the re-tuning: what comes back when each alone is taken out."""
    n, free = len(final.effects), bool(final.problem.free)
    if n == 1 and not free:
        return [total], 0.0
    rests = [*(final.taken_out(i) for i in range(n)), *([final.at_nominal()] if free else [])]
    returned = [max(rest.fit.cost - final.fit.cost, 0.0) if rest is not None else final.fit.cost for rest in rests]
    sum_ = sum(returned)
    parts = [total * value / sum_ if sum_ > 0 else total / len(returned) for value in returned]
    return parts[:n], float(sum(parts[n:]))


def _by_output(outputs: tuple[str, ...], before: np.ndarray, after: np.ndarray, floor: np.ndarray) -> Table:
    """One row an output: RMS errors, floor, and the share of the gap above the floor that is closed."""
    rows = []
    for name, b, a, f in zip(outputs, before, after, floor):
        gap_b, gap_a = np.sqrt(max(b**2 - f**2, 0.0)), np.sqrt(max(a**2 - f**2, 0.0))
        closed = 1 - gap_a / gap_b if gap_b > 0 else np.nan
        rows.append({"output": name, "before": float(b), "after": float(a), "floor": float(f), "fraction": closed})
    return Table(tuple(rows))


def traces(held: HeldOut | None, labels: Sequence[Any], lawful: bool) -> tuple[Trace, ...]:
    """All held-out runs for the eye, in the order of the data; ``lawful``: with the law too."""
    if held is None:
        return ()
    record = held.record
    t = record.t if record.offset is None else record.t + record.offset
    measured = np.stack([record.readings(j) for j in range(len(record.y))])
    law = held.law if lawful else None
    drawn = [measured, held.before, held.after, record.u, *([] if law is None else [law])]
    return tuple(
        Trace(label, t[a:b], *(values[:, a:b].T for values in drawn))
        for label, (a, b) in zip(pieces(record, labels), record.spans)
    )


def pieces(record: Record, labels: Sequence[Any]) -> list[Any]:
    """Labels of the runs; numbers of the blocks where runs were cut."""
    return list(labels) if len(record.starts) == len(labels) else list(range(len(record.starts)))


def same_names(finals: Sequence[Any], final: Any) -> float:
    """Share of the folds whose other runs choose what all runs choose; nan without a name."""
    return float(np.mean([candidate is final for candidate in finals])) if final.effects else float("nan")


def notes_on_names(
    finals: Sequence[Sequence[BaseEffect]], final: Sequence[BaseEffect], held: HeldOut | None, labels: Sequence[Any]
) -> list[str]:
    """Which parts of the data choose other effects than all of them do."""
    if held is None:
        return []
    record, fold = held.record, run_folds(held.record)
    kind = "run" if len(record.starts) == len(labels) else "block"
    named: dict[str, list[str]] = {}
    for k, effects in enumerate(finals):
        if effects is not final:
            left_out = [repr(label) for label, f in zip(pieces(record, labels), fold) if f == k]
            named.setdefault(" and ".join(map(name_of, effects)), []).extend(left_out)
    listed = "; ".join(f"without {kind} {', '.join(left)} {names}" for names, left in named.items())
    text = f"Some folds choose other effects, and the error on held-out {kind}s counts these there: {listed}."
    return [text] if listed else []
