"""The questions of a diagnosis around a simulator that only gives trajectories, in their order."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from sksurrogate.effects._catalogue import build_effects, left_out
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.gap.decide._features import certified
from sksurrogate.gap.decide._generic_correction import generic_correction
from sksurrogate.gap.decide._held_out import HeldOut, measure, same_names
from sksurrogate.gap.decide._trajectory_choice import names_by_fold
from sksurrogate.gap.decide._trajectory_experiment import next_experiment
from sksurrogate.gap.fit._folds import blocked, run_folds
from sksurrogate.gap.fit._trajectory import Around, Trial
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.search._trajectory_search import AroundSearch
from sksurrogate.gap.unnamed._latent_force import Place, repeatable
from sksurrogate.gap.unnamed._trajectory_location import equivalent_places, forces_on_states, left_of, variables
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["AroundQuestions"]


class AroundQuestions:
    """Asks the questions in order; an interrupt leaves what is known."""

    def __init__(self, diagnoser: Any, plant: Plant, runs: Runs, free: tuple[str, ...], seed: int):
        self.plant, self.runs, self.seed = plant, runs, seed
        self.say: Callable[[str], None] = diagnoser._say
        self.correction, self.tolerance = diagnoser.correction, float(diagnoser.tolerance)
        self.effects = list(diagnoser.effects) if isinstance(diagnoser.effects, Iterator) else diagnoser.effects
        wanted = [e for e in build_effects(plant, (), self.effects) if e.access == "trajectory"]
        self.check_asked(wanted)
        record = Record.from_runs([r.X for r in runs], [r.y for r in runs], [r.t for r in runs], runs.dt)
        self.around = Around(plant, record, free, [run.label for run in runs])
        candidates, self.blind = self.testable(wanted)
        self.check_asked(candidates)
        self.search = AroundSearch(self.around, candidates, diagnoser.n_jobs, self.say)
        self.complete = True
        self.uncertified = ""
        self.slots: list[list[tuple[Trial, bool]]] = []
        self.law = np.zeros(1)
        self.force = 0.0
        self.places: list[Place] = []
        self.held: HeldOut | None = None
        self.finals: list[Trial] = []
        self.shrink: Shrink | None = None
        self.shares: list[float] = []
        self.experiment: NextExperiment | None = None

    def check_asked(self, kept: list[BaseEffect]) -> None:
        """Say so where no effect that was asked for can be tested."""
        asked = left_out(self.effects, kept)
        if kept or not asked:
            return
        name = type(self.plant.simulator).__name__
        raise SimulatorError(
            f"effects={asked}: none of them can be tested with {name}, which gives trajectories only; expected one or more on its "
            "inputs (where it answers others than those in X), outputs or parameters, for example effects=['sensor_bias']. "
            "Leave effects out for all of these, or give the simulator rhs or step."
        )

    def testable(self, effects: list[BaseEffect]) -> tuple[list[BaseEffect], list[str]]:
        """Effects that this simulator lets one try, and the names of the others (a table knows its own inputs only)."""
        around = self.around
        try:
            around.simulated(around.record.u * 1.01 + 1e-6, {})
        except SurrogateError:
            kept = [e for e in effects if e.kind != "input"]
            return kept, sorted({e.name for e in effects if e.kind == "input"})
        return effects, []

    # ---- the questions ----------------------------------------------------------------------------------------------
    def ask(self) -> None:
        search, around = self.search, self.around
        self.say(f"{len(search.candidates)} rivals on {around.record.n_samples} samples of {len(self.runs)} run(s)")
        search.fit_null()
        self.say("how far the simulator is from the data: the null is fitted")
        search.run()
        self.starts_again()
        self.say("what these data cannot tell apart")
        self.slots = [search.twins(i) for i in range(len(self.final.effects))]
        search.polish()
        final = self.final
        self.say("what is left")
        self.look_at_what_is_left()
        self.places = equivalent_places(around, search.null or final)
        self.say("how far the gap shrinks on runs left out")
        self.finals = names_by_fold(search, final, self.slots)
        self.held = self.held_out(final)
        self.shrink = measure(self.held, self.floor(), self.plant.outputs, self.seed)
        if final.effects and not certified(self.shrink, left_of(around, final)):
            self.withdraw()
        if self.final.effects:
            self.shares = self.shares_of(self.final, self.shrink.fraction_power)
            self.experiment = next_experiment(self.around, self.final, self.slots)

    @property
    def final(self) -> Trial:
        """The trial that stands."""
        if self.search.final is None:
            raise KeyboardInterrupt("interrupted before the first fit: nothing is known yet")
        return self.search.final

    def starts_again(self) -> None:
        """Where transients explain much of what is left, the simulator starts elsewhere: they become unknowns, once."""
        around, search, final = self.around, self.search, self.final
        if around.free_starts or left_of(around, final) < 1.2:
            return
        before = around.likelihood(final, final.noise or around.first_noise())
        around.free_starts = True
        free = around.estimate(final, final.noise, 8)
        count = around.transients.shape[1] * len(around.record.starts)
        if 2.0 * (free.log_likelihood - before) < 2.0 * search.bar(count):
            around.free_starts = False
            return
        self.say("the runs start elsewhere than the simulator: their initial states are fitted as transients")
        search.fit_null()
        search.run()

    def look_at_what_is_left(self) -> None:
        """Latent force on top of what stands: its size, and whether states and inputs repeat it."""
        around, final = self.around, self.final
        w = forces_on_states(around, final)
        Z, _ = variables(around, final.y)
        size = np.std(w, axis=1)
        self.law = repeatable(around.record, w, size, Z, final.y, self.seed)
        x = np.std(np.diff(around.nominal, axis=1), axis=1) / np.maximum(np.std(around.nominal, axis=1), 1e-300)
        self.force = float(np.max(size) / max(float(np.max(x)), 1e-3))

    def floor(self) -> np.ndarray:
        """Sensor noise."""
        final = self.final
        return final.noise.sigma if final.noise is not None else self.around.sd

    def withdraw(self) -> None:
        """The named effects close too little on runs left out: no name is given; the null stands."""
        names = ", ".join(effect.name for effect in self.final.effects)
        self.uncertified = (
            f"{names} passed the evidence but closed too little of the gap on runs left out; no name is given."
        )
        assert self.search.null is not None and self.held is not None
        self.search.final, self.slots, self.finals = self.search.null, [], []
        self.look_at_what_is_left()
        held = self.held
        after = held.retuned if self.around.free else held.before
        self.held = HeldOut(held.record, held.before, after, held.retuned, held.corrected)
        self.shrink = measure(self.held, self.floor(), self.plant.outputs, self.seed)

    def held_out(self, final: Trial) -> HeldOut:
        """Names and parameters (one linear step) from the other runs, free run with initial states fitted; every fold in turn."""
        around = self.around
        record = blocked(around.record)
        fold = run_folds(record)
        row_fold = fold[record.run_of_row]
        before = around.settled(around.nominal) if around.free_starts else around.nominal
        after = self.left_out(final, row_fold)
        for k, other in enumerate(self.finals):
            if other is not final:
                after[:, row_fold == k] = self.left_out(other, row_fold)[:, row_fold == k]
        retuned = np.full(before.shape, np.nan)
        if self.plant.params:
            tuned = self.retuned_trial()
            retuned = self.left_out(tuned, row_fold, tuned=True) if tuned is not None else before
        corrected = np.full(before.shape, np.nan)
        if not self.blind:  # a table has no answer to blocks of its runs
            correct = generic_correction(self.plant.simulator, self.correction)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                corrected = correct(record, fold)
        return HeldOut(record, before, after, retuned, corrected, same_names(self.finals, final))

    def retuned_trial(self) -> Trial | None:
        """Every parameter re-tuned and nothing else."""
        around = self.around
        free = around.free
        if not free or len(free) < len(self.plant.params):
            around.free = tuple(self.plant.params)
        try:
            return around.fit((), np.zeros(len(around.free)))
        finally:
            around.free = free

    def left_out(self, trial: Trial, row_fold: np.ndarray, tuned: bool = False) -> np.ndarray:
        """Outputs on each fold with parameters from the others."""
        around = self.around
        if not len(trial.theta):
            return around.settled(trial.y) if around.free_starts else trial.y
        free = around.free
        if tuned:
            around.free = tuple(self.plant.params)
        out = np.full(trial.y.shape, np.nan)
        try:
            columns = around.without_starts(
                np.concatenate([(around.record.y - trial.y)[None], trial.J.transpose(1, 0, 2)])
            )
            precision = around.precision(trial.effects, trial.theta)
            low, high = around.bounds(trial.effects)
            for k in np.unique(row_fold):
                train = row_fold != k if len(np.unique(row_fold)) > 1 else np.ones(len(row_fold), bool)
                flat = columns[:, :, train].reshape(len(columns), -1)
                H = flat[1:] @ flat[1:].T + np.diag(precision)
                g = flat[1:] @ flat[0] - precision * trial.theta
                scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
                step = np.linalg.lstsq(H / np.outer(scale, scale), g / scale, rcond=1e-10)[0] / scale
                theta = np.clip(trial.theta + step, low, high)
                near = np.max(np.abs(theta - trial.theta) / np.maximum(np.abs(trial.theta), 1e-3)) < 0.05
                if near:  # the linear picture holds
                    y = trial.y + np.einsum("k,okt->ot", theta - trial.theta, trial.J)
                else:
                    y = around.outputs(trial.effects, theta)
                y = y if np.all(np.isfinite(y)) else trial.y
                out[:, ~train if not train.all() else train] = (around.settled(y) if around.free_starts else y)[
                    :, ~train if not train.all() else train
                ]
        finally:
            around.free = free
        return out

    def shares_of(self, final: Trial, total: float) -> list[float]:
        """Share of the gap's power: what comes back when an effect alone is taken out."""
        if len(final.effects) == 1:
            return [total]
        returned = []
        for i in range(len(final.effects)):
            keep = np.ones(len(final.theta), bool)
            keep[final.slice_of(i)] = False
            rest = tuple(e for j, e in enumerate(final.effects) if j != i)
            cost = self.around.cost_of(self.around.outputs(rest, final.theta[keep]))
            returned.append(max(cost - final.cost, 0.0) if np.isfinite(cost) else final.cost)
        sum_ = sum(returned)
        return [total * value / sum_ if sum_ > 0 else total / len(returned) for value in returned]
