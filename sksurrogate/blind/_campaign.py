"""Many cases: drawn, sealed, diagnosed elsewhere, opened, scored, stored; in blocks that can be taken up again."""

from __future__ import annotations

import json
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed, effective_n_jobs

from sksurrogate._files import append_line
from sksurrogate._fingerprint import fingerprint
from sksurrogate._parallel._interrupts import workers
from sksurrogate.blind._cases import ARMS, draw
from sksurrogate.blind._follow import followed
from sksurrogate.blind._own_simulator import plant_of
from sksurrogate.blind._records import RECORDS, as_recorded
from sksurrogate.blind._retune import beyond_retuning
from sksurrogate.blind._robot_arms import ROBOT_ARMS, draw_robot_case, score_robot_case
from sksurrogate.blind._score import score
from sksurrogate.blind._seal import close_seal
from sksurrogate.blind._solve import DEFAULT, Solver
from sksurrogate.blind._table import BlindResult, stored_rows
from sksurrogate.exceptions import SurrogateError


def run_blind_check(
    cases: int = 100,
    arms: str | Sequence[str] = "all",
    simulator: Any = None,
    seed: int | None = None,
    *,
    X: Any = None,
    groups: Any = None,
    input_ranges: Any = None,
    x0_spread: Any = None,
    resume: Any = None,
    n_jobs: int | None = None,
    diagnosis: str = DEFAULT,
    limit: float = 600.0,
    follow_up: float = 1.0,
    verbose: int = 0,
    record: str = "complete",
) -> BlindResult:
    """Check the diagnosis on plants whose effect is withheld from it.

    Each case draws a plant, an effect, its size, noise, disturbance and experiments; seals the truth in a file; gives
    only the simulator and the data to a new process; then opens the truth and scores the answer.

    Parameters
    ----------
    cases : int, default=100
        Number of cases, spread evenly over the arms.
    arms : "all", str or sequence of str, default="all"
        Which questions are asked; see :data:`sksurrogate.blind.ARMS`. Robots (:data:`sksurrogate.blind.ROBOT_ARMS`) are asked
        by name only: they need MuJoCo and more time.
    simulator : object with ``rhs``, optional
        Your own simulator instead of the built-in plants.
    seed : int, optional
        Fresh entropy by default. With a seed the same cases come again; case k does not depend on ``cases``.
    X, groups : array-like (n_samples, n_inputs), (n_samples,), optional
        Recorded inputs of your own plant, used as they are; without them excitations are drawn within ``input_ranges``.
    input_ranges : dict of (low, high), optional
        For your own simulator: feasible range of each input.
    x0_spread : array-like (n_states,), optional
        For your own simulator: how far initial states lie about ``simulator.x0``; by default 0.
    resume : path, optional
        File of rows (JSON lines): rows found there count, those of another diagnosis or another simulator of your own
        excepted; new ones are appended. Where the file cannot be written, a warning says so and the rows stay in the
        result.
    n_jobs : int, optional
        Cases at once, through joblib; each has a diagnosing process of its own.
    diagnosis : str, optional
        ``module:function`` that answers a :class:`Question`; the package's diagnosis by default.
    limit : float, default=600
        Seconds allowed for one diagnosis.
    follow_up : float, default=1.0
        Share of the cases with tied names in which the suggested next experiment is carried out: two more diagnoses
        among the tied names, with its run added and, as a control, with the first run recorded once more.
    verbose : int, default=0
        1 prints the hash of each sealed truth before the diagnosis starts, and each row.
    record : {"complete", "missing", "two_rate", "jitter"}, default="complete"
        How the same cases are recorded: all readings; a fifth of them lost; every other output read at every fifth sample;
        stamps that jitter by a fifth of a sample, with inputs held between them. Suggested experiments of records that are
        not complete are not carried out.

    Returns
    -------
    BlindResult
        Rows, table, page; of the cases done so far after an interrupt.

    Raises
    ------
    SurrogateError
        An arm is unknown, an option is out of range, or the simulator cannot be used.

    Examples
    --------
    >>> from sksurrogate.blind import run_blind_check
    >>> result = run_blind_check(1, "none", seed=3)  # doctest: +SKIP
    """
    names = _arms(arms)
    _options(cases, n_jobs, follow_up, resume, record, limit, diagnosis)
    if record != "complete" and set(names) & set(ROBOT_ARMS):
        raise SurrogateError(
            f"record={record!r}: robots are recorded complete; leave {sorted(set(names) & set(ROBOT_ARMS))} out."
        )
    plant = runs = None
    if simulator is not None:
        plant, runs = plant_of(simulator, X=X, groups=groups, input_ranges=input_ranges, x0_spread=x0_spread)
    own = None  # the value of your own simulator and of what its cases are drawn from
    if simulator is not None and resume is not None:
        own = fingerprint((simulator, X, groups, input_ranges, x0_spread), "with resume=, simulator")
    rows = [row for row in stored_rows(resume) if _belongs(row, diagnosis, own, record)]
    todo = _not_asked(names, int(cases), rows, seed)
    jobs = ((arm, entropy, plant, runs, diagnosis, limit, follow_up, verbose, record) for arm, entropy in todo)
    complete = True
    try:
        for row in _answered(jobs, n_jobs):
            row["cases_at_once"] = effective_n_jobs(n_jobs)
            row |= {} if own is None else {"simulator": own}
            rows.append(row)
            _store(resume, row)
            if verbose:
                print(f"[blind] {line(row)}", flush=True)
    except KeyboardInterrupt:
        complete = False
        if not rows:
            raise
    return BlindResult(tuple(row for row in rows if row["arm"] in names), complete)


def _not_asked(
    names: Sequence[str], cases: int, rows: Sequence[dict[str, Any]], seed: int | None
) -> list[tuple[str, int | None]]:
    """Arm and entropy of the cases that no row answers, the arms in turn; without a seed as many of each arm as are missing."""
    wanted = [(names[k % len(names)], k // len(names)) for k in range(cases)]
    if seed is None:
        have = {arm: sum(row["arm"] == arm for row in rows) for arm in names}
        return [(arm, None) for arm, k in wanted if k >= have[arm]]
    known = {(row["arm"], row["seed"]) for row in rows}
    return [(arm, s) for arm, k in wanted if (arm, s := _entropy(seed, k)) not in known]


def _options(cases: Any, n_jobs: Any, follow_up: Any, resume: Any, record: Any, limit: Any, diagnosis: Any) -> None:
    """Refuse what cannot be done before anything is drawn."""
    module, _, function = str(diagnosis).partition(":")
    if not all(part.isidentifier() for part in [*module.split("."), function]):
        raise SurrogateError(
            f"diagnosis={diagnosis!r}: write module:function of a module that can be imported, no path."
        )
    if record not in RECORDS:
        raise SurrogateError(f"record={record!r} is unknown; use one of {list(RECORDS)}.")
    if not (isinstance(cases, (int, np.integer)) and cases >= 1):
        raise SurrogateError(f"cases={cases!r}: expected a whole number of at least 1.")
    if isinstance(limit, bool) or not (isinstance(limit, Real) and float(limit) > 0.0):
        raise SurrogateError(f"limit={limit!r}: expected the seconds for a case, above 0.")
    if n_jobs == 0:
        raise SurrogateError("n_jobs=0: expected 1 or more cases at once, or -1 for all cores.")
    if not 0 <= follow_up <= 1:
        raise SurrogateError(f"follow_up={follow_up!r}: expected a share between 0 and 1.")
    if resume is not None and Path(resume).is_dir():
        raise SurrogateError(f"resume={str(resume)!r} is a folder: name a file in it.")
    if resume is not None and not Path(resume).absolute().parent.is_dir():
        raise SurrogateError(
            f"resume={str(resume)!r}: there is no folder {str(Path(resume).absolute().parent)!r}; make it first."
        )


def _entropy(seed: int, k: int) -> int:
    """Entropy of case k."""
    return int(np.random.SeedSequence([seed, k]).generate_state(1, np.uint64)[0])


def _arms(arms: str | Sequence[str]) -> list[str]:
    """Names of arms."""
    if arms == "all":
        return list(ARMS)
    names = [arms] if isinstance(arms, str) else list(arms)
    names = [part for name in names for part in name.split(",") if part]
    known = [*ARMS, *ROBOT_ARMS]
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise SurrogateError(f"arms: {unknown or arms!r} unknown; use 'all' or one or several of {known}.")
    return names


def _answered(jobs: Iterable[tuple[Any, ...]], n_jobs: int | None) -> Iterator[dict[str, Any]]:
    """Rows as they come."""
    if effective_n_jobs(n_jobs) == 1:
        with Solver() as solver:
            for job in jobs:
                yield run_case(*job, solver=solver)
    else:
        yield from workers(n_jobs, return_as="generator_unordered", batch_size=1)(
            delayed(run_case)(*job) for job in jobs
        )


#: Diagnosing processes of a worker, one for each diagnosis asked.
_SOLVERS: dict[str, Solver] = {}


def run_case(
    arm: str,
    entropy: int | None = None,
    plant: Any = None,
    runs: Any = None,
    diagnosis: str = DEFAULT,
    limit: float = 600.0,
    follow_up: float = 1.0,
    verbose: int = 0,
    record: str = "complete",
    *,
    solver: Solver | None = None,
    look: Callable[[Any, Any], None] | None = None,
) -> dict[str, Any]:
    """Draw, seal, ask, open, score.

    Parameters
    ----------
    arm : str
    entropy : int, optional
        Fresh by default.
    plant, runs : PlantSpec, list of ndarray, optional
        A plant of the user's own.
    diagnosis, limit, follow_up, verbose, record : str, float, float, int, str, optional
        As in :func:`run_blind_check`.
    solver : Solver, optional
        Process to be asked; kept from case to case.
    look : callable, optional
        Called with case and answer, before the scores.

    Returns
    -------
    dict
        A row, see :func:`~sksurrogate.blind._score.score`.

    Examples
    --------
    >>> from sksurrogate.blind import run_case
    >>> row = run_case("none", 7)   # doctest: +SKIP
    >>> row["verdict"]   # doctest: +SKIP
    'none'
    """
    started, robot = time.perf_counter(), arm in ROBOT_ARMS
    try:
        drawn: Any = draw_robot_case(arm, entropy) if robot else draw(arm, entropy, plant=plant, runs=runs)
        case: Any = drawn if robot else as_recorded(drawn, record)
    except (SurrogateError, ArithmeticError, np.linalg.LinAlgError) as error:
        return {"arm": arm, "seed": entropy, "error": f"not drawn: {error}", "right": None}
    solver = solver or _SOLVERS.setdefault(diagnosis, Solver(diagnosis))
    solver.function, solver.limit = diagnosis, limit
    with tempfile.TemporaryDirectory(prefix="sealed-") as folder:
        seal = close_seal(case.facts, folder)
        if verbose:
            print(f"[blind] sealed: {arm} sha256 {seal.sha256}", flush=True)
        answer = solver.ask(case.question)
        opened = seal.open()
    if opened["truths"] != case.facts["truths"]:
        raise SurrogateError("the seal holds another truth than the case: the run does not count.")
    if look is not None:
        look(case, answer)
    row = score_robot_case(case, answer) if robot else score(drawn, answer)  # of the even, complete record
    if arm == "detuned":
        row["gap_beyond_retuning"] = beyond_retuning(drawn)
    if record != "complete":
        row["record"] = record
    elif not robot and np.random.default_rng([case.facts["seed"], 18]).random() < follow_up:
        row |= followed(case, answer, row, solver.ask)
    return {**row, "diagnosis": diagnosis, "sha256": seal.sha256, "whole_seconds": time.perf_counter() - started}


def line(row: dict[str, Any]) -> str:
    """A row in a line."""
    if "error" in row:
        return f"{row['arm']} seed={row['seed']}: {row['error']}"
    truths = [f"{t['name']}@{t['location']}" for t in row["truths"]]
    named = [f"{e['name']}@{e['location']}" for e in row["effects"]]
    return (
        f"{'right' if row['right'] else 'WRONG'} {row['arm']} seed={row['seed']} {row['plant']}: "
        f"{truths or 'nothing'} -> {row['verdict']} {named}; {row['seconds']:.1f} s"
    )


def _store(path: Any, row: dict[str, Any]) -> None:
    """Append a row; a disk that is full must not cost the rows that are known."""
    if path is None:
        return
    try:
        append_line(path, json.dumps(row, default=float))
    except OSError as error:
        warnings.warn(
            f"resume={str(path)!r} cannot be written ({error.strerror or error}): this row is in the result alone.",
            RuntimeWarning,
            stacklevel=3,
        )


def _belongs(row: dict[str, Any], diagnosis: str, own: str | None, record: str) -> bool:
    """Whether a stored row answers what is asked now."""
    alike = row.get("diagnosis", diagnosis) == diagnosis and row.get("record", "complete") == record
    return alike and row.get("simulator") == own
