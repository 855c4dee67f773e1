"""Code to paste: the corrected simulator, a simulation, a linearisation, a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._onset import WINDOW
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.gap.render._values import is_wrong_parameter, number
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._report_data import ReportData

#: Effects that may begin elsewhere than at rest.
_REMEMBERING = {name for name, kind in CATALOGUE.items() if issubclass(kind, HiddenEffect)}

_BUILD = """\
from sksurrogate.effects import {names}
from {module} import {name} as simulator  # as it was diagnosed

model = AugmentedSimulator(
    simulator,
    effects=[{effects}],
    values=[{values}],{options}
)
"""
_FROM_DIAGNOSER = """\
model = diagnoser.augmented_
"""
_SIMULATE = """\
Y = model.simulate(U, x0=x0)  # U: (n_samples, {n_inputs}), columns {inputs}
"""
_LINEARISE = """
from sksurrogate.physics import linearise, steady_state

x = steady_state(model, u0)
local = linearise(model, x, u0)  # local.states, local.A, local.B, local.C, local.D
"""
_CONTROL = """
import control, numpy as np

K, S, poles = control.lqr(local.to_control(), np.eye(len(local.A)), np.eye({n_inputs}))
"""


def code_of(report: ReportData) -> str:
    """Lines that use the result of a diagnosis.

    The effects of the catalogue are written out with their numbers; others are taken from the diagnoser.
    """
    n_states, n_inputs = len(report.states), len(report.inputs)
    names = {"n_inputs": n_inputs, "inputs": list(report.inputs)}
    out = _built(report) + "\n" + _SIMULATE.format(**names)
    if n_states and n_inputs and report.provenance.access != "trajectory":
        out += _LINEARISE + _CONTROL.format(**names)
    return out


def _built(report: ReportData) -> str:
    """How the corrected simulator is made."""
    retuned = {str(row["parameter"]): float(row["value"]) for row in report.retuned}
    effects = [e for e in report.effects if not (is_wrong_parameter(e) and e.location in retuned)]
    if not all(effect.name in CATALOGUE for effect in effects) or report.certified_law is not None:
        return _FROM_DIAGNOSER
    module, name = _reference(report.provenance.simulator)
    options = []
    if retuned:
        options.append(f"retuned={_numbers(retuned)},")
    if any(effect.runs is not None for effect in effects):
        options.append(f"runs={_runs(effects)},  # model.in_run(label) is the simulator of one run")
    if report.scale:
        sizes = ", ".join(number(size, 12) for size in report.scale)
        options.append(f"scale=[{sizes}],  # sizes of the states, for kinks")
    if report.sharpness != KINK_SHARPNESS:
        sharpness = number(report.sharpness, 12)
        options.append(f"sharpness={sharpness},  # these sizes over the width of the kinks, as fitted")
    return _BUILD.format(
        module=module,
        name=name,
        effects=", ".join(made := [*map(_made, effects)]),
        names=f"CATALOGUE, AugmentedSimulator{', starting' if any(one.startswith('starting') for one in made) else ''}",
        values=", ".join(_numbers(effect.params) for effect in effects),
        options="".join(f"\n    {line}" for line in options),
    )


def _runs(effects: Sequence[EffectEstimate]) -> str:
    """Labels of the runs of every effect, None for all."""
    return f"[{', '.join('None' if effect.runs is None else repr(list(effect.runs)) for effect in effects)}]"


def _reference(simulator: str) -> tuple[str, str]:
    """Module and name: of ``plant.py:plant``, else placeholders."""
    file, _, name = simulator.rpartition(":")
    module = file.replace("\\", "/").rpartition("/")[2].removesuffix(".py")
    return (module, name) if module.isidentifier() and name.isidentifier() else ("my_plant", "plant")


def _made(effect: EffectEstimate) -> str:
    """``CATALOGUE["name"](place, variable)``, within its window and from its start where it has one."""
    given = [repr(place) for place in (effect.location, effect.variable) if place is not None]
    given += [] if effect.before is None else [f"before={effect.before!r}"]
    given += ["settled=False"] if not effect.settled and effect.name in _REMEMBERING else []
    given += [f"corner={number(effect.corner, 12)}"] if effect.corner else []
    made = f'CATALOGUE["{effect.name}"]({", ".join(given)})'
    span = tuple(name for name in effect.params if name in WINDOW)
    return f"starting({made}, {span!r})" if span else made


def _numbers(values: Mapping[str, float]) -> str:
    """A dict of numbers as Python writes it."""
    return "{" + ", ".join(f"{name!r}: {number(value, 12)}" for name, value in values.items()) + "}"
