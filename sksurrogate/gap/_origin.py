"""The provenance of a report, at the moment of its diagnosis."""

from __future__ import annotations

from datetime import datetime
from importlib import metadata
from typing import Any

from sksurrogate.gap.results._provenance import Provenance
from sksurrogate.physics._simulator import Plant

__all__ = ["origin_of"]

#: Effects longer than this list are counted instead of named.
LONGEST_LIST = 12


def origin_of(diagnoser: Any, plant: Plant, n_runs: int, n_rows: int, free: tuple[str, ...]) -> Provenance:
    """Where the report of this diagnoser comes from."""
    return Provenance(
        simulator=type(plant.simulator).__name__,
        access=plant.access,
        n_runs=n_runs,
        n_rows=n_rows,
        dt=plant.dt,
        free=free,
        effects=_asked(diagnoser.effects),
        seed=str(diagnoser.random_state),
        version=_version(),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
    )


def _asked(effects: Any) -> str:
    """The effects that were asked for, in words."""
    if effects is None:
        return "all"
    listed = [effects] if isinstance(effects, str) else list(effects)
    names = [one if isinstance(one, str) else str(getattr(one, "name", one)) for one in listed]
    return ", ".join(names) if len(names) <= LONGEST_LIST else f"{len(names)} effects"


def _version() -> str:
    """Version of the installed package; empty in a tree that is not installed."""
    try:
        return metadata.version("sksurrogate")
    except metadata.PackageNotFoundError:
        return ""
