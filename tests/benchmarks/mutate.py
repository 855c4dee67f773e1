"""Would the tests notice? Small faults are put into the package one at a time, and the tests that name the module are run.

    python tests/benchmarks/mutate.py [--faults 20] [--seed 0] [--folders kernels effects] [--limit 120] [--minutes 5]
                                      [--out rows.jsonl] [--again survivors.jsonl]

A fault is a changed operator, comparison, constant, connective or a dropped term, drawn evenly over the folders. The tests of a
module are the files that name it or one of its public names, those named as it is and those of its own folder first; where
they notice nothing, those of the modules that import it. A fault is *caught* when a test fails that passes without it, or a
file takes more than the limit and does not without it; a *survivor* when all pass; *undecided* otherwise. With `--out` a draw
goes on where it stopped; `--again` tries what was not caught once more.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "sksurrogate"
#: Test files that are run for one fault.
MOST_FILES = 3
#: Where faults are drawn, in turn; "." is the package's top.
FOLDERS = ["kernels", "effects", "gap", "physics", "linear", "features", "compose", "gap", "export", "neural", "."]
FOLDERS += ["gap", "model_selection", "datasets", "blind", "gap"]
_ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
_COMPARISONS = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


class Fault(NamedTuple):
    """One changed place of one file."""

    path: Path
    line: int
    start: int
    stop: int
    before: str
    after: str
    kind: str


def changed(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Kinds of faults that a node can have, and the node with each."""
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC and not _is_text(node):
        yield "operator", ast.BinOp(node.left, _ARITHMETIC[type(node.op)](), node.right)
        if isinstance(node.op, (ast.Add, ast.Sub)):
            yield "dropped term", node.left
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARISONS:
        yield "comparison", ast.Compare(node.left, [_COMPARISONS[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.BoolOp):
        yield "connective", ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield "sign", node.operand
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        yield "constant", ast.Constant(node.value * 2 if node.value else 1)


def _is_text(node: ast.BinOp) -> bool:
    """Whether texts are joined, or types are."""
    return any(isinstance(n, (ast.JoinedStr, ast.Constant)) and not isinstance(getattr(n, "value", 0), (int, float))
               for n in ast.walk(node))  # fmt: skip


def body_nodes(tree: ast.Module) -> Iterator[ast.AST]:
    """Expressions that are computed: no annotations, errors, defaults of parameters, decorators or lists of names."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.Raise, ast.Assert, ast.Import, ast.ImportFrom)):
            continue
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            waiting += node.body
            continue
        if isinstance(node, ast.AnnAssign):
            waiting += [node.value] if node.value is not None else []
            continue
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            continue
        if isinstance(node, ast.JoinedStr):
            continue
        yield node
        waiting += list(ast.iter_child_nodes(node))


def faults_of(path: Path) -> list[Fault]:
    """All faults that a file can have."""
    text = path.read_text(encoding="utf-8")
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    out = []
    for node in body_nodes(ast.parse(text)):
        for kind, other in changed(node):
            if "\n" not in text and not text.isascii():
                continue
            a = starts[node.lineno - 1] + len(text.splitlines()[node.lineno - 1].encode()[: node.col_offset].decode())
            last = text.splitlines()[node.end_lineno - 1]
            b = starts[node.end_lineno - 1] + len(last.encode()[: node.end_col_offset].decode())
            out.append(Fault(path, node.lineno, a, b, text[a:b], f"({ast.unparse(other)})", kind))
    return out


def drawn(n: int, seed: int, folders: list[str]) -> list[Fault]:
    """So many faults, the folders in turn, a file and one of its faults at random."""
    rng = random.Random(seed)
    groups = {
        folder: [p for p in sorted((PACKAGE / folder).rglob("*.py")) if p.name != "__init__.py"] for folder in folders
    }
    groups["."] = [p for p in sorted(PACKAGE.glob("*.py")) if p.name != "__init__.py"]
    out: list[Fault] = []
    while len(out) < n:
        folder = folders[len(out) % len(folders)]
        found = faults_of(rng.choice(groups[folder]))
        if found:
            out.append(rng.choice(found))
    return out


def listed_again(path: Path) -> list[Fault]:
    """Faults of a file of rows that were not caught, where the code still holds them."""
    out = []
    for row in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
        if row["said"] != "caught":
            same = [f for f in faults_of(ROOT / row["file"]) if (f.before, f.after) == (row["before"], row["after"])]
            out += sorted(same, key=lambda fault: abs(fault.line - row["line"]))[:1]
    return out


def module_of(path: Path) -> str:
    """Dotted name of a module."""
    return ".".join(("sksurrogate", *path.relative_to(PACKAGE).with_suffix("").parts))


def tests_of(path: Path) -> tuple[list[Path], list[Path]]:
    """Test files that name a module or its public names, most mentions first; then those of the modules that import it."""
    own, naming = path.relative_to(PACKAGE).parts[0], tests_naming(path)
    importing = re.compile(rf"^(from|import) {re.escape(module_of(path))}\b", re.M)
    further: dict[Path, int] = {}
    for other in sorted(PACKAGE.rglob("*.py")):
        if other.name != "__init__.py" and importing.search(other.read_text(encoding="utf-8")):
            for test, mentions in tests_naming(other).items():
                further[test] = further.get(test, 0) + mentions

    def first(found: dict[Path, int]) -> list[Path]:
        about = path.stem.strip("_")
        order = sorted(
            found, key=lambda test: (about in test.stem, test.parent.name == own, found[test], test.name), reverse=True
        )
        return order[:MOST_FILES]

    named = first(naming)
    return named, [test for test in first(further) if test not in named]


def tests_naming(path: Path) -> dict[Path, int]:
    """How often each test file names a module or its public names."""
    names = re.findall(r"^(?:class|def) ([A-Za-z]\w*)", path.read_text(encoding="utf-8"), re.M)
    out = {}
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        text = test.read_text(encoding="utf-8")
        mentions = 10 * text.count(module_of(path)) + sum(len(re.findall(rf"\b{name}\b", text)) for name in names)
        if mentions or (path.stem.strip("_") in test.stem and test.parent.name == path.parent.name):
            out[test] = mentions
    return out


def run_tests(folder: Path, tests: list[str], limit: float) -> tuple[int | None, list[str]]:
    """Return code of the fast tests with the package of a folder (None: longer than the limit), and those that failed."""
    env = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not slow"]
    command += ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), *tests]
    try:
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        return None, []
    failed = [
        str(folder / one) for one in re.findall(r"^(?:FAILED|ERROR) (\S+(?:\[.*?\])?)(?: - .*)?$", done.stdout, re.M)
    ]
    return done.returncode, failed


def decided(folder: Path, fault: Fault, tests: list[Path], limit: float) -> str:
    """Whether the tests notice a fault, one file after the other."""
    place, text = folder / fault.path.relative_to(ROOT), fault.path.read_text(encoding="utf-8")
    said = "survivor" if tests else "undecided"
    for test in map(str, tests):
        place.write_text(text[: fault.start] + fault.after + text[fault.stop :], encoding="utf-8")
        code, failed = run_tests(folder, [test], limit)
        place.write_text(text, encoding="utf-8")
        if code in (None, 1, 2) and run_tests(folder, failed[:1] or [test], limit)[0] == 0:
            return "caught"
        if code != 0:
            said = "undecided"
    return said


def main() -> None:
    """Draw, try, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folders", nargs="+", default=FOLDERS)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for the tests of one fault")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="no further fault is begun after this time")
    parser.add_argument("--out", type=Path, help="file of rows (JSON lines); its faults are not tried again")
    parser.add_argument("--again", type=Path, help="file of rows: what was not caught is tried once more")
    given = parser.parse_args()
    faults = listed_again(given.again) if given.again else drawn(given.faults, given.seed, given.folders)
    begun, counts = time.monotonic(), {"caught": 0, "survivor": 0, "undecided": 0}
    done = len(given.out.read_text(encoding="utf-8").splitlines()) if given.out and given.out.exists() else 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(PACKAGE, folder / "sksurrogate", ignore=shutil.ignore_patterns("__pycache__"))
        for fault in faults[done:]:
            started, (tests, further) = time.monotonic(), tests_of(fault.path)
            if started - begun > 60 * given.minutes:
                break
            said = decided(folder, fault, tests + further, given.limit)
            counts[said] += 1
            row = {
                "file": fault.path.relative_to(ROOT).as_posix(),
                "line": fault.line,
                "kind": fault.kind,
                "before": fault.before,
                "after": fault.after,
                "tests": [test.relative_to(ROOT).as_posix() for test in tests + further],
                "said": said,
                "seconds": round(time.monotonic() - started, 1),
            }
            print(f"{said:9} {row['file']}:{fault.line} {fault.kind}: {fault.before!r} -> {fault.after!r}", flush=True)
            if given.out is not None:
                with given.out.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(row) + "\n")
    total = counts["caught"] + counts["survivor"]
    print(f"{counts['caught']} of {total} decided were caught, {counts['undecided']} undecided")


if __name__ == "__main__":
    main()
