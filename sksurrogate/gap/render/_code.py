"""Code to paste: the corrected simulator, a simulation, a linearisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._onset import WINDOW
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.gap.render._values import is_wrong_parameter, number
from sksurrogate.gap.results._effect_estimate import SHAPE_NUMBERS, EffectEstimate
from sksurrogate.gap.results._report_data import ReportData

#: Effects that may begin elsewhere than at rest.
_WITH_HIDDEN_STATES = {name for name, kind in CATALOGUE.items() if issubclass(kind, HiddenEffect)}

_FROM_FILE = """\
from sksurrogate.cli import load_simulator

simulator = load_simulator({reference!r})

"""
_FROM_DIAGNOSER = """\

simulator = diagnoser.simulator  # as it was diagnosed
"""
_BUILD = """\
from sksurrogate.effects import {names}
{simulator}model = AugmentedSimulator(
    simulator,
    effects=[{effects}],
    values=[{values}],{options}
)
"""
_AUGMENTED = """\
model = diagnoser.augmented_
"""
_SAVED = """\
from sksurrogate.effects import load_augmented
{simulator}model = load_augmented(simulator, "better.json")  # which the command writes with --save better.json
"""
_SIMULATE = """\
# U: the inputs of one run, (n_samples, {n_inputs}), columns {inputs}
Y = model.simulate(U)  # from the initial state of the simulator; x0=[...] is another one
"""
_LINEARISE = """
from sksurrogate.physics import linearise

states, _ = model.simulate_states(U)
k = len(U) // 2  # the sample about which the model is linearised
local = linearise(model, states[k], U[k])  # local.states, local.A, local.B, local.C, local.D
# sksurrogate.physics.steady_state(model, U[k]) is the state at rest, where the plant has one
# local.to_control() is a system of python-control, for control.lqr and the like
"""


def code_of(report: ReportData) -> str:
    """Lines that use the result of a diagnosis.

    The effects of the catalogue are written out with their numbers; others are taken from the diagnoser.
    """
    n_inputs = len(report.inputs)
    out = _built(report) + "\n" + _SIMULATE.format(n_inputs=n_inputs, inputs=list(report.inputs))
    return out + _LINEARISE if len(report.states) and n_inputs and report.provenance.access != "trajectory" else out


def _built(report: ReportData) -> str:
    """How the corrected simulator is made."""
    retuned = {str(row["parameter"]): float(row["value"]) for row in report.retuned}
    effects = [e for e in report.effects if not (is_wrong_parameter(e) and e.location in retuned)]
    reference = report.provenance.simulator
    simulator = _FROM_FILE.format(reference=reference) if ":" in reference else _FROM_DIAGNOSER
    if not all(effect.name in CATALOGUE for effect in effects) or report.certified_law is not None:
        return _SAVED.format(simulator=simulator) if ":" in reference else _AUGMENTED
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
        simulator=simulator,
        effects=", ".join(made := [*map(_made, effects)]),
        names=f"CATALOGUE, AugmentedSimulator{', starting' if any(one.startswith('starting') for one in made) else ''}",
        values=", ".join(_numbers(effect.params) for effect in effects),
        options="".join(f"\n    {line}" for line in options),
    )


def _runs(effects: Sequence[EffectEstimate]) -> str:
    """Labels of the runs of every effect, None for all."""
    return f"[{', '.join('None' if effect.runs is None else repr(list(effect.runs)) for effect in effects)}]"


def _made(effect: EffectEstimate) -> str:
    """``CATALOGUE["name"](place, variable)``, within its window and from its start where it has one."""
    given = [repr(place) for place in (effect.location, effect.variable) if place is not None]
    given += [] if effect.before is None else [f"before={effect.before!r}"]
    given += ["settled=False"] if not effect.settled and effect.name in _WITH_HIDDEN_STATES else []
    given += [f"{name}={number(value, 12)}" for name in SHAPE_NUMBERS if (value := getattr(effect, name))]
    made = f'CATALOGUE["{effect.name}"]({", ".join(given)})'
    span = tuple(name for name in effect.params if name in WINDOW)
    return f"starting({made}, {span!r})" if span else made


def _numbers(values: Mapping[str, float]) -> str:
    """A dict of numbers as Python writes it."""
    return "{" + ", ".join(f"{name!r}: {_written(value)}" for name, value in values.items()) + "}"


def _written(value: float) -> str:
    """A number as Python reads it."""
    return number(value, 12) if np.isfinite(value) else f'float("{value}")'
