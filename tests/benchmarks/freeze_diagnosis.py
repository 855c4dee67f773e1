"""What does the diagnosis answer, bit by bit? Frozen rows, so that a refactoring can be proved by identity.

Run: ``python tests/benchmarks/freeze_diagnosis.py run OUT.jsonl.gz [--part K/N] [--sample M] [--only PREFIX]``, then
``python tests/benchmarks/freeze_diagnosis.py compare tests/benchmarks/frozen/rows.jsonl.xz OUT.jsonl.gz [--tolerance 1e-9]``;
``merge OUT PART ...`` joins the files of several processes. The recordings are read below ``SKSURROGATE_DATA``; without it
they are left out. Each row holds verdict, sentence, names, parameters, log likelihoods and every feature that the verdict is
decided on, numbers as ``float.hex``, the name of the rule that decided, and digests of the rest of the report.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import dataclasses
import gzip
import hashlib
import importlib
import inspect
import json
import lzma
import pkgutil
import signal
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from frozen_cases import CASES, Asked, Task

import sksurrogate.gap

#: Stored rows, and the processor seconds after which a case is left out; of one that is stored, so many times more.
FROZEN, LONGEST, PATIENCE = Path(__file__).parent / "frozen" / "rows.jsonl.xz", 90.0, 5.0
#: Parts of a row that a comparison leaves out.
INFORMATIVE = ("seconds", "left_out")


class TooLong(Exception):
    """A case took more processor time than is allowed."""


# ---- what the verdict is decided on ---------------------------------------------------------------------------------
class Decisions:
    """Wraps ``decide`` wherever a module of the diagnosis holds it, and keeps what the last call was given."""

    def __init__(self) -> None:
        self.features: dict[str, Any] = {}
        self.likelihoods: dict[str, float] = {}
        for module in pkgutil.walk_packages(sksurrogate.gap.__path__, "sksurrogate.gap."):
            importlib.import_module(module.name)
        modules = [m for name, m in sorted(sys.modules.items()) if name.split(".")[:2] == ["sksurrogate", "gap"]]
        originals = {id(f): f for m in modules if inspect.isfunction(f := vars(m).get("decide"))}
        if not originals:
            raise SystemExit("no module of sksurrogate.gap holds a function 'decide': tell Decisions where it is now")
        wrapped = {key: self._wrapper(f) for key, f in originals.items()}
        for module in modules:
            for name, value in list(vars(module).items()):
                if id(value) in wrapped:
                    setattr(module, name, wrapped[id(value)])

    def _wrapper(self, decide: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def seen(features: Any) -> Any:
            self.features = {f.name: getattr(features, f.name) for f in dataclasses.fields(features)}
            self.likelihoods = _likelihoods(sys._getframe(1))
            return decide(features)

        return seen

    def clear(self) -> None:
        """Forget the last case."""
        self.features, self.likelihoods = {}, {}


def _likelihoods(frame: Any) -> dict[str, float]:
    """Log likelihood of the null and of what stands, of the search that a caller holds."""
    while frame is not None:
        for value in list(frame.f_locals.values()):
            held = getattr(value, "__dict__", {})
            search = held.get("search", value)
            own = getattr(search, "__dict__", {})
            if own.get("null") is not None and own.get("final") is not None:
                return {name: float(own[name].log_likelihood) for name in ("null", "final")}
        frame = frame.f_back
    return {}


# ---- rows -----------------------------------------------------------------------------------------------------------
def plain(value: Any) -> Any:
    """Any part of a report as JSON, numbers as ``float.hex``; objects by the name of their class."""
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, (tuple, list, Sequence)):
        return [plain(one) for one in value]
    return type(value).__name__


def digest(value: Any) -> str:
    """Twelve hexadecimal digits that stand for a part of a report."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()[:12]


def effect_row(effect: Any) -> dict[str, Any]:
    """A named effect; equivalents sorted."""
    return {
        "name": effect.name,
        "location": effect.location,
        "variable": effect.variable,
        "params": plain(effect.params),
        "intervals": plain(effect.intervals),
        "probability": plain(float(effect.probability)),
        "share": plain(float(effect.share)),
        "equivalents": sorted([list(key) for key in effect.equivalents], key=str),
    }


def answer_row(report: Any, decisions: Decisions) -> dict[str, Any]:
    """What a diagnosis said."""
    shrink = {f.name: plain(getattr(report.shrink, f.name)) for f in dataclasses.fields(report.shrink)}
    return {
        "verdict": report.verdict,
        "rule": getattr(getattr(report, "reasons", None), "rule", None),
        "sentence": report.sentence,
        "effects": [effect_row(effect) for effect in report.effects],
        "where": [report.where.location, report.where.kind],
        "log_likelihood": plain(decisions.likelihoods),
        "shrink": {k: v for k, v in shrink.items() if k != "by_output"},
        "features": plain(decisions.features),
        "digests": {
            "ranking": digest(report.ranking),
            "retuned": digest(report.retuned),
            "where": digest(report.where),
            "by_output": digest(report.shrink.by_output),
            "missing_term": digest(report.missing_term),
            "next_experiment": digest(report.next_experiment),
            "why": digest([effect.why for effect in report.effects]),
            "notes": digest(report.notes),
            "traces": digest(report.traces),
        },
    }


def _expired(*_: Any) -> None:
    raise TooLong


def row_of(task: Task, decisions: Decisions, frozen: dict[str, Any]) -> dict[str, Any]:
    """Ask one case; an error or a case that takes too long is a row too."""
    row: dict[str, Any] = {"id": task.id, **task.facts}
    if "left_out" in frozen:
        return {**row, "left_out": frozen["left_out"]}
    limit = LONGEST * PATIENCE if frozen else LONGEST
    decisions.clear()
    started = None
    try:
        asked: Asked = task.prepare()
        row |= asked.facts
        started = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, limit)
        report = asked.diagnose()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        row |= answer_row(report, decisions)
    except TooLong:
        row["left_out"] = f"more than {limit:.0f} s of processor time"
    except Exception as error:
        row["error"] = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    row["seconds"] = round(time.process_time() - started, 2) if started is not None else None
    return row


# ---- files ----------------------------------------------------------------------------------------------------------
def read_rows(path: str | Path) -> dict[str, dict[str, Any]]:
    """Rows by their id; a last line that was broken off is dropped."""
    opened = lzma.open if str(path).endswith(".xz") else gzip.open
    rows: dict[str, dict[str, Any]] = {}
    try:
        with opened(path, "rt", encoding="utf-8") as file:
            for line in file:
                row = json.loads(line)
                rows[row["id"]] = row
    except (EOFError, json.JSONDecodeError):
        print(f"{path}: broken off after {len(rows)} rows", file=sys.stderr)
    return rows


def line_of(row: dict[str, Any]) -> bytes:
    """A row as a line."""
    return (json.dumps(row, separators=(",", ":"), ensure_ascii=False) + "\n").encode()


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """All rows at once, in the order of the cases; the same rows give the same bytes."""
    order = {task.id: k for k, task in enumerate(CASES)}
    lines = b"".join(line_of(row) for row in sorted(rows, key=lambda row: (order.get(row["id"], 10**9), row["id"])))
    packed = lzma.compress(lines, preset=9) if path.suffix == ".xz" else gzip.compress(lines, mtime=0)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(packed)


# ---- commands -------------------------------------------------------------------------------------------------------
def sample(tasks: Sequence[Task], frozen: dict[str, dict[str, Any]], count: int) -> list[Task]:
    """A fixed subset spread over the kinds of cases: in turn the cheapest whose plant and rule were taken least."""
    groups: dict[str, list[Task]] = {}
    for task in tasks:
        groups.setdefault(task.group, []).append(task)
    seconds = {key: row.get("seconds") or 0.0 for key, row in frozen.items() if "verdict" in row}
    used: Counter[Any] = Counter()
    chosen: list[Task] = []

    def weight(task: Task) -> tuple[int, float]:
        row = frozen.get(task.id, {})
        return used[row.get("plant")] + 2 * used[row.get("rule")], seconds.get(task.id, np.inf)

    while len(chosen) < count and any(groups.values()):
        for group in groups.values():
            if group and len(chosen) < count:
                task = min(group, key=weight)
                group.remove(task)
                chosen.append(task)
                row = frozen.get(task.id, {})
                used.update([row.get("plant"), row.get("rule")])
    return chosen


def run(out: Path, part: str, count: int | None, only: str) -> None:
    """Ask the cases that OUT does not hold yet; rows are appended as they come."""
    frozen = read_rows(FROZEN) if FROZEN.exists() else {}
    tasks = [task for task in CASES if task.id.startswith(only)]
    tasks = sample(tasks, frozen, count) if count else tasks
    if all(task.id in frozen for task in tasks):  # the cheap ones first
        tasks = sorted(tasks, key=lambda task: frozen[task.id].get("seconds") or 0.0)
    k, n = (int(number) for number in part.split("/"))
    tasks = tasks[k::n]
    out.parent.mkdir(parents=True, exist_ok=True)
    done = read_rows(out) if out.exists() else {}
    if out.exists():
        write_rows(out, list(done.values()))
    decisions = Decisions()
    signal.signal(signal.SIGPROF, _expired)
    warnings.simplefilter("ignore")
    for task in tasks:
        if task.id in done:
            continue
        row = row_of(task, decisions, frozen.get(task.id, {}))
        with open(out, "ab") as file:
            file.write(gzip.compress(line_of(row)))
        said = row.get("verdict") or row.get("error") or row.get("left_out")
        print(f"{row['id']}: {said}, {row.get('rule')}; {row.get('seconds')} s", flush=True)


def merge(out: Path, parts: Sequence[Path]) -> None:
    """Rows of several files in one."""
    rows = {key: row for part in parts for key, row in read_rows(part).items()}
    write_rows(out, list(rows.values()))
    print(f"{len(rows)} rows, {out.stat().st_size / 1e3:.0f} kB")


def flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a row with their paths."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if pairs is None:
        yield path, value
        return
    if not value:
        yield path, "empty"
    for key, one in pairs:
        yield from flat(one, f"{path}.{key}" if path else str(key))


def number(value: Any) -> float | None:
    """The number behind ``float.hex``."""
    if isinstance(value, str) and value.lstrip("-").startswith(("0x", "inf", "nan")):
        return float.fromhex(value)
    return None


def same(old: Any, new: Any, tolerance: float) -> bool:
    """Equal, or numbers within a relative tolerance."""
    a, b = number(old), number(new)
    if tolerance and a is not None and b is not None:
        return a == b or (np.isnan(a) and np.isnan(b)) or bool(abs(a - b) <= tolerance * max(abs(a), abs(b)))
    return bool(old == new)


def shown(value: Any) -> Any:
    """A leaf for the eye."""
    real = number(value)
    return value if real is None else f"{real:.17g}"


def compare(old_path: Path, new_path: Path, tolerance: float) -> int:
    """Print what changed; 1 if anything did."""
    old, new = read_rows(old_path), read_rows(new_path)
    both = [key for key in old if key in new and "left_out" not in {**old[key], **new[key]}]
    identical, fields, added, lines = 0, Counter(), Counter(), []
    for key in both:
        a, b = (dict(flat(rows[key])) for rows in (old, new))
        skipped = {k for k in {*a, *b} if k in INFORMATIVE or (tolerance and k.startswith("digests."))}
        added.update(k for k in b if k not in a and k.startswith(("features.", "digests.", "shrink.")))
        names = [k for k in [*a, *(k for k in b if k not in a)] if k not in skipped and k not in added]
        changed = [k for k in names if not same(a.get(k, "absent"), b.get(k, "absent"), tolerance)]
        identical += not changed
        fields.update(changed)
        lines += [f"{key}: {k}: {shown(a.get(k, 'absent'))} -> {shown(b.get(k, 'absent'))}" for k in changed]
    print(f"{identical} of {len(both)} rows in both files are identical" + (f" within {tolerance:g}" * bool(tolerance)))
    if added:
        print(f"fields that only the second file has, not compared: {', '.join(sorted(added))}")
    spent = [sum(rows[key].get("seconds") or 0.0 for key in both) for rows in (old, new)]
    print(f"processor seconds {spent[0]:.0f} -> {spent[1]:.0f} (ratio {spent[1] / max(spent[0], 1e-9):.3f})")
    for name, count in fields.most_common():
        print(f"  {count:4d}  {name}")
    print("\n".join(lines))
    return int(bool(lines) or not both)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run", help="ask the cases and append rows")
    running.add_argument("out", type=Path)
    running.add_argument("--part", default="0/1", help="K/N: every N-th case from the K-th on")
    running.add_argument("--sample", type=int, help="a fixed subset of that many cases, cheap ones")
    running.add_argument("--only", default="", help="cases whose id begins so, for example recording/")
    merging = commands.add_parser("merge", help="join files of rows")
    merging.add_argument("out", type=Path)
    merging.add_argument("parts", type=Path, nargs="+")
    comparing = commands.add_parser("compare", help="print what changed")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument(
        "--tolerance", type=float, default=0.0, help="relative, of numbers; digests are left out then"
    )
    given = parser.parse_args()
    if given.command == "run":
        run(given.out, given.part, given.sample, given.only)
    elif given.command == "merge":
        merge(given.out, given.parts)
    else:
        return compare(given.old, given.new, given.tolerance)
    return 0


if __name__ == "__main__":
    sys.exit(main())
