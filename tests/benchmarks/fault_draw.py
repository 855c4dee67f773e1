"""Small faults of the package's source: changed operators, comparisons, constants, connectives, signs and dropped terms."""

from __future__ import annotations

import ast
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "sksurrogate"
#: Where faults are drawn, in turn; "." is the package's top. `gap` is the largest folder by far and comes four times.
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

    def faulty(self) -> str:
        """Text of the file with the fault in it, on the same lines."""
        text = self.path.read_text(encoding="utf-8")
        return text[: self.start] + self.after[:-1] + "\n" * self.before.count("\n") + ")" + text[self.stop :]

    def changes_nothing(self) -> bool:
        """Whether the compiled code is the same, as for a constant of an annotation."""
        text = self.path.read_text(encoding="utf-8")
        return compile(text, "x", "exec") == compile(self.faulty(), "x", "exec")


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
    lines = text.splitlines()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    out = []
    for node in body_nodes(ast.parse(text)):
        for kind, other in changed(node):
            a = starts[node.lineno - 1] + len(lines[node.lineno - 1].encode()[: node.col_offset].decode())
            b = starts[node.end_lineno - 1] + len(lines[node.end_lineno - 1].encode()[: node.end_col_offset].decode())
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
        found = faults_of(rng.choice(groups[folders[len(out) % len(folders)]]))
        if found:
            fault = rng.choice(found)
            if not fault.changes_nothing() and fault not in out:
                out.append(fault)
    return out


def listed_again(path: Path) -> list[Fault]:
    """Faults of a file of rows that were not caught, where the code still holds them."""
    out = []
    for row in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
        if row["said"] != "caught":
            same = [f for f in faults_of(ROOT / row["file"]) if (f.before, f.after) == (row["before"], row["after"])]
            out += sorted(same, key=lambda fault: abs(fault.line - row["line"]))[:1]
    return out
