"""Units of FMI 2 for model exchange, compiled here: no Python package builds such ones. FMI 3 and co-simulation need no compiler."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

VARIABLES = """
<ScalarVariable name="{0}" valueReference="0" causality="output" variability="continuous" initial="exact"><Real start="{4}"/></ScalarVariable>
<ScalarVariable name="{1}" valueReference="1" causality="local" variability="continuous" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="der({0})" valueReference="2" causality="local" variability="continuous" initial="calculated"><Real derivative="1"/></ScalarVariable>
<ScalarVariable name="der({1})" valueReference="3" causality="local" variability="continuous" initial="calculated"><Real derivative="2"/></ScalarVariable>
<ScalarVariable name="push" valueReference="4" causality="input" variability="continuous"><Real start="0"/></ScalarVariable>
<ScalarVariable name="{2}" valueReference="5" causality="parameter" variability="fixed" initial="exact"><Real start="{5}"/></ScalarVariable>
<ScalarVariable name="{3}" valueReference="6" causality="parameter" variability="tunable" initial="exact"><Real start="{6}"/></ScalarVariable>
<ScalarVariable name="load" valueReference="7" causality="parameter" variability="fixed" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="wear" valueReference="8" causality="parameter" variability="fixed" initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="torque" valueReference="9" causality="output" variability="continuous" initial="calculated"><Real/></ScalarVariable>
"""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}" numberOfEventIndicators="{events}">
<ModelExchange modelIdentifier="{name}" canGetAndSetFMUstate="true" completedIntegratorStepNotNeeded="true"/>
{both}
<ModelVariables>{variables}</ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/><Unknown index="10"/></Outputs>
<Derivatives><Unknown index="3"/><Unknown index="4"/></Derivatives></ModelStructure>
</fmiModelDescription>
"""
SWING = ("angle", "rate", "g", "c", 0.5, 9, 0.4)
BALL = ("height", "speed", "g", "e", 1, 9.81, 0.8)


def _compiled(folder, name, words, ball):
    fmpy = pytest.importorskip("fmpy")
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("a unit of FMI 2 for model exchange is a binary: it needs gcc, and is named for Linux here")
    headers = Path(fmpy.__file__).parent / "c-code"
    source, binary = Path(__file__).parent / "unit.c", folder / f"{name}.so"
    given = [
        compiler,
        "-O1",
        "-shared",
        "-fPIC",
        f"-DBALL={ball}",
        f"-I{headers}",
        str(source),
        "-o",
        str(binary),
        "-lm",
    ]
    subprocess.run(given, check=True)
    both = "" if ball else f'<CoSimulation modelIdentifier="{name}" canGetAndSetFMUstate="true"/>'
    text = DESCRIPTION.format(name=name, events=ball, both=both, variables=VARIABLES.format(*words))
    with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.write(binary, f"binaries/linux64/{name}.so")
    return folder / f"{name}.fmu"


@pytest.fixture(scope="session")
def swing_unit(tmp_path_factory):
    """A pendulum without events."""
    return _compiled(tmp_path_factory.mktemp("swing"), "Swing", SWING, 0)


@pytest.fixture(scope="session")
def ball_unit(tmp_path_factory):
    """A ball that bounces."""
    return _compiled(tmp_path_factory.mktemp("ball"), "Ball", BALL, 1)
