"""Every named effect with its numbers and the effects that cannot be distinguished from it; the ranking of all candidates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import name_of
from sksurrogate.effects._ports import at_port
from sksurrogate.gap.decide._partial_results import PartialResults
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.results._effect_estimate import SHAPE_NUMBERS, EffectEstimate
from sksurrogate.gap.results._next_experiment import NextExperiment, first_of
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.search._nested import richer as richer_form
from sksurrogate.gap.search._related_forms import special_cases

#: Name, location and variable of an effect.
Key: TypeAlias = tuple[str, str | None, str | None]


def estimates(search: BaseSearch[C], final: Evidence[C], found: PartialResults, among: str) -> list[EffectEstimate]:
    """The effects of what stands, in the order of the search; nan for what is not known yet."""
    values, nothing = found.values, final.fit.theta * np.nan
    best = final if values is None else values.fitted
    low, high = (nothing, nothing) if values is None else (values.low, values.high)
    out = []
    for i, effect in enumerate(final.effects):
        rows = final.candidate.slice_of(i)
        others = _class_of(search, final.candidate, i, found)
        shape: dict[str, Any] = {name: getattr(effect, name, 0.0) for name in SHAPE_NUMBERS}
        params, ends = reported(effect, best.fit.theta[rows], low[rows], high[rows])
        out.append(
            EffectEstimate(
                effect.name,
                str(effect.location),
                effect.key[2],
                float(found.parts.shares[i]) if found.parts.shares else float("nan"),
                params,
                ends,
                found.parts.probabilities[i] if found.parts.probabilities else float("nan"),
                _plain(dict.fromkeys([*others.twins, *others.richer, *others.simpler])),
                when_they_part(
                    name_of(effect),
                    others.tied,
                    others.identical,
                    found.experiment,
                    sorted({key[0] for key in others.richer}),
                    among,
                ),
                _plain(others.richer),
                at_port(effect, search.problem.plant),
                simpler=_plain(others.simpler),
                before=getattr(effect, "before", None),
                settled=getattr(effect, "settled", True),
                **shape,
            )
        )
    return out


class _Class(NamedTuple):
    """What else explains the data in the place of one effect."""

    twins: list[Key]  #: Other effects, also richer forms that were fitted in its place
    richer: list[Key]  #: Forms that contain it and fit no better
    simpler: list[Key]  #: Special cases that are as good up to the tolerance
    tied: list[str]  #: Names of the twins that are no richer forms
    identical: bool  #: Whether all twins predict the same


def _class_of(search: BaseSearch[C], named: C, i: int, found: PartialResults) -> _Class:
    """The class of one effect of what stands, without effects that stand beside it."""
    effect, its_class = named.effects[i], found.class_of(i)
    added = [twin.effect for twin in its_class.twins]
    ahead = [other.key for other in added if richer_form(other, effect)]
    own = effect.key[:3]  # the same effect with a beginning or an end is not listed
    contain = [key for key in dict.fromkeys([*ahead, *search.richer.get(effect.key, [])]) if key not in named.keys]
    richer = [key for key in contain if key[:3] != own]
    known = {*(other.key for other in added), *contain, *named.keys}
    simpler = [form.key for form in special_cases(search, named, i) if form.key not in known]
    twins = [other.key for other in added if other.key not in named.keys and other.key[:3] != own]
    tied = [name_of(other) for other in added if other.key not in ahead]
    return _Class(twins, richer, simpler, tied, all(twin.same for twin in its_class.twins))


def _plain(keys: Iterable[Key]) -> list[tuple[str, str, str | None]]:
    """Keys of effects as a report lists them."""
    return [(str(key[0]), str(key[1]), key[2]) for key in keys]  # of an effect in a window a key has more


def reported(
    effect: BaseEffect, theta: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Values and intervals by name: an interval is mirrored or shifted as its value is.

    >>> from sksurrogate.effects._disturbance import PeriodicDisturbance
    >>> theta, low, high = np.array([[-2.0, 5.0, 0.0], [-2.2, 4.9, -0.1], [-1.9, 5.2, 0.1]])
    >>> params, intervals = reported(PeriodicDisturbance("speed"), theta, low, high)
    >>> params["amplitude"], intervals["amplitude"]
    (2.0, (1.9, 2.2))
    >>> round(params["phase"], 3), [round(end, 3) for end in intervals["phase"]]
    (3.142, [3.042, 3.242])
    """
    params, intervals = {}, {}
    turned = effect.canonical(tuple(float(value) for value in theta))
    for parameter, raw, value, a, b in zip(effect.parameters, theta, turned, low, high):
        params[parameter.name] = float(value)
        ends = (-b, -a) if value == -raw != 0 else (a + (value - raw), b + (value - raw))
        intervals[parameter.name] = float(ends[0]), float(ends[1])
    return params, intervals


def ranking(search: BaseSearch[C], final: Evidence[C]) -> Table:
    """One row a candidate, the most evident first; nan where it was not fitted, no rows before the null is."""
    if search.null is None:
        return EMPTY
    by_gain = sorted(search.first_round, key=search.gain)  # of several forms of one effect the likeliest stays
    fitted = {candidate.keys[0]: candidate for candidate in by_gain}
    if len(final.effects) == 1:  # it may begin within the runs, which no single effect of the first round does
        fitted.setdefault(final.effects[0].key, final.candidate)
    expected, rows = search.expected(), []
    known = {effect.key: effect for effect in (*search.library, *final.effects)}
    for effect in known.values():
        fit = fitted.get(effect.key)
        row: dict[str, Any] = {
            "name": effect.name,
            "location": effect.location,
            "variable": effect.key[2],
            "evidence": search.gain(fit) if fit is not None else float("nan"),
            "bar": search.threshold(len(effect.parameters)),
            "cost": fit.fit.cost if fit is not None else float("nan"),
            "screen": expected.get(effect.key, 0.0),
            "named": effect.key in final.candidate.keys,
        }
        rows.append(row)
    rows.sort(key=lambda row: (-np.nan_to_num(row["evidence"], nan=-np.inf), -row["screen"]))
    return Table(tuple(rows))


def when_they_part(
    named: str,
    tied: Sequence[str],
    same: bool,
    experiment: NextExperiment | None,
    richer: Sequence[str] = (),
    among: str = "of the catalogue",
) -> str:
    """The sentence beside a name.

    ``tied``: candidates that these data cannot tell from it.
    ``same``: whether all of them predict the same.
    ``experiment``: what was computed to part the effect that it is about.
    ``richer``: forms that contain the named one and fit no better.
    ``among``: which effects were compared.
    """
    if not tied and richer:
        return f"Only richer forms ({', '.join(richer)}) explain these data as well; nothing in the data needs them."
    if not tied:
        return f"No other effect {among} explains these data as well."
    how = "predict the same" if same else "explain these data equally well"
    return f"These data do not separate {named} from: {first_of(tied)}. They {how} on the range that was reached; {_part(named, tied, experiment)}."


def _part(named: str, tied: Sequence[str], experiment: NextExperiment | None) -> str:
    """What parts them, of those that were asked for."""
    if experiment is None:
        return "no experiment that separates them was found"
    if experiment.named != named:
        return f"no experiment was computed for this pair (the suggested one concerns {experiment.named})"
    if not experiment.parted:
        return "none of the experiments tried here separates them"
    record = experiment.options[0]["experiment"]
    if set(tied) <= set(experiment.parted):
        return f'the experiment "{record}" separates them'
    return f'the experiment "{record}" separates it from {first_of(experiment.parted)}; no experiment is known for the rest'
