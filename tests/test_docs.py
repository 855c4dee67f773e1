"""Every Python block in the pages runs: prompts as doctests, the rest as a script, in one namespace a page."""

import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
import sys
import types
from pathlib import Path

import pytest

import sksurrogate
from sksurrogate.blind import ARMS, PLANTS, ROBOT_ARMS
from sksurrogate.blind._records import RECORDS
from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapReport
from sksurrogate.gap.decide._rules import DecisionFeatures

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(DOCS.glob("*.md"))
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
#: Blocks with these words need what a test machine may not have: a cluster's address, a recording (the examples run these).
ELSEWHERE = ("scheduler.example", "= fetch_")


def blocks(page: Path) -> list[tuple[int, str]]:
    """(line, source) of the Python blocks of a page."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(r"^```python\n(.*?)^```", text, re.S | re.M)
    return [(text[: match.start(1)].count("\n") + 1, match.group(1)) for match in found]


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=lambda page: page.stem)
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = types.ModuleType(f"page_{page.stem}")  # a module, so that what a page defines can be pickled
    monkeypatch.setitem(sys.modules, module.__name__, module)
    names = module.__dict__
    failures: list[str] = []
    for line, source in blocks(page):
        if any(word in source for word in ELSEWHERE):
            continue
        if ">>> " not in source:
            exec(compile("\n" * (line - 1) + source, str(page), "exec"), names)
            continue
        example = doctest.DocTestParser().get_doctest(source, {}, page.name, str(page), line - 1)
        example.globs = names
        doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=failures.append, clear_globs=False)
    assert not failures, "".join(failures)


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+\.md)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


REFERENCE = DOCS / "_scripts" / "reference_page.py"
#: Faces that stand on a page of their own (the command line) or are for the package alone.
NOT_IN_REFERENCE = {"cli", "kernels"}


def reference():
    """The script that writes the reference."""
    spec = importlib.util.spec_from_file_location("reference_page", REFERENCE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def public():
    """(face, name, object) of every name of the reference."""
    if not REFERENCE.exists():
        return []
    page = reference()
    return [
        (face, name, getattr(importlib.import_module(f"sksurrogate.{face}"), name))
        for face in page.FACES
        for name in page.public_names(face)
    ]


PUBLIC = public()


@pytest.mark.skipif(not REFERENCE.exists(), reason="the pages are not beside the tests (installed package)")
def test_every_face_is_in_the_reference():
    faces = {module.name for module in pkgutil.iter_modules(sksurrogate.__path__) if not module.name.startswith("_")}
    assert faces - NOT_IN_REFERENCE == set(reference().FACES)


@pytest.mark.parametrize("name, value", [pytest.param(n, v, id=f"{f}.{n}") for f, n, v in PUBLIC])
def test_a_public_name_is_documented(name, value):
    """An example, every parameter of the signature, and a line for every method and property."""
    text = inspect.getdoc(value) or ""
    assert ">>> " in text, f"{name} has no example"
    if not (inspect.isclass(value) and issubclass(value, Exception)):
        summary = set(re.findall(r"\w+", " ".join(re.findall(r"^([\w*, ]+?)(?: :.*)?$", text, re.M))))
        lacking = [p for p in inspect.signature(value).parameters if p not in summary and not p.startswith("_")]
        assert not lacking, f"{name} does not say what these are: {lacking}"
    if inspect.isclass(value):
        for key, member in vars(value).items():
            if not key.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
                assert inspect.getdoc(getattr(value, key)) or key.startswith("set_"), f"{name}.{key} has no docstring"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_the_page_of_the_command_line_has_every_option():
    from sksurrogate.cli import _parser

    text = (DOCS / "command_line.md").read_text(encoding="utf-8")
    commands = next(action.choices for action in _parser()._actions if isinstance(action.choices, dict))
    for name, parser in commands.items():
        section = text.split(f"## `sksurrogate {name}")[1].split("\n## ")[0]
        lacking = [
            option
            for action in parser._actions
            for option in action.option_strings
            if option.startswith("--") and option != "--help" and f"`{option}" not in section
        ]
        assert not lacking, f"docs/command_line.md does not tell of {lacking} of {name}"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_the_table_of_the_verdict_is_that_of_the_rules():
    spec = importlib.util.spec_from_file_location("verdict_page", DOCS / "_scripts" / "verdict_page.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (DOCS / "verdict_rules.md").read_text(encoding="utf-8")
    assert module.page(text) == text, "run python docs/_scripts/verdict_page.py"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_the_glossary_has_every_entry_of_the_report():
    section = (DOCS / "concepts.md").read_text(encoding="utf-8").split("### The report")[1].split("\n## ")[0]
    lacking = [field.name for field in dataclasses.fields(GapReport) if f"`{field.name}`" not in section]
    assert not lacking, f"docs/concepts.md does not tell of report.{lacking}"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_the_page_of_the_verdict_has_every_feature():
    section = (DOCS / "verdict_rules.md").read_text(encoding="utf-8").split("## The features")[1].split("\n## ")[0]
    lacking = [field.name for field in dataclasses.fields(DecisionFeatures) if f"`{field.name}`" not in section]
    assert not lacking, f"docs/verdict_rules.md does not tell of {lacking}"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_the_blind_check_page_has_every_arm_and_the_sizes_of_plants_and_catalogue():
    page = (DOCS / "blind_check.md").read_text(encoding="utf-8")
    first = re.findall(r"^\| ([\w, ]+) \|", page + (DOCS / "blind_appendix.md").read_text(encoding="utf-8"), re.M)
    told = {name for cell in first for name in cell.split(", ")}
    assert not {*ARMS, *ROBOT_ARMS, *RECORDS} - {"complete"} - told
    assert len(page.split()) < 2500
    assert f"the {len(CATALOGUE)} names of the catalogue" in page and f"There are {len(PLANTS)} plants" in page
    for other in (DOCS / "extending.md", DOCS.parent / "README.md"):
        counts = set(re.findall(r"\b(?:has|holds) (\d+) effects", other.read_text(encoding="utf-8")))
        assert counts == {str(len(CATALOGUE))}, f"{other.name}: the catalogue has {len(CATALOGUE)} effects"


@pytest.mark.skipif(not PAGES, reason="the pages are not beside the tests (installed package)")
def test_every_page_has_the_same_count_of_recordings_with_a_documented_effect():
    page = (DOCS / "benchmarks" / "recorded_diagnosis.md").read_text(encoding="utf-8")
    all_, named = re.search(r"(\d+) recordings have an accepted name. In (\d+) of them", page).groups()
    phrases = {
        DOCS / "benchmarks" / "index.md": f"a documented name in {named} of {all_}",
        DOCS / "what_the_diagnosis_can_see.md": f"{named} of {all_}.",
        DOCS / "blind_check.md": f"On {all_} of them an effect is documented; in {named} it is named",
        DOCS.parent / "README.md": f"an effect is documented for {all_} recordings, and {named} answers hold it",
    }
    lacking = [
        path.name
        for path, phrase in phrases.items()
        if phrase not in " ".join(path.read_text(encoding="utf-8").split())
    ]
    assert not lacking, f"{named} of {all_} recordings: {lacking} say something else"


@pytest.mark.parametrize(("page", "most"), [("how_a_diagnosis_works.md", 1500), ("blind_check.md", 2500)])
def test_pages_that_a_newcomer_reads_are_short(page, most):
    assert len((DOCS / page).read_text().split()) <= most
