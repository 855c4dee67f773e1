"""The API reference: every public name of every face, from ``__all__``."""

import inspect
import re
import sys
from dataclasses import fields, is_dataclass
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


def parts_of_a_report() -> dict[str, type]:
    """Results that a report holds (its places, its shares, ...), by name; they are reached through the report alone."""
    from sksurrogate.gap import GapReport

    found: dict[str, type] = {}
    waiting = [GapReport]
    while waiting:
        holder = waiting.pop(0)
        words = {word for field in fields(holder) for word in re.findall(r"\w+", str(field.type))}
        for word in sorted(words):
            places = [sys.modules[base.__module__] for base in holder.__mro__]
            part = next((getattr(place, word) for place in places if hasattr(place, word)), None)
            known = word in found or word in public_names("gap")
            if not known and inspect.isclass(part) and part.__module__.startswith("sksurrogate."):
                found[word] = part
                waiting += [part] if is_dataclass(part) else []
    return found


def aliases() -> dict[str, str]:
    """Public class or function -> its place; the types of parameters and attributes are linked by it."""
    found = {name: f"{part.__module__}.{name}" for name, part in parts_of_a_report().items()}
    for face in FACES:
        found |= {name: f"sksurrogate.{face}.{name}" for name in public_names(face)}
    return found


def heading(text: str, line: str) -> list[str]:
    """A title in reStructuredText."""
    return [text, line * len(text), ""]


def summary(face: str) -> str:
    """First line of a module."""
    return (inspect.getdoc(import_module(f"sksurrogate.{face}")) or "").split("\n")[0]


def module_page(face: str, title: str) -> list[str]:
    """Page of one module: classes, functions, data."""
    lines = [f".. _api-{face}:", "", *heading(title, "="), f"``sksurrogate.{face}``", ""]
    lines += [
        f".. automodule:: sksurrogate.{face}",
        "   :no-members:",
        "",
        f".. currentmodule:: sksurrogate.{face}",
        "",
    ]
    values = {name: getattr(import_module(f"sksurrogate.{face}"), name) for name in public_names(face)}
    for kind, names in (
        ("Classes", [name for name, value in values.items() if inspect.isclass(value)]),
        ("Functions", [name for name, value in values.items() if not inspect.isclass(value)]),
    ):
        if names:
            lines += [*heading(kind, "-"), ".. autosummary::", "   :toctree: .", "   :nosignatures:", ""]
            lines += [*(f"   {name}" for name in names), ""]
    data = public_data(face)
    lines += heading("Data", "-") if data else []
    for name in data:
        lines += [f".. autodata:: {name}", "   :no-value:", ""]
    if face == "gap":
        lines += [*heading("Parts of a report", "-"), "You get these objects from the attributes of a report.", ""]
        for name, part in parts_of_a_report().items():
            lines += [f".. autoclass:: {part.__module__}.{name}", "   :members:", ""]
    return lines


def write_reference(folder: Path) -> None:
    """Write the pages of the reference for sphinx's autosummary, those that changed."""
    faces = {face: title for face, title in FACES.items() if public_names(face)}
    lines = [*heading("API reference", "="), "The public names, by module.", ""]
    lines += [".. list-table::", "   :header-rows: 1", "", "   * - module", "     - what is there"]
    for face, title in faces.items():
        lines += [f"   * - :ref:`sksurrogate.{face} <api-{face}>`", f"     - {summary(face)}"]
    lines += ["", ".. toctree::", "   :hidden:", "", *(f"   {title} <{face}>" for face, title in faces.items()), ""]
    folder.mkdir(parents=True, exist_ok=True)
    pages = {"reference": lines, **{face: module_page(face, title) for face, title in faces.items()}}
    for name, content in pages.items():
        page, text = folder / f"{name}.rst", "\n".join(content)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
