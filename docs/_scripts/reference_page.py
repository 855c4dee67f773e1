"""The API reference: every public name of every face, from ``__all__``."""

import inspect
from importlib import import_module
from pathlib import Path

#: Face -> its title; a face that holds no names is left out.
FACES = {
    "gap": "Diagnosis of the gap",
    "physics": "Simulators",
    "effects": "Effects",
    "compose": "Hybrid and recursive models",
    "features": "Features",
    "linear": "Linear models",
    "neural": "Networks",
    "model_selection": "Model selection",
    "metrics": "Metrics",
    "displays": "Displays",
    "datasets": "Data",
    "blind": "The check on withheld effects",
    "export": "Export",
    "runs": "Runs",
    "testing": "Checks for extensions",
    "demo": "Demo",
    "exceptions": "Errors",
}


def public_names(face: str) -> list[str]:
    """Documented names of a face: classes and functions that it exports."""
    try:
        module = import_module(f"sksurrogate.{face}")
    except ModuleNotFoundError:
        return []
    names = getattr(module, "__all__", [])
    return [name for name in names if inspect.isclass(getattr(module, name)) or callable(getattr(module, name))]


def public_data(face: str) -> list[str]:
    """Tables that a face exports beside its classes and functions."""
    module = import_module(f"sksurrogate.{face}")
    return [name for name in getattr(module, "__all__", []) if name not in public_names(face)]


def write_reference(folder: Path) -> None:
    """Write ``reference.rst`` for sphinx's autosummary, unless it is up to date."""
    lines = ["API reference", "=============", ""]
    for face, title in FACES.items():
        names = public_names(face)
        if not names:
            continue
        lines += [title, "-" * len(title), "", f".. automodule:: sksurrogate.{face}", "   :no-members:", ""]
        lines += [
            f".. currentmodule:: sksurrogate.{face}",
            "",
            ".. autosummary::",
            "   :toctree: .",
            "   :nosignatures:",
            "",
        ]
        lines += [f"   {name}" for name in names] + [""]
        for name in public_data(face):
            lines += [f".. autodata:: {name}", "   :no-value:", ""]
    text = "\n".join(lines)
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "reference.rst"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
