"""Evidence of a set of effects that stands beside a law without a name: a smooth function of signals at one place.

No named form is exact, and no model of a real plant is complete. The residual of a set is explained by the set's own
parameters, by noise, and by a law ``f(z)`` at a place, whose movement of the outputs has the size ``a`` (root mean square
over the noise). The law is integrated out under a Gaussian prior of its weights, its size under a prior of the sizes:
half normal with the tolerance as its scale for a *small* law, log-uniform above the tolerance for a *large* one.

References
----------
Kennedy, O'Hagan, *Bayesian calibration of computer models*, J. R. Statist. Soc. B 63 (2001); Brynjarsdottir, O'Hagan,
*Learning about physical parameters: the importance of model discrepancy*, Inverse Problems 30 (2014).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._linear_set import LinearSet, linear_set
from sksurrogate.gap.fit._normal_equations import inverse
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.unnamed._along_a_path import as_regressors, carried, linear_along
from sksurrogate.gap.unnamed._amplitude import amplitude_evidence, known_to_rounding, prior_roots, small_and_large
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._law_places import PlacedSignal, in_all_places
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.disturbance import Noise

#: Sizes of a law on which its evidence is computed, over the size that counts as one: a factor of 1.25 apart.
LAW_SIZES = np.geomspace(1e-3, 30.0, 48)
#: Laws whose columns are computed at once.
LAWS_IN_BLOCK = 12
#: Cosine from which what two functions move the outputs by is the same.
SAME_MOVE = 0.999
#: Turns of noise and law.
TURNS = 2


class LawName(NamedTuple):
    """Which law it is: laws beside other sets have the same names, in other places of their lists."""

    location: str
    kind: str
    variable: str
    number: int  #: Among those of this place and variable
    form: int


def law_names(laws: Iterable[PlacedSignal]) -> list[LawName]:
    """Of laws in their first form, in their order."""
    seen: Counter[tuple[str, str, str]] = Counter()
    names = []
    for law in laws:
        key = law.location, law.kind, law.signal.variable
        names.append(LawName(*key, seen[key], 0))
        seen[key] += 1
    return names


@dataclass(frozen=True)
class LawBeside:
    """The likeliest law beside a set of effects."""

    #: small, large: Log evidence of the set beside a law of at most about the tolerance, and of a larger one; the choice of the
    #: law among all is paid
    small: float
    large: float
    name: LawName
    left: LawLeft  #: Its place and its size

    @property
    def total(self) -> float:
        """Log evidence of the set beside a law of any size."""
        return float(np.logaddexp(self.small, self.large))


@dataclass(frozen=True, eq=False)
class LawQuestion:
    """Which law is the likeliest beside a set of effects, along a path."""

    candidate: OdeCandidate  #: The set; its parameters follow to first order
    #: Under which laws are compared; from each of them the noise is fitted beside the likeliest
    noises: Sequence[Noise]
    #: (n_states, n_samples): path of the plant's states about which the set is linear; None: its own free run
    path: np.ndarray | None = None
    #: Whether the simulator without effects carries laws and effects alike to the outputs, as regressors: an effect that is stiff, as
    #: a friction at rest, would not let a law correct it
    bare: bool = False
    #: Of laws beside other sets about the same path: these are compared too, with a jump at zero where they have none
    seeds: Sequence[LawName] = ()
    #: The set with the effect in whose place the law stands. What moves the outputs as this effect does is this effect, and no law
    #: without a name: a form of one function, and, up to the tolerance, a law of its place and signal that is larger than the tolerance
    instead: OdeCandidate | None = None


def law_beside(asked: LawQuestion, unit: float, tolerance: float) -> LawBeside | None:
    """The likeliest law beside a set of effects; None where the path cannot be followed.

    ``unit``: RMS of the gap over the noise: the size that counts as one.
    ``tolerance``: size of a law that is small.
    """
    candidate, x, instead = asked.candidate, asked.path, asked.instead
    if x is None:
        linear, x = linear_set(candidate), candidate.fit.x
    else:
        linear = as_regressors(candidate, x) if asked.bare else linear_set(linear_along(candidate, x))
    if not linear.finite:
        return None
    named = frozenset(map(place_and_signal, candidate.effects))
    own = None if instead is None else carried(instead, candidate, linear.base, x[: candidate.model.n_nominal])[:, 0]
    fit = _Fit(linear, asked.noises, unit, tolerance, named, own)
    try:
        best = fit.best(asked.seeds)
        if instead is not None and fit.is_the_effect_again(best, instead.effects):
            best = fit.best(asked.seeds, barred=fit.candidates[best.k].place)
    except np.linalg.LinAlgError:
        return None
    return fit.result(best, max(linear.log_likelihood(noise) for noise in asked.noises))


def place_and_signal(effect: BaseEffect) -> tuple[str, str]:
    """Where an effect acts, and the signal that drives it: its own where no other does."""
    return str(effect.location), effect.variable or str(effect.location)


class _Found(NamedTuple):
    """Log evidence with a small and a large law, mean size and its spread, weights of parameters and law, noise; which law."""

    small: float
    large: float
    size: float
    spread: float
    theta: np.ndarray
    noise: Noise
    k: int
    f: int

    @property
    def total(self) -> float:
        """Log evidence with a law of any size."""
        return float(np.logaddexp(self.small, self.large))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A residual explained by the parameters of a set and by one of many laws."""

    linear: LinearSet[OdeCandidate]
    noises: Sequence[Noise]
    unit: float
    tolerance: float
    named: frozenset[tuple[str, str]]
    #: (n_outputs, n_samples): what the effect moves the outputs by in whose place the law stands
    instead: np.ndarray | None = None
    made: dict[int, list[list[np.ndarray]]] = field(default_factory=dict)

    @cached_property
    def candidates(self) -> list[PlacedSignal]:
        """All laws in all places."""
        return list(in_all_places(self.linear.base))

    @cached_property
    def prices(self) -> np.ndarray:
        """Minus the log prior of each law's forms, as a small and as a large law, (n_laws, 2).

        A large law may be any. A small one corrects a form that is named, in its place and variable, or is any: both are as likely.
        """
        n_forms = np.array([len(one.signal.forms) for one in self.candidates], dtype=float)
        corrects = np.array([one.place in self.named for one in self.candidates])
        anywhere = np.full(len(n_forms), 1.0 / np.sum(n_forms))
        small = 0.5 * (anywhere + corrects / np.sum(n_forms[corrects])) if corrects.any() else anywhere
        return -np.log(np.stack([small, anywhere], axis=1))

    @cached_property
    def priors(self) -> np.ndarray:
        """Prior weights of the sizes of a small and of a large law, (2, n_sizes)."""
        return small_and_large(LAW_SIZES, self.tolerance)

    @cached_property
    def names(self) -> list[LawName]:
        """Of all laws."""
        return law_names(self.candidates)

    def best(self, seeds: Sequence[LawName], barred: tuple[str, str] | None = None) -> _Found:
        """The likeliest law: of those that are likeliest under each noise, and of those that were likeliest beside other sets.

        The noise is fitted beside the likeliest law under each noise; then beside the likeliest other under the noise of the best, as long as
        another leads.

        ``barred``: place and signal whose law is the effect in whose place it stands.
        """
        picks = [self.first(evidence, barred) for evidence in self.compared]
        best = max((self.refined(k, f, noise) for (k, f), noise in zip(picks, self.noises)), key=attrgetter("total"))
        of_name = {name: k for k, name in enumerate(self.names)}
        known = [(of_name[seed._replace(form=0)], seed.form) for seed in seeds if seed._replace(form=0) in of_name]
        others = {*picks, *((k, form) for k, f in known for form in self.relatives(k, f, barred))} - {(best.k, best.f)}
        while others:
            first = max((self.under(k, f, best.noise) for k, f in sorted(others)), key=attrgetter("total"))
            others.remove((first.k, first.f))
            first = self.refined(first.k, first.f, best.noise)
            if first.total <= best.total:
                break
            best = first
        return best

    def under(self, k: int, f: int, noise: Noise) -> _Found:
        """Form f of law k under a noise."""
        return self.found(k, f, self.columns(k, f), noise)

    def columns(self, k: int, f: int) -> np.ndarray:
        """What the functions of form f of law k move the outputs by."""
        law = self.candidates[k]
        return law.moved()[:, law.signal.forms[f].functions]

    def is_the_effect_again(self, one: _Found, whole: Sequence[BaseEffect]) -> bool:
        """Whether a law larger than the tolerance moves the outputs as the effect of this place and signal does in whose place it stands.

        Up to the tolerance. ``whole``: the set with this effect.
        """
        its_own = self.candidates[one.k].place in map(place_and_signal, whole)
        if self.instead is None or one.size < self.tolerance or not its_own:
            return False
        own, law = self.linear.projected(np.stack([self.instead, self.moved(one)], axis=1))
        cosine = abs(float(own @ law)) / max(float(np.linalg.norm(own) * np.linalg.norm(law)), 1e-300)
        return cosine > np.sqrt(1.0 - self.tolerance**2)

    def moved(self, one: _Found) -> np.ndarray:
        """What a law with its weights moves the outputs by, (n_outputs, n_samples)."""
        return np.einsum("okt,k->ot", self.columns(one.k, one.f), one.theta[self.linear.J.shape[1] :])

    def first(self, evidence: list[list[float]], barred: tuple[str, str] | None) -> tuple[int, int]:
        """Law and form of most evidence, the first of equal ones; none at the place that is barred."""
        best, at = -np.inf, (0, 0)
        for k, forms in enumerate(evidence):
            for f, top in enumerate(forms):
                if top > best + 1e-9 and self.candidates[k].place != barred:
                    best, at = top, (k, f)
        return at

    @cached_property
    def compared(self) -> list[list[list[float]]]:
        """Evidence of every form of every law, under each noise: what the laws move the outputs by is computed once for all noises."""
        grams = [self.linear.D.grams_beside(self.linear.known, noise) for noise in self.noises]
        evidence: list[list[list[float]]] = [[] for _ in self.noises]
        for a in range(0, len(self.candidates), LAWS_IN_BLOCK):
            check_time()
            moved = [law.moved() for law in self.candidates[a : a + LAWS_IN_BLOCK]]
            for own, beside in zip(evidence, grams):
                own += [self.evidence_of_forms(k, moved[k - a], G) for k, G in enumerate(beside(moved), start=a)]
        return evidence

    def evidence_of_forms(self, k: int, moved: np.ndarray, G: np.ndarray) -> list[float]:
        """Of every form of law k, from the Gram of what is known and of its functions."""
        n, forms = 1 + self.linear.J.shape[1], self.candidates[k].signal.forms
        if not np.isfinite(G).all():
            return [-np.inf] * len(forms)
        H, g, power = self.linear.beside_parameters(G)
        sound = known_to_rounding(G)  # if for all functions, then for some
        out, is_effect = [], self.is_the_effect(k, moved)
        for form, roots in zip(forms, self.roots_of(k, moved)):
            own = form.functions
            if len(own) == 1 and is_effect[own[0]]:
                out.append(-np.inf)
                continue
            some = np.r_[np.arange(n), n + own]
            known = sound or known_to_rounding(G[np.ix_(some, some)])
            sizes, _, _ = self.sized(H[np.ix_(own, own)], g[own], power, roots if known else [])
            out.append(float(np.logaddexp(*(np.array(sizes) - self.prices[k]))))
        return out

    def is_the_effect(self, k: int, moved: np.ndarray) -> np.ndarray:
        """Which functions of law k move the outputs as the effect in whose place they stand (n_functions,).

        Where another effect of the set has its place and variable, a law corrects the form of that one.
        """
        law = self.candidates[k]
        if self.instead is None or law.place in self.named:
            return np.zeros(len(law.signal.functions), bool)
        sd = self.linear.problem.sd[:, None]
        own, some = (self.instead / sd).ravel(), (moved.transpose(1, 0, 2) / sd).reshape(moved.shape[1], -1)
        sizes = np.linalg.norm(some, axis=1) * np.linalg.norm(own)
        return np.abs(some @ own) > SAME_MOVE * np.maximum(sizes, 1e-300)

    def roots_of(self, k: int, F: np.ndarray) -> list[list[np.ndarray]]:
        """Of every form of law k, whose functions move the outputs by F; they are made once."""
        if k not in self.made:
            metric = self.linear.metric(F)
            forms = self.candidates[k].signal.forms
            self.made[k] = [prior_roots(metric[np.ix_(f.functions, f.functions)], f.rough) for f in forms]
        return self.made[k]

    def sized(
        self, H: np.ndarray, g: np.ndarray, power: float, roots: list[np.ndarray]
    ) -> tuple[tuple[float, float], np.ndarray, np.ndarray]:
        """Log Bayes factors of a small and of a large law over none; posterior of the sizes; root of the prior covariance."""
        if not roots:
            return (-np.inf, -np.inf), np.full(len(LAW_SIZES), 1.0 / len(LAW_SIZES)), np.eye(len(H))
        best: tuple[Any, ...] = ()
        for root in roots:
            value = amplitude_evidence(H, g, root, LAW_SIZES * self.unit, power)
            top = float(np.max(value))
            weights = np.exp(value - top) * self.priors
            small, large = np.sum(weights, axis=1)
            if not best or np.log(small + large) + top > best[0]:
                posterior = np.sum(weights, axis=0) / (small + large)
                best = np.log(small + large) + top, (_log(small) + top, _log(large) + top), posterior, root
        return best[1], best[2], best[3]

    def relatives(self, k: int, f: int, barred: tuple[str, str] | None = None) -> list[int]:
        """A form of a law, and those that contain its functions and one more; none where it has no such form."""
        if self.candidates[k].place == barred:
            return []
        forms = [set(form.functions.tolist()) for form in self.candidates[k].signal.forms]
        if f >= len(forms):
            return []
        wider = (i for i, other in enumerate(forms) if forms[f] < other and len(other) == len(forms[f]) + 1)
        if self.instead is not None and len(forms[f]) == 1:
            is_effect = self.is_the_effect(k, self.candidates[k].moved())
            return [*([] if is_effect[min(forms[f])] else [f]), *wider]
        return [f, *wider]

    def found(self, k: int, f: int, F: np.ndarray, noise: Noise) -> _Found:
        """A law under one noise."""
        form = self.candidates[k].signal.forms[f]
        G, logdet = self.linear.D.gram(np.concatenate([self.linear.known, F], axis=1), noise)
        metric = self.linear.metric(F)
        roots = prior_roots(metric, form.rough) if known_to_rounding(G) else []
        (small, large), posterior, root = self.sized(*self.linear.beside_parameters(G), roots)
        none, (at_small, at_large) = self.linear.at_best(G, logdet), self.prices[k]
        size, n = float(posterior @ LAW_SIZES) * self.unit, self.linear.J.shape[1]
        # Weights at the mean size, in the coordinates of the prior's root.
        R = np.zeros((len(G) - 1, n + root.shape[1]))
        R[:n, :n], R[n:, n:] = np.eye(n), size * root
        H = R.T @ G[1:, 1:] @ R + np.diag(np.r_[self.linear.precision, np.ones(root.shape[1])])
        g = R.T @ (G[1:, 0] + np.r_[self.linear.pull, np.zeros(len(G) - 1 - n)])
        covariance = inverse(H)
        theta = R @ (covariance @ g)
        slope = R.T @ np.r_[np.zeros(n), metric @ theta[n:]]  # of half the mean square movement
        moved = np.sqrt(max(float(theta[n:] @ metric @ theta[n:]), 1e-300))
        spread = np.sqrt(max(float(slope @ covariance @ slope), 0.0)) / moved
        small, large = none + small - at_small, none + large - at_large
        return _Found(small, large, moved / self.unit, spread / self.unit, theta, noise, k, f)

    def refined(self, k: int, f: int, start: Noise) -> _Found:
        """One form with the noise fitted beside it: in turn the noise beside the law's one sum, and the law under the noise."""
        F, n = self.columns(k, f), self.linear.J.shape[1]
        now = self.found(k, f, F, start)
        for _ in range(TURNS):
            moved = np.einsum("okt,k->ot", F, now.theta[n:])[:, None]
            noise, _, _ = self.linear.beside(moved).noise_from(now.noise, sigma_unit=self.linear.problem.sd)
            now = self.found(k, f, F, noise)
        return now

    def result(self, one: _Found, alone: float) -> LawBeside:
        """With its place; a set with next to no law is not less likely than the set alone."""
        law, n = self.candidates[one.k], self.linear.J.shape[1]
        base, record, sd = self.linear.base, self.linear.problem.record, self.linear.problem.sd
        small = float(np.logaddexp(one.small, alone - np.log(2.0)))
        weight = np.exp(one.large - np.logaddexp(small, one.large)) if one.small < alone else 1.0
        size = float(one.size * weight)
        spread = float(np.sqrt(weight * (one.spread**2 + one.size**2) - size**2))  # of the law's size or of none at all
        gain = 2.0 * (one.total - alone)
        F = self.moved(one)
        moved = record.rms(self.linear.projected(F[:, None]).reshape(F.shape)) * sd
        deviation = float(np.max(moved / record.spread))
        by_parameters = np.einsum("okt,k->ot", self.linear.J, one.theta[:n])
        rest = base.without_starts((self.linear.r - by_parameters - F)[None])
        rms = float(np.sqrt(np.sum(rest**2) / record.n_values))
        large = float(one.large)
        probability = float(np.exp(large - np.logaddexp(small, large)))
        left = LawLeft(law.location, law.kind, law.signal.variable, size, spread, gain, deviation, probability, rms)
        return LawBeside(small, large, self.names[one.k]._replace(form=one.f), left)


def _log(value: float) -> float:
    """Logarithm, -inf of nothing."""
    return float(np.log(value)) if value > 0 else -np.inf
