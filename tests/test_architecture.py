"""Arrows go down the floors, and optional packages stay inside functions."""

import ast
from pathlib import Path

import pytest

import sksurrogate

ROOT = Path(sksurrogate.__file__).parent
FILES = sorted(path for path in ROOT.rglob("*.py") if path.name != "__init__.py")
FLOOR = {
    "exceptions": 0, "kernels": 1, "runs": 2, "_columns": 2, "_checks": 2, "_csv": 2, "_dynamic": 2, "_tables": 1, "_parallel": 1, "export": 2, "physics": 3, "features": 3, "linear": 3, "neural": 3,
    "metrics": 3, "displays": 3, "effects": 4, "model_selection": 4, "datasets": 4, "compose": 5, "gap": 6, "blind": 8,
    "testing": 8, "demo": 9, "cli": 10,
    "_fingerprint": 2,
}  # fmt: skip
OPTIONAL = {
    "torch",
    "skorch",
    "matplotlib",
    "pandas",
    "polars",
    "rich",
    "pooch",
    "fmpy",
    "control",
    "casadi",
    "onnx",
    "dask",
}


def room(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imports(path: Path, *, top: bool) -> set[str]:
    tree = ast.parse(path.read_text())
    nodes = tree.body if top else list(ast.walk(tree))
    found = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_down(path):
    own = room(path)
    for module in imports(path, top=False):
        if module.startswith("sksurrogate."):
            other = module.split(".")[1]
            assert FLOOR[other] <= FLOOR[own], f"{own} imports {module}"
            if own == "blind":
                assert other not in ("effects", "kernels")


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_optional_packages_stay_inside_functions(path):
    assert not {module.split(".")[0] for module in imports(path, top=True)} & OPTIONAL


def test_kernels_use_numpy_and_scipy_alone():
    for path in (ROOT / "kernels").glob("*.py"):
        for module in imports(path, top=False):
            if module.startswith("sksurrogate."):
                assert module.startswith("sksurrogate.kernels")
            else:
                assert module.split(".")[0] not in {"sklearn", "joblib"}


def test_every_public_name_can_be_imported():
    for name in sksurrogate.__all__:
        assert getattr(sksurrogate, name) is not None
    assert sksurrogate.__all__ == sorted(sksurrogate.__all__)


#: Rooms that are larger than the house rules allow; they may shrink, not grow. torch's classes stand in a function because
#: torch is imported there.
LARGER = {
    "kernels/state_space.py": 490,
}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_files_and_functions_stay_readable(path):
    text, place = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    assert len(text.splitlines()) <= LARGER.get(place, 420)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            if body:
                assert body[-1].end_lineno - body[0].lineno + 1 <= LARGER.get(f"{place}:{node.name}", 60), node.name
                assert not (len(body) == 1 and isinstance(body[0], ast.Pass)), f"{node.name} does nothing"
    for word in ("TODO", "FIXME", "XXX", "NotImplementedError"):
        assert word not in text
