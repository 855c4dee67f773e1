"""The provenance of a report, at the moment of its diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from importlib import metadata
from inspect import signature
from numbers import Real
from typing import Any

import numpy as np

from sksurrogate.effects._variable import value_of
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.render._headline import sentence_of
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._provenance import Provenance
from sksurrogate.physics._simulator import Plant, units_of

#: Effects longer than this list are counted instead of named.
LONGEST_LIST = 12
#: Parameters of a diagnoser that decide what it answers, and have no field of their own.
OTHER_SETTINGS = (
    "exclude",
    "plausible",
    "bounds",
    "priors",
    "time",
    "clock_offset",
    "tolerance",
    "correction",
    "time_limit",
)


def with_provenance(
    report: GapReport, diagnoser: Any, final: BaseCandidate, n_runs: int, n_rows: int, seconds: float
) -> GapReport:
    """The report with its sentence, its provenance, the nominal parameters, the units, the ranges of the signals and the time it took."""
    plant = final.problem.plant
    provenance = Provenance(
        simulator=type(plant.simulator).__name__,
        access=plant.access,
        n_runs=n_runs,
        n_rows=n_rows,
        dt=plant.dt,
        free=final.problem.free,
        effects=_asked(diagnoser.effects),
        seed=str(diagnoser.random_state),
        include_law=bool(diagnoser.include_law),
        settings=_settings(diagnoser),
        version=_version(),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
    )
    known = replace(
        report,
        units=units_in(plant),
        nominal={name: float(value) for name, value in plant.params.items() if isinstance(value, Real)},
        ranges=_ranges({**final.signals, **_differences(final)}),
        provenance=provenance,
        seconds=seconds,
    )
    return replace(known, sentence=sentence_of(known))


def _differences(final: BaseCandidate) -> dict[str, np.ndarray]:
    """Differences of signals on which parameters depend, along the data."""
    pairs = [e for e in final.effects if e.kind == "parameter" and len(e.signals) > 1]
    return {str(e.variable): value_of(e.variable, [final.signals[name] for name in e.signals]) for e in pairs}


def _ranges(signals: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    """Where the signals were in the data."""
    known = {name: values for name, values in signals.items() if np.isfinite(values).any()}
    return {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in known.items()}


def units_in(plant: Plant) -> dict[str, str]:
    """Units of the plant's own names, ports and time; an FMU knows more variables than it shows."""
    ports = getattr(plant.simulator, "ports", None) or ()
    known = {*plant.states, *plant.inputs, *plant.outputs, *plant.params, *ports, "time"}
    return {name: unit for name, unit in units_of(plant.simulator).items() if name in known}


def _asked(effects: Any) -> str:
    """The effects that were asked for, in words."""
    if effects is None:
        return "all"
    listed = [effects] if isinstance(effects, str) else list(effects)
    names = [one if isinstance(one, str) else str(getattr(one, "name", one)) for one in listed]
    return ", ".join(names) if len(names) <= LONGEST_LIST else f"{len(names)} effects"


def _settings(diagnoser: Any) -> str:
    """Other settings that are not at their defaults, in words."""
    defaults = {name: one.default for name, one in signature(type(diagnoser).__init__).parameters.items()}
    given = {name: getattr(diagnoser, name) for name in OTHER_SETTINGS}
    return ", ".join(f"{name}={value!r}" for name, value in given.items() if repr(value) != repr(defaults[name]))


def _version() -> str:
    """Version of the installed package; empty in a tree that is not installed."""
    try:
        return metadata.version("sksurrogate")
    except metadata.PackageNotFoundError:
        return ""
