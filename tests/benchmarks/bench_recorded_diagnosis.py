"""What does the diagnosis say of measured plants, and is it right?

Run: ``SKSURROGATE_DATA=FOLDER python tests/benchmarks/bench_recorded_diagnosis.py [NAME ...] [--rows FILE.jsonl]``. Every recording of
``recordings.py`` is diagnosed in a process of its own with one worker, linear algebra in one thread; rows are appended to the file
as they come, so that an interrupted run goes on where it stopped. Prints a table: RMSE over the outputs' deviation on rows that
nobody fitted (simulator, re-tuned, generic correction, with the names), budget, verdict, names with probability, accepted names,
processor seconds and the largest memory.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import multiprocessing
import resource
import time
import warnings
from pathlib import Path
from typing import Any

from recordings import NAMES, problem

from sksurrogate.gap import GapDiagnoser

#: Probability from which a name is given.
GIVEN = 0.9


def diagnosed(name: str) -> dict[str, Any]:
    """The answer for one recording."""
    warnings.simplefilter("ignore")
    one = problem(name)
    before = time.process_time()
    diagnoser = GapDiagnoser(one.simulator, free_params=one.free, n_jobs=1, random_state=0)
    report = diagnoser.fit(one.X, one.y, groups=one.groups).report_
    shrink = report.shrink
    places = set(one.places)
    found = [
        {
            "name": effect.name,
            "location": effect.location,
            "variable": effect.variable,
            "probability": effect.probability,
            "share": effect.share,
            "accepted": bool(
                {effect.name, *(key[0] for key in effect.equivalents)} & set(one.accepted)
                and (not places or {effect.location, *(key[1] for key in effect.equivalents)} & places)
            ),
        }
        for effect in report.effects
    ]
    return {
        "recording": name,
        "rows": len(one.y),
        "real": one.real,
        "accepted": list(one.accepted),
        "verdict": report.verdict,
        "rule": report.reasons.rule,
        "effects": found,
        "before": float(shrink.before),
        "retuned": float(shrink.after_retuning),
        "correction": float(shrink.after_correction),
        "after": float(shrink.after),
        "law": float(getattr(shrink, "after_law", float("nan"))),
        "budget": {row["part"]: float(row["share"]) for row in report.budget},
        "where": report.where.location,
        "seconds": time.process_time() - before,
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def right(row: dict[str, Any]) -> str:
    """Whether an answer agrees with what is accepted."""
    if row["verdict"] not in ("explained", "partial"):
        return "no name was due" if not row["accepted"] else "not named"
    good = [effect["accepted"] for effect in row["effects"]]
    if not row["accepted"]:
        return "false name"
    return "yes" if good and all(good) else "yes, with others" if any(good) else "no"


def line(row: dict[str, Any]) -> str:
    """One line of the table."""
    names = "; ".join(
        f"{e['name']} at {e['location']}"
        + (f" in {e['variable']}" if e["variable"] else "")
        + f" ({e['probability']:.2f})"
        for e in row["effects"]
    )
    errors = " | ".join(
        "-" if value != value else f"{value:.4f}"
        for value in (row["before"], row["retuned"], row["correction"], row["after"])
    )
    shares = ", ".join(f"{part} {100 * share:.0f} %" for part, share in row["budget"].items() if share >= 0.005)
    return (
        f"| {row['recording']} | {row['rows']} | {errors} | {row['verdict']} | {names or '-'} | {right(row)} | {shares} | "
        f"{row['seconds']:.0f} | {row['megabytes']:.0f} |"
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(NAMES), help="recordings; all by default")
    parser.add_argument("--rows", type=Path, default=Path("recorded_rows.jsonl"), help="file of the answers")
    given = parser.parse_args()
    unknown = [name for name in given.names if name not in NAMES]
    if unknown:
        parser.error(f"no recording is called {', '.join(unknown)}; expected some of {', '.join(NAMES)}")
    known = [json.loads(text) for text in given.rows.read_text().splitlines()] if given.rows.exists() else []
    rows = {row["recording"]: row for row in known}
    spawned = multiprocessing.get_context("spawn")
    for name in given.names or NAMES:
        if name not in rows:
            with spawned.Pool(1, maxtasksperchild=1) as pool:
                rows[name] = pool.apply(diagnosed, (name,))
            with open(given.rows, "a", encoding="utf-8") as file:
                file.write(json.dumps(rows[name]) + "\n")
        print(line(rows[name]), flush=True)
    named = [row for row in rows.values() if row["accepted"]]
    good = [row for row in named if right(row).startswith("yes")]
    sure = sum(any(e["accepted"] and e["probability"] >= GIVEN for e in row["effects"]) for row in good)
    print(
        f"\n{len(good)} of {len(named)} recordings with an accepted name are named by it, {sure} with a stated probability of {GIVEN} or more"
    )


if __name__ == "__main__":
    main()
