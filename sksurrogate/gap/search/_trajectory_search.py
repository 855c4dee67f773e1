"""The search of a diagnosis whose simulator only gives trajectories: screen, fit, evidence, forward and backward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from joblib import Parallel, delayed

from sksurrogate.effects._effect import BaseEffect, Probe
from sksurrogate.gap.fit._evidence import bar
from sksurrogate.gap.fit._trajectory import Around, Trial

__all__ = ["EQUAL", "AroundSearch"]

#: Most effects named at once.
MOST_EFFECTS = 3
#: Rivals fitted in a round: so many by white noise, so many by the noise with forces.
BY_WHITE, BY_FORCED = 10, 6
#: Rivals whose own noise is estimated.
ESTIMATED = 6
#: Rivals that the screen expects to gain less than this share of the bar are not fitted.
HOPELESS = 0.15
#: A further effect must beat its bar by this.
FURTHER = 10.0
#: Twice the difference of log likelihoods within which two rivals are one class.
EQUAL = 6.0


@dataclass(eq=False)
class AroundSearch:
    """Null, then effects one by one.

    Attributes
    ----------
    around : Around
    candidates : list of BaseEffect
    n_jobs : int or None
    say : callable
    null, final : Trial
    first_round : list of Trial
    rivals : list of Trial
        What was fitted in the places of the effects that stand.
    expected : dict
        Key of an effect -> what the screen expects of it.
    """

    around: Around
    candidates: list[BaseEffect]
    n_jobs: int | None
    say: Callable[[str], None]
    null: Trial | None = None
    final: Trial | None = None
    first_round: list[Trial] = field(default_factory=list)
    rivals: list[Trial] = field(default_factory=list)
    expected: dict = field(default_factory=dict)
    stopped: bool = False

    @property
    def n_values(self) -> int:
        """Measured numbers."""
        return self.around.record.y.size

    def bar(self, k: int) -> float:
        """What twice the gain in log likelihood must exceed."""
        return bar(k, len(self.candidates), self.n_values)

    def fit_null(self) -> None:
        """The simulator with initial states and free parameters only."""
        around = self.around
        for _ in range(2 if around.x0 is not None else 0):
            around.start_again()
        null = around.fit((), np.zeros(len(around.free)))
        if null is None:
            null = Trial(
                (), np.zeros(len(around.free)), np.zeros_like(around.record.y), np.zeros((len(around.sd), 0, 1)), np.inf
            )
        self.null = self.final = around.estimate(null)

    def run(self) -> None:
        """Forward, with what stands re-chosen after every step; an interrupt is passed on once what is fitted is compared."""
        self._forward()
        if self.stopped:
            raise KeyboardInterrupt

    def _forward(self) -> None:
        """Effects one by one."""
        assert self.null is not None
        best = self.null
        while len(best.effects) < MOST_EFFECTS and not self.stopped:
            found = self.expand(best)
            if not best.effects:
                self.first_round = found
            passes = [f for f in found if self.gain(f, best) > self.bar(f.n_parameters - best.n_parameters)]
            if not passes:
                break
            new = max(passes, key=self.score)
            if best.effects and self.gain(new, best) < self.bar(new.n_parameters - best.n_parameters) + FURTHER:
                break
            if best.effects and not self.stopped:
                new = self.swapped(new)
            best = self.final = new
            self.say(f"{', '.join(e.name for e in best.effects)}: evidence {self.gain(best, self.null):.0f}")

    def polish(self) -> None:
        """What stands again, with the transients of the initial states at its own values."""
        around, final = self.around, self.final
        if final is None or around.x0 is None or not len(final.theta):
            return
        before, transients = around.x0, around.transients
        for _ in range(2):
            around.refresh(final.effects, final.theta)
            around.start_again(final.effects, final.theta)
            again = around.fit(final.effects, final.theta)
            if again is None or again.cost > 1.01 * final.cost:
                around.x0, around.transients = before, transients
                return
            final = again
        # The others are compared from the same initial states.
        self.final = around.estimate(final, (self.final or final).noise, 8)

    def score(self, trial: Trial) -> float:
        """Log likelihood with the price of parameters."""
        return trial.log_likelihood - 0.5 * trial.n_parameters * np.log(self.n_values)

    @staticmethod
    def gain(trial: Trial, base: Trial) -> float:
        """Twice the gain in log likelihood."""
        return 2.0 * (trial.log_likelihood - base.log_likelihood)

    def swapped(self, trial: Trial) -> Trial:
        """Every effect but the last re-chosen with the others kept."""
        for i in range(len(trial.effects) - 1):
            rest = self.without(trial, i)
            if rest is None:
                continue
            found = self.expand(rest)
            if found and max(map(self.score, found)) > self.score(trial) + 1.0:
                trial = max(found, key=self.score)
        return trial

    def without(self, trial: Trial, i: int) -> Trial | None:
        """A trial with effect i left out, fitted and with its own noise."""
        keep = np.ones(len(trial.theta), bool)
        keep[trial.slice_of(i)] = False
        effects = tuple(e for j, e in enumerate(trial.effects) if j != i)
        if not effects:
            return self.null
        found = self.around.fit(effects, trial.theta[keep], trial.J.transpose(1, 0, 2)[keep])
        return None if found is None else self.around.estimate(found, trial.noise, 6)

    # ---- one round --------------------------------------------------------------------------------------------------
    def expand(self, base: Trial) -> list[Trial]:
        """The base with one effect more, best first; all with a likelihood, the best with their own noise."""
        around = self.around
        starts = self.screened(base)
        self.say(f"fitting {len(starts)} of {len(self.candidates)} rivals")
        found: list[Trial] = []
        try:
            work = Parallel(n_jobs=self.n_jobs, return_as="generator")
            found += (f for f in work(delayed(_fit)(around, base, e, v, d) for e, v, d in starts) if f is not None)
        except KeyboardInterrupt:  # what is fitted by now is compared before the search stops
            self.stopped = True
        if not found:
            return []
        assert base.noise is not None
        noises = [base.noise]
        best = min(found, key=lambda f: f.cost)
        best = around.estimate(best, base.noise)
        assert best.noise is not None
        noises.append(best.noise)
        scored = sorted(((max(around.likelihood(f, n) for n in noises), i) for i, f in enumerate(found)), reverse=True)
        out = []
        for rank, (value, i) in enumerate(scored):
            trial = found[i]
            trial.log_likelihood, trial.noise = value, None
            if rank < ESTIMATED:
                trial = around.estimate(trial, best.noise, 8)
                if trial.log_likelihood < value:
                    trial.log_likelihood, trial.noise = value, trial.noise or base.noise
            out.append(trial)
        with_noise = [t for t in out if t.noise is not None]
        return sorted(with_noise, key=self.score, reverse=True) + [t for t in out if t.noise is None]

    def screened(self, base: Trial) -> list[tuple[BaseEffect, np.ndarray, np.ndarray]]:
        """Effect, start and expected change of the outputs, of those that a linear look puts first."""
        taken = set(base.keys)
        effects, values, changes = [], [], []
        for effect in self.candidates:
            if effect.key in taken:
                continue
            for given in effect.starts(_probe(self.around, effect)):
                start = np.asarray(given, dtype=float)
                change = self.change(base, effect, start)
                if change is not None and np.all(np.isfinite(change)) and np.any(change):
                    effects.append(effect)
                    values.append(start)
                    changes.append(change)
        if not effects:
            return []
        columns = np.stack(changes)
        white, amplitude = self._white(base, effects, columns)
        forced = self._forced(base, effects, columns)
        chosen: dict[int, None] = {}
        least = HOPELESS * self.bar(1)
        for gains, most in ((white, BY_WHITE), (forced, BY_FORCED)):
            seen: set = set()
            for i in np.argsort(-gains):
                if gains[i] < least:
                    break
                if effects[i].key in seen:
                    continue
                seen.add(effects[i].key)
                chosen.setdefault(int(i))
                if len(seen) == most:
                    break
        if not base.effects:
            for i, effect in enumerate(effects):
                self.expected[effect.key] = max(self.expected.get(effect.key, -np.inf), float(white[i]))
        out = []
        for i in chosen:
            start = values[i].copy()
            if effects[i].linear and len(start):
                null = effects[i].parameters[0].null
                start[0] = null + amplitude[i] * (start[0] - null)
            out.append((effects[i], start, columns[i]))
        return out

    def change(self, base: Trial, effect: BaseEffect, start: np.ndarray) -> np.ndarray | None:
        """Change of the outputs by an effect at a start: inputs through the stand-in, the rest as it is."""
        around = self.around
        n = base.n_parameters
        theta = np.concatenate([base.theta[:n], start, base.theta[n:]])
        effects = (*base.effects, effect)
        if effect.kind == "input":
            du = around.acting(effects, theta) - around.acting(base.effects, base.theta)
            return around.stand_in.respond(du[None])[0] if np.any(du) else None
        return around.outputs(effects, theta) - base.y

    def _white(self, base: Trial, effects: Sequence[BaseEffect], columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Drop of the sum of squares by every column, and its amplitude."""
        around = self.around
        r, J = (around.record.y - base.y)[None], base.J.transpose(1, 0, 2)
        white = around.without_starts(np.concatenate([r, J, columns]))
        flat = white.reshape(len(white), -1)
        k = 1 + len(J)
        if len(J):
            q, _ = np.linalg.qr(flat[1:k].T)
            flat = flat - (flat @ q) @ q.T
        g, h = flat[k:] @ flat[0], np.sum(flat[k:] ** 2, axis=1)
        return _drop(g, h, effects)

    def _forced(self, base: Trial, effects: Sequence[BaseEffect], columns: np.ndarray) -> np.ndarray:
        """The same under the noise of the base."""
        around = self.around
        assert base.noise is not None
        given, precision = around.columns(base)
        k = given.shape[1]
        whole = np.concatenate([given.transpose(1, 0, 2), columns])
        rows, diagonal = around.disturbance().gram_rows(whole, base.noise, k)
        g, h = rows[0, k:], diagonal[k:]
        if k > 1:
            H = rows[1:, 1:k] + np.diag(precision)
            cross = rows[1:, k:]
            inverse = np.linalg.pinv(H, rcond=1e-10, hermitian=True)
            g, h = g - rows[1:, 0] @ inverse @ cross, h - np.einsum("pk,pk->k", cross, inverse @ cross)
        return _drop(g, h, effects)[0]

    # ---- what cannot be told apart ----------------------------------------------------------------------------------
    def twins(self, i: int) -> list[tuple[Trial, bool]]:
        """Rivals in the place of effect i that explain the data as well, and whether they predict the same."""
        final = self.final
        assert final is not None and final.noise is not None
        if len(final.effects) == 1:
            rivals = self.first_round
        else:
            rest = self.without(final, i)
            rivals = self.expand(rest) if rest is not None else []
        self.rivals.extend(rivals)
        level = self.around.likelihood(final, final.noise)
        own = final.effects[i].key
        size = len(final.effects[i].parameters)
        out = []
        for rival in rivals:
            if rival.effects[-1].key == own or rival.effects[-1].key in final.keys:
                continue
            value = self.around.likelihood(rival, final.noise)
            if 2.0 * (level - value) > EQUAL:
                continue
            sd = final.noise.sigma[:, None]
            same = bool(np.sqrt(np.mean(((rival.y - final.y) / sd) ** 2)) < 0.02)
            if len(rival.effects[-1].parameters) > size and (same or value - level < 2.0):
                continue  # a form with more parameters that predicts the same
            out.append((value, rival, same))
        out.sort(key=lambda item: -item[0])
        return [(rival, same) for _, rival, same in out]


def _probe(around: Around, effect: BaseEffect) -> Probe:
    """What an effect sees of the data."""
    record, plant = around.record, around.plant

    def signal(name: str) -> np.ndarray:
        if name in plant.inputs:
            return record.u[plant.inputs.index(name)]
        return record.y[plant.outputs.index(name)]

    where = signal(str(effect.location)) if effect.kind in ("input", "output") else np.zeros(record.n_samples)
    v = signal(effect.variable) if effect.variable else where
    return Probe(v, where, 0.0, record.dt, record.dt * int(record.lengths.max()), record.starts)


def _fit(around: Around, base: Trial, effect: BaseEffect, start: np.ndarray, change: np.ndarray) -> Trial | None:
    """The base with one effect more, fitted."""
    n = base.n_parameters
    theta = np.concatenate([base.theta[:n], start, base.theta[n:]])
    known = base.J.transpose(1, 0, 2)
    own = np.full((len(start), *base.y.shape), np.nan)
    if effect.linear and len(start) == 1 and effect.kind != "input" and start[0] != effect.parameters[0].null:
        own[0] = change / (start[0] - effect.parameters[0].null)
    J = np.concatenate([known[:n], own, known[n:]])
    return around.fit((*base.effects, effect), theta, J)


def _drop(g: np.ndarray, h: np.ndarray, effects: Sequence[BaseEffect]) -> tuple[np.ndarray, np.ndarray]:
    """Drop and amplitude of every column: free where the effect is linear, within 0.3..3 of the start where not."""
    h = np.maximum(h, 1e-300)
    linear = np.array([effect.linear for effect in effects])
    amplitude = np.where(linear, g / h, np.clip(g / h, 0.0, 3.0))
    return 2 * amplitude * g - amplitude**2 * h, amplitude
