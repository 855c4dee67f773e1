"""A named effect, or the missing term, drawn over its variable."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._families import BalanceEffect, HiddenEffect
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.render._svg import POINTS, Line, Panel, figure
from sksurrogate.gap.render._units import axis, derivative_unit, labelled
from sksurrogate.gap.render._values import effect_text, held_out, readable
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._missing_term import Curve
from sksurrogate.gap.results._report_data import ReportData


def effect_curve(effect: EffectEstimate, report: ReportData) -> Curve | None:
    """The law of a named effect over its variable, with the band that its intervals give; None where it has no such curve.

    Only laws in a balance that depend on one signal are curves; the range is that of the data.
    """
    kind = CATALOGUE.get(effect.name)
    ends = report.ranges.get(effect.variable or "")
    if kind is None or not issubclass(kind, BalanceEffect) or issubclass(kind, HiddenEffect) or kind.of_load:
        return None
    if ends is None or not ends[1] > ends[0]:
        return None
    at = np.linspace(*ends, POINTS)
    own = at if effect.variable == effect.location else np.zeros(POINTS)

    def law(params: dict[str, float]) -> np.ndarray:
        theta = [params[p.name] for p in kind.parameters]
        made = kind(effect.location, effect.variable)
        return np.broadcast_to(np.asarray(made.term(0.0, own, at, theta, 0.0), dtype=float), at.shape)

    try:
        with np.errstate(all="ignore"):
            value = law(effect.params)
            sides = [value]
            for name, (low, high) in effect.intervals.items():
                sides += [law({**effect.params, name: end}) for end in (low, high) if np.isfinite(end)]
    except (KeyError, TypeError, ValueError, IndexError, SurrogateError):
        return None  # a law that needs more than its variable
    if not np.isfinite(value).all():
        return None
    return Curve(str(effect.variable), at, value, np.min(sides, axis=0), np.max(sides, axis=0), 1.0)


def balance_axis(location: str, kind: str, report: ReportData) -> str:
    """What a term is added to, as the label of an axis."""
    if kind == "state":
        return labelled(f"d({location})/dt", derivative_unit(location, report.units))
    return labelled(f"added to {kind} {location}", report.units.get(location, ""))


#: How a parameter depends on ``s = c v + c2``, by its curvature.
DEPENDENCES = {0.0: "p (1 + s)", 1.0: "p exp(s)", 2.0: "p / (1 - s)", -1.0: "p sqrt(1 + 2 s)"}


def _equation_of(effect: EffectEstimate, kind: type[BaseEffect]) -> str:
    """The equation of an effect with its own numbers: the input before a run, the curvature of a dependence."""
    if effect.name == "parameter_dependence":
        power = 1.0 - effect.curvature
        return f"{DEPENDENCES.get(effect.curvature) or f'p (1 + {power:.3g} s)^{1.0 / power:.3g}'}, s = c v + c2"
    return kind.equation if effect.before is None else kind.equation.replace("w(0) = u(0)", f"w(0) = {effect.before:g}")


def form_of(effect: EffectEstimate) -> str:
    """The form of an effect of the catalogue, with what its letters are; empty for others.

    >>> form_of(EffectEstimate("linear_loss", "level", "inflow", 1.0, {"coefficient": 0.1}, {}, 1.0))
    '<p>Form: <code>- c v</code>, added to the balance of level, with c = coefficient, v = inflow</p>'
    >>> lag = EffectEstimate("input_lag", "valve", None, 1.0, {"time_constant": 0.3}, {}, 1.0, before=0.0)
    >>> form_of(lag)
    '<p>Form: <code>c dw/dt + w = u, w(0) = 0</code>, with c = time constant, u = valve</p>'
    >>> warm = EffectEstimate("parameter_dependence", "k", "T", 1.0, {"slope": 0.1, "relative_error": 0.0}, {}, 1.0, curvature=1.0)
    >>> form_of(warm)
    '<p>Form: <code>p exp(s), s = c v + c2</code>, with c = slope, v = T, p = k, c2 = relative error</p>'
    """
    kind = CATALOGUE.get(effect.name)
    if kind is None:
        return ""
    equation = _equation_of(effect, kind)
    words = set(re.findall(r"\bd?(c2|[cvxyup])\b", equation))
    letters = {"c": next(iter(effect.params), ""), "v": effect.variable or "", **dict.fromkeys("xyup", effect.location)}
    letters["c2"] = next(iter([*effect.params][1:]), "")
    known = [f"{letter} = {readable(name)}" for letter, name in letters.items() if letter in words and name]
    balance = issubclass(kind, BalanceEffect) and kind.equation[0] in "+-"
    place = f", added to the balance of {escape(effect.location)}" if balance and not effect.at_port else ""
    return f"<p>Form: <code>{escape(equation)}</code>{place}{escape(', with ' + ', '.join(known)) if known else ''}</p>"


def effect_html(effect: EffectEstimate, report: ReportData) -> str:
    """The picture of a named effect; empty where it has none."""
    curve = effect_curve(effect, report)
    if curve is None:
        return ""
    state = effect.location in report.states
    label = balance_axis(effect.location, "state" if state else "input", report)
    return f"<figure>{_picture(curve, label, report, effect_text(effect))}</figure>"


def curve_html(curve: Curve, location: str, kind: str, report: ReportData, laws: Sequence[Line] = ()) -> str:
    """The missing term over one variable, with its band."""
    picture = _picture(curve, balance_axis(location, kind, report), report, f"missing term over {curve.variable}", laws)
    return (
        f"<figure>{picture}<figcaption>Over {escape(curve.variable)}: mean and 90 % band. This variable alone explains "
        f"{100 * max(curve.explained, 0):.0f} % of the term on {held_out(report)}.</figcaption></figure>"
    )


def _picture(curve: Curve, label: str, report: ReportData, title: str, laws: Sequence[Line] = ()) -> str:
    """Curve, band, further lines."""
    wide = bool(np.any(curve.high > curve.low))
    band, band_label = ((curve.at, curve.low, curve.high), "90 %") if wide else (None, "")
    lines = [Line("estimate", curve.at, curve.value, "ink", width=2.0), *laws]
    return figure([Panel(lines, label, None, band, band_label)], axis(curve.variable, report.units), title)
