"""The package as it is shipped: quick to import, no torch before a network, typed, every public name importable."""

import subprocess
import sys
from importlib import import_module, resources

import pytest

import sksurrogate

HEAVY = {"torch", "skorch", "matplotlib", "casadi", "onnx", "fmpy", "control", "dask", "distributed", "pooch"}


def loaded(code):
    """Modules of a fresh interpreter after ``code``."""
    line = f"{code}\nimport sys; print('MODULES', *sorted(sys.modules))"
    out = subprocess.run([sys.executable, "-W", "ignore", "-c", line], check=True, capture_output=True, text=True)
    return set(out.stdout.split("MODULES")[1].split())


def test_import_alone_brings_nothing():
    """Counted, not timed: docs/benchmarks/import_time.md has the seconds."""
    modules = loaded("import sksurrogate")
    assert not modules & {"numpy", "scipy", "sklearn", *HEAVY}
    assert {name for name in modules if name.startswith("sksurrogate")} == {"sksurrogate"}


def test_the_command_line_starts_without_scikit_learn():
    assert not loaded("import sksurrogate.cli") & {"sklearn", *HEAVY}


@pytest.mark.slow
def test_a_diagnosis_loads_no_heavy_package():
    code = """
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
X, y, runs = make_reactor_runs(3, 60, noise=0.02, random_state=0)
report = GapDiagnoser(make_reactor(second=70.0), effects=["parameter_error", "sensor_bias"], random_state=0).fit(X, y, groups=runs).report_
text, page = str(report), report.to_html()
"""
    assert not loaded(code) & HEAVY


@pytest.mark.slow
def test_faces_that_are_not_networks_load_no_torch():
    lines = "\n".join(
        f"import sksurrogate.{face}"
        for face in ("features", "linear", "neural", "compose", "physics", "effects", "gap")
    )
    assert not loaded(lines) & {"torch", "skorch", "matplotlib"}


@pytest.mark.slow
def test_what_is_added_to_scikit_learn_is_small():
    """At most a fifth more modules than a common scikit-learn program has."""
    common = loaded(
        "import sklearn.linear_model, sklearn.pipeline, sklearn.model_selection, sklearn.ensemble, scipy.signal"
    )
    ours = loaded("from sksurrogate.gap import GapDiagnoser")
    assert len(ours - common) < 0.2 * len(common)


def test_typed():
    assert resources.files("sksurrogate").joinpath("py.typed").is_file()


@pytest.mark.parametrize("name", sorted(set(sksurrogate.__all__) - {"__version__"}))
def test_top_level_names(name):
    assert getattr(sksurrogate, name) is not None


@pytest.mark.parametrize(
    "face",
    [
        "blind", "compose", "datasets", "displays", "effects", "exceptions", "export", "features", "gap", "linear",
        "metrics", "model_selection", "neural", "physics", "runs", "testing",
    ],
)  # fmt: skip
def test_faces_say_what_they_have(face):
    module = import_module(f"sksurrogate.{face}")
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        assert value is not None
        if callable(value):
            assert (value.__doc__ or "").strip(), f"{face}.{name} has no docstring"
