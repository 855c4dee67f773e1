"""Where a report comes from: enough to repeat it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Provenance:
    """Where a report comes from: enough to repeat it.

    Attributes
    ----------
    title : str
        Title of the page; empty for the default one.
    simulator : str
        Class of the simulator, or the reference that the command line was given.
    access : str
        "rhs", "step" or "trajectory": what the simulator gives.
    n_runs, n_rows : int
        Runs and rows handed to ``fit``.
    dt : float
        Sample time.
    free : tuple of str
        Parameters that were re-tuned.
    effects : str
        "all", or the effects that were compared.
    seed : str
        ``random_state`` as given.
    include_law : bool
        Whether ``augmented_`` carries a certified law.
    settings : str
        What else was not left at its default, as in ``exclude=('drift',), tolerance=0.2``; it is in no other field.
    version, date : str
        Version of the package; date and time (ISO 8601, with the offset from UTC).
    files : tuple of str
        Files that were read (command line).
    command : str
        The command line; empty from Python.
    """

    title: str = ""
    simulator: str = ""
    access: str = ""
    n_runs: int = 0
    n_rows: int = 0
    dt: float = float("nan")
    free: tuple[str, ...] = ()
    effects: str = "all"
    seed: str = ""
    version: str = ""
    date: str = ""
    files: tuple[str, ...] = ()
    command: str = ""
    include_law: bool = True
    settings: str = ""


#: Of a report that was put together by hand.
UNKNOWN_PROVENANCE = Provenance()
