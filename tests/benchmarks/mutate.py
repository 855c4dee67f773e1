"""Would the tests notice? Small faults are put into the package one at a time, and the tests that name the module are run.

    python tests/benchmarks/mutate.py [--faults 20] [--seed 0] [--folders kernels effects] [--limit 120] [--out rows.jsonl]

A fault is a changed operator, comparison, constant, connective or a dropped term, drawn evenly over the folders. The tests of a
module are the files that name it or one of its public names, those of its own folder first. A fault is *caught* when a test
fails or takes too long, a *survivor* when all pass, and *undecided* when no test names the module or the tests fail without it.
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
MOST_FILES = 4
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
        folder: sorted((PACKAGE / folder).rglob("_*.py" if folder != "kernels" else "*.py")) for folder in folders
    }
    out: list[Fault] = []
    while len(out) < n:
        folder = folders[len(out) % len(folders)]
        found = faults_of(rng.choice([path for path in groups[folder] if path.name != "__init__.py"]))
        if found:
            out.append(rng.choice(found))
    return out


def tests_of(path: Path) -> list[Path]:
    """Test files that name a module or its public names: most mentions first, those of its own folder before others."""
    module = ".".join(("sksurrogate", *path.relative_to(PACKAGE).with_suffix("").parts))
    listed = re.search(r"__all__ = \[(.*?)\]", path.read_text(encoding="utf-8"), re.S)
    names = re.findall(r'"(\w+)"', listed.group(1)) if listed else []
    scores = []
    for test in (ROOT / "tests").rglob("test_*.py"):
        text = test.read_text(encoding="utf-8")
        mentions = 10 * text.count(module) + sum(len(re.findall(rf"\b{name}\b", text)) for name in names)
        own = test.parent.name == path.relative_to(PACKAGE).parts[0]
        if mentions:
            scores.append((own, mentions, test))
    return [test for _, _, test in sorted(scores, key=lambda one: one[:2], reverse=True)[:MOST_FILES]]


def passes(folder: Path, tests: list[Path], limit: float) -> bool:
    """Whether the fast tests pass with the package of a folder."""
    env = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not slow"]
    command += ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), *map(str, tests)]
    try:
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, timeout=limit)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def main() -> None:
    """Draw, try, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folders", nargs="+", default=["kernels", "effects", "physics", "linear", "features", "gap"])
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for the tests of one fault")
    parser.add_argument("--out", type=Path, help="file of rows (JSON lines)")
    given = parser.parse_args()
    known: dict[tuple[Path, ...], bool] = {}
    counts = {"caught": 0, "survivor": 0, "undecided": 0}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(PACKAGE, folder / "sksurrogate", ignore=shutil.ignore_patterns("__pycache__"))
        for fault in drawn(given.faults, given.seed, given.folders):
            started, tests = time.monotonic(), tests_of(fault.path)
            place, text = folder / fault.path.relative_to(ROOT), fault.path.read_text(encoding="utf-8")
            if tuple(tests) not in known:
                known[tuple(tests)] = bool(tests) and passes(folder, tests, given.limit)
            said = "undecided"
            if known[tuple(tests)]:
                place.write_text(text[: fault.start] + fault.after + text[fault.stop :], encoding="utf-8")
                said = "survivor" if passes(folder, tests, given.limit) else "caught"
                place.write_text(text, encoding="utf-8")
            counts[said] += 1
            row = {
                "file": fault.path.relative_to(ROOT).as_posix(),
                "line": fault.line,
                "kind": fault.kind,
                "before": fault.before,
                "after": fault.after,
                "tests": [test.relative_to(ROOT).as_posix() for test in tests],
                "said": said,
                "seconds": round(time.monotonic() - started, 1),
            }
            print(f"{said:9} {row['file']}:{fault.line} {fault.kind}: {fault.before!r} -> {fault.after!r}", flush=True)
            if given.out is not None:
                with given.out.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(row) + "\n")
    decided = counts["caught"] + counts["survivor"]
    print(f"{counts['caught']} of {decided} decided were caught, {counts['undecided']} undecided")


if __name__ == "__main__":
    main()
