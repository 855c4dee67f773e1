"""Unknown as a candidate: one law of one signal or of two, of no name, in the place of all that is named.

Several names may imitate one missing law. Along the path that they lead to, the simulator without them is linear to first
order, and a law in a balance, an input or a sensor is a regressor like any other: its likelihood, with as many parameters
counted as it has, is compared with theirs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.gap.fit._closeness import AT_THE_NOISE
from sksurrogate.gap.fit._evidence import Evidence, follow_noise
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.unnamed._curve_shapes import Curve, channel, reading, response
from sksurrogate.gap.unnamed._law_shapes import (
    AND_ITS_PAST,
    Form,
    Law,
    laws,
    of_time,
    over_sample,
    staircases,
    surfaces,
)
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.output_error import Fit, linearise, settle_hidden

__all__ = ["LawRival", "law_rival"]

#: Weights of the roughness that are tried, over the size of what the curve moves.
SMOOTH = 10.0 ** np.arange(-9.0, 3.0)
#: Turns of noise and law.
TURNS = 2
#: Laws that are judged at once.
LAWS_AT_ONCE = 12
#: Gain under the names' own noise below which no other noise makes a law as likely as names that leave nothing.
BEYOND_NOISE = -60.0
#: Nats by which a law of a later place must be likelier: an input and the balance that it alone pushes differ by rounding.
TIE_OF_PLACES = 1.0


@dataclass(frozen=True)
class LawRival:
    """The likeliest law in the place of the names.

    Attributes
    ----------
    location, kind, variable : str
        Balance ("state"), input or sensor ("output"), and the signal of which it is a law, or two ("v*w").
    gain : float
        ``2 (L_law - L_names)``, less ``ln N`` for every parameter and twice the logarithm of the number of candidates that each
        was chosen from.
    parameters : float
        Number of its parameters; of a smooth curve what its smoothness leaves free.
    """

    location: str
    kind: str
    variable: str
    gain: float
    parameters: float


def law_rival(named: Evidence, x: np.ndarray, n_rivals: int, second: WorkerProcess | None = None) -> LawRival | None:
    """The likeliest law in the place of a candidate's effects; None where none can be judged.

    Parameters
    ----------
    named : Evidence
        Of what is named.
    x : ndarray (n_states, n_samples)
        Path near the measured one: that of the candidate where it comes near to the data.
    n_rivals : int
        Number of effects that the first name was chosen from.
    second : Second, optional
        Another process.
    """
    noise, candidate = named.noise, named.candidate
    problem = candidate.problem
    base, r = without_names(candidate, x)
    _, J, precision, pull = base.columns()
    n = base.n_parameters
    J, precision, pull = J[:, n:], precision[n:], pull[n:]
    D = base.disturbance
    if not (np.isfinite(r).all() and np.isfinite(J).all() and np.isfinite(D.A).all()):
        return None
    candidates = list(in_all_places(base))
    fit = _Fit(problem, D, r, J, precision, pull, problem.prior_square((), base.fit.theta[n:]))
    if not candidates:
        return None
    chosen_from = sum(len(law.forms) for _, law, _ in candidates)
    cost = 0.5 * candidate.n_parameters * np.log(D.n_values) + bool(candidate.effects) * np.log(n_rivals)

    def judged(k: int, law: _Found, level: float) -> LawRival:
        gain = 2.0 * (law.value - np.log(chosen_from) + cost - level)
        curve, _, kind = candidates[k]
        return LawRival(curve.location, kind, curve.variable, float(gain), law.parameters)

    try:
        k, f, law = fit.likeliest(candidates, noise, second)
        if candidate.effects and named.left < AT_THE_NOISE:
            own = np.array_equal(x, candidate.fit.x)
            at_once = judged(k, law, named.log_likelihood if own else named_along(named, x, (noise,)))
            if at_once.gain < BEYOND_NOISE:
                return at_once
        starts = noise, problem.quiet(noise)
        likeliest = {(k, f), fit.likeliest(candidates, starts[1], second)[:2]}
        asked = [(k, f, start) for k, f in sorted(likeliest) for start in starts]
        found = side_by_side(lambda one: fit.refined(candidates[one[0]], *one[1:]), asked, second)
    except np.linalg.LinAlgError:  # a path along which no noise can be followed
        return None
    (k, _, _), best = max(zip(asked, found, strict=True), key=lambda one: one[1].value)
    level = named_along(named, x, (noise, best.noise))
    return judged(k, best, level) if np.isfinite(level) else None


def without_names(candidate: OdeCandidate, x: np.ndarray) -> tuple[OdeCandidate, np.ndarray]:
    """A model to first order about a path, and the residual that the simulator alone leaves there.

    The names' own slopes are kept where the path is theirs: those of another law that does the same are near to them.
    """
    problem, theta = candidate.problem, candidate.fit.theta[candidate.n_parameters :]
    model, record = problem.augmented(()), problem.record
    if np.array_equal(x, candidate.fit.x):
        D, now = candidate.disturbance, x[:, None]
        alone, named = model.bind(theta[:, None]), candidate.model.bind(candidate.fit.theta[:, None])
        moved = D.moved(alone(now) - named(now)) + alone.outputs(now) - named.outputs(now)
        return candidate, record.seen(record.y - candidate.fit.y - moved[:, 0])
    base = linear_along(problem.candidate((), replace(candidate.fit, theta=theta), model), x)
    return base, record.residual(base.fit.y)


def linear_along(candidate: OdeCandidate, x: np.ndarray) -> OdeCandidate:
    """A candidate as its free run is to first order about a path of the plant's states."""
    model, theta = candidate.model, candidate.fit.theta
    x = settle_hidden(model, theta, x)
    lin = linearise(model, theta, x, candidate.problem.units(candidate.effects, theta))
    return replace(candidate, fit=Fit(theta, x, lin.y, np.inf, 0, True, lin))


def named_along(named: Evidence, x: np.ndarray, starts: Sequence[Noise]) -> float:
    """Log likelihood of what is named, about the same path as the law's: along its own it may drift out of step."""
    own = np.array_equal(x, named.candidate.fit.x)
    here = named.candidate if own else linear_along(named.candidate, x)
    found = [follow_noise(here, start).log_likelihood for start in starts]
    return max([*found, named.log_likelihood] if own else found)


def in_all_places(base: OdeCandidate) -> Iterator[tuple[Curve, Law, str]]:
    """Laws of states and inputs in every balance, of each input in its place, of outputs in every sensor."""
    problem, D = base.problem, base.disturbance
    plant, record = problem.plant, problem.record
    moved = partial(response, D)
    x = base.fit.x[: len(plant.states)]
    signals, names = np.concatenate([x, record.u]), [*plant.states, *plant.inputs]
    held = set(plant.inputs) if plant.hold == "zoh" else set()
    raw = list(laws(record, signals, names, plant.inputs))
    of_signals = [
        law
        if law.variable.removesuffix(AND_ITS_PAST) in held
        else law._replace(functions=over_sample(record, law.functions))
        for law in raw
    ]
    times = list(of_time(record))
    acting = [*of_signals, *surfaces(record, signals, names, held), *times]
    for b, name in enumerate(problem.balances):
        for law in acting:
            moves = partial(moved, D.B[:, :, b].T, law.functions)
            yield Curve(name, law.variable, len(law.functions), moves), law, "state"
    for i, name in enumerate(plant.inputs):
        push, shown = channel(base, i)
        own = [law for law in raw if law.variable.removesuffix(AND_ITS_PAST) == name]
        for law in [*own, *staircases(record.u[i], name), *times]:
            moves = partial(moved, push, law.functions, shown, law.shown)
            yield Curve(name, law.variable, len(law.functions), moves), law, "input"
    readings = base.fit.y
    of_readings = [*laws(record, readings, plant.outputs, plant.outputs), *times]
    for o, name in enumerate(plant.outputs):
        for law in [*of_readings, *staircases(readings[o], name)]:
            moves = partial(reading, len(plant.outputs), o, law.functions)
            yield Curve(name, law.variable, len(law.functions), moves), law, "output"


class _Found(NamedTuple):
    """Log likelihood less half of ln N for each parameter; how many these are; the weight of the roughness; the parameters;
    the noise."""

    value: float
    parameters: float
    weight: float
    theta: np.ndarray
    noise: Noise


@dataclass(frozen=True, eq=False)
class _Fit:
    """A residual explained by free parameters of the simulator and by a law."""

    problem: OdeBackend
    D: Disturbance
    r: np.ndarray
    J: np.ndarray
    precision: np.ndarray
    pull: np.ndarray
    prior_square: float

    def likeliest(
        self, candidates: list[tuple[Curve, Law, str]], noise: Noise, second: WorkerProcess | None
    ) -> tuple[int, int, _Found]:
        """Law and form that are likeliest under one noise, and what was found of it."""
        parts = [candidates[a : a + LAWS_AT_ONCE] for a in range(0, len(candidates), LAWS_AT_ONCE)]
        found = [laws for part in side_by_side(lambda some: self.each(some, noise), parts, second) for laws in part]
        c, f = 0, 0
        for i, forms in enumerate(found):
            for j, one in enumerate(forms):
                if one.value > found[c][f].value + TIE_OF_PLACES:
                    c, f = i, j
        return c, f, found[c][f]

    def each(self, candidates: list[tuple[Curve, Law, str]], noise: Noise) -> list[list[_Found]]:
        """Every form of every law under one noise."""
        known = np.concatenate([self.r[:, None], self.J], axis=1)
        _, logdet = self.D.gram(known, noise)
        k = np.arange(1 + len(self.precision))
        grams = self.D.gram_each(known, (curve.moved() for curve, _, _ in candidates), noise)
        return [
            [
                self.smoothed(G[np.ix_(own, own)], logdet, form, noise)
                for form in law.forms
                for own in [np.r_[k, len(k) + form.functions]]
            ]
            for G, (_, law, _) in zip(grams, candidates, strict=True)
        ]

    def refined(self, candidate: tuple[Curve, Law, str], f: int, start: Noise) -> _Found:
        """One form with the noise fitted beside it: in turn the noise beside the law's one sum, and the law under the noise."""
        form = candidate[1].forms[f]
        F, k = candidate[0].moved()[:, form.functions], len(self.precision)
        unit, caps = self.problem.force_unit(), self.problem.caps
        now = self.found(F, start, form)
        for _ in range(TURNS):
            own = now.theta[k:]
            rough = 0.0 if form.rough is None else now.weight * (own @ form.rough @ own)
            J = np.concatenate([self.J, np.einsum("okt,k->ot", F, own)[:, None]], axis=1)
            held, pull = np.r_[self.precision, rough], np.r_[self.pull, 0.0]
            noise, _, _ = fit_noise(
                self.D, self.r, now.noise, unit, J, held, pull, caps=caps, sigma_unit=self.problem.sd
            )
            now = self.found(F, noise, form)
        return now

    def found(self, F: np.ndarray, noise: Noise, form: Form) -> _Found:
        """A form under one noise."""
        G, logdet = self.D.gram(np.concatenate([self.r[:, None], self.J, F], axis=1), noise)
        return self.smoothed(G, logdet, form, noise)

    def smoothed(self, G: np.ndarray, logdet: float, form: Form, noise: Noise) -> _Found:
        """A form at its best smoothness, from the Gram of residual, sensitivities and the form's functions."""
        if not np.isfinite(G).all():
            return _Found(-np.inf, 0.0, 0.0, np.zeros(len(G) - 1), noise)
        k = len(self.precision)
        H, g = G[1:, 1:].copy(), np.r_[G[1 : 1 + k, 0] + self.pull, G[1 + k :, 0]]
        H[:k, :k] += np.diag(self.precision)
        rough, weights = np.zeros_like(H), np.zeros(1)
        if form.rough is not None:
            rough[k:, k:] = form.rough
            weights = SMOOTH * np.trace(H[k:, k:]) / np.trace(rough)
        scale = np.sqrt(np.maximum(np.diag(H), 1e-150))
        normal = (H + weights[:, None, None] * rough) / np.outer(scale, scale) + 1e-10 * np.eye(len(H))
        inverse = np.linalg.inv(normal) / np.outer(scale, scale)
        theta = inverse @ g
        explained = theta @ g - 0.5 * np.einsum("wi,ij,wj->w", theta, H, theta)
        parameters = np.einsum("wij,ji->w", inverse[:, k:], H[:, k:])
        value = -0.5 * (G[0, 0] + logdet + self.prior_square) + explained - 0.5 * parameters * np.log(self.D.n_values)
        best = int(np.argmax(value))
        return _Found(float(value[best]), float(parameters[best]), float(weights[best]), theta[best], noise)
