"""Does a unit get the same diagnosis as the equations that it was made of?

    python tests/benchmarks/bench_fmu_parity.py [--cases 6] [--seed 0] [--arms effect none] [--kinds "model exchange" co-simulation]
                                               [--rows 150] [--out rows.jsonl]

Sealed cases are diagnosed three times, with the whole catalogue: along the ODESimulator, a unit of FMI 2 for model exchange, and
the same unit for co-simulation with a copy of its state (held inputs only). ``to_c`` writes the right-hand side, gcc compiles it.
Same means: the same verdict, and the same names at the same places. ``--rows`` keeps the first rows of every run.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import re
import subprocess
import tempfile
import time
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from sksurrogate.blind import PLANTS, draw
from sksurrogate.blind._plants import PlantSpec
from sksurrogate.export import to_c
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import FMUSimulator, StepSimulator

VARIABLE = (
    '<ScalarVariable name="{}" valueReference="{}" causality="{}" variability="{}" {}><Real {}/></ScalarVariable>'
)
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}" numberOfEventIndicators="0">
<ModelExchange modelIdentifier="{name}" canGetAndSetFMUstate="true" completedIntegratorStepNotNeeded="true"/>
<CoSimulation modelIdentifier="{name}" canGetAndSetFMUstate="true"/>
<ModelVariables>{variables}</ModelVariables>
<ModelStructure><Outputs>{outputs}</Outputs><Derivatives>{derivatives}</Derivatives></ModelStructure>
</fmiModelDescription>
"""


def right_hand_side(plant: PlantSpec) -> str:
    """C code of the derivatives and of the outputs, parameters as further inputs."""
    n, names = len(plant.inputs), list(plant.params)

    def split(u: Any) -> tuple[Any, dict[str, Any]]:
        return u[:n], {name: u[n + k] for k, name in enumerate(names)}

    def step(t: Any, x: Any, u: Any, p: Any, dt: float) -> Any:
        return plant.rhs(t, x, *split(u))

    def output(t: Any, x: Any, u: Any, p: Any) -> Any:
        assert plant.output is not None
        return plant.output(t, x, *split(u))

    reading = None if plant.output is None else output
    return to_c(
        StepSimulator(
            step, states=list(plant.states), inputs=[*plant.inputs, *names],
            outputs=list(plant.outputs), params={}, dt=1.0, output=reading,
        )
    )  # fmt: skip


def variables(plant: PlantSpec, own: list[str]) -> list[str]:
    """Of the model description: states, derivatives, inputs, parameters, outputs that are no states."""
    n, m, out = len(plant.states), len(plant.inputs), []
    for i, name in enumerate(plant.states):
        cause = "output" if not own and name in plant.outputs else "local"
        out.append(VARIABLE.format(name, i, cause, "continuous", 'initial="exact"', f'start="{plant.start[i]!r}"'))
    for i, name in enumerate(plant.states):
        out.append(VARIABLE.format(f"der({name})", n + i, "local", "continuous", "", f'derivative="{i + 1}"'))
    for i, name in enumerate(plant.inputs):
        out.append(VARIABLE.format(name, 2 * n + i, "input", "continuous", "", 'start="0"'))
    for i, (name, value) in enumerate(plant.params.items()):
        given = 'initial="exact"', f'start="{value!r}"'
        out.append(VARIABLE.format(name, 2 * n + m + i, "parameter", "fixed", *given))
    for i, name in enumerate(own):
        at = 2 * n + m + len(plant.params) + i
        out.append(VARIABLE.format(name, at, "output", "continuous", 'initial="calculated"', ""))
    return out


def unit_of(plant: PlantSpec, folder: Path) -> Path:
    """The unit of a plant."""
    code, name, n = right_hand_side(plant), f"plant_{plant.name}", len(plant.states)
    own = [] if plant.output is None else list(plant.outputs)
    (folder / "model.c").write_text(code, encoding="utf-8")
    begin = [*plant.start, *np.zeros(n + len(plant.inputs)), *plant.params.values(), *np.zeros(len(own))]
    size = re.search(r"sz_w\) \*sz_w = (\d+);", code)
    sizes = {"NX": n, "NU": len(plant.inputs), "NP": len(plant.params), "NY": len(own)}
    sizes["SIZE"] = int(size[1]) + 1 if size else 1
    given = [f"-D{key}={value}" for key, value in sizes.items()]
    given += ['-DMODEL="model.c"', f"-DBEGIN={','.join(repr(float(value)) for value in begin)}"]
    headers = [f"-I{Path(fmpy.__file__).parent / 'c-code'}", f"-I{folder}"]
    source, binary = Path(__file__).with_name("plant_unit.c"), folder / f"{name}.so"
    subprocess.run(
        ["gcc", "-O2", "-w", "-shared", "-fPIC", *given, *headers, str(source), "-o", str(binary), "-lm"], check=True
    )
    listed = variables(plant, own)
    outputs = [k + 1 for k, text in enumerate(listed) if 'causality="output"' in text]
    text = DESCRIPTION.format(
        name=name, variables="\n".join(listed), outputs="".join(f'<Unknown index="{k}"/>' for k in outputs),
        derivatives="".join(f'<Unknown index="{n + k + 1}"/>' for k in range(n)),
    )  # fmt: skip
    with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.write(binary, f"binaries/linux64/{name}.so")
    return folder / f"{name}.fmu"


def answered(simulator: Any, question: Any) -> tuple[str, list[list[Any]], float]:
    """Verdict, names with their places, processor seconds."""
    started = time.process_time()
    diagnoser = GapDiagnoser(simulator, free_params=question.free_params, random_state=0, n_jobs=1)
    report = diagnoser.fit(question.X, question.y, groups=question.groups).report_
    names = sorted([e.name, e.location, e.variable or ""] for e in report.effects)
    return report.verdict, names, time.process_time() - started


def shortened(question: Any, rows: int) -> Any:
    """The first rows of every run."""
    groups = np.asarray(question.groups)
    kept = np.concatenate([np.flatnonzero(groups == label)[:rows] for label in np.unique(groups)])
    return replace(question, X=question.X[kept], y=question.y[kept], groups=groups[kept])


def compared(arm: str, entropy: int, rows: int, wanted: list[str], folder: Path) -> dict[str, Any] | None:
    """A case along the equations and units; None where the plant has a state and an output function of one name."""
    case = draw(arm, entropy)
    plant, question = PLANTS[case.plant.name], shortened(case.question, rows)
    if plant.output is not None and set(plant.outputs) & set(plant.states):
        return None
    given = {"inputs": list(plant.inputs), "outputs": list(question.simulator.outputs), "params": dict(plant.params)}
    given |= {"dt": plant.dt, "x0": list(plant.start)}
    path = unit_of(plant, folder)
    kinds = {"equations": plant.simulator(None, question.simulator.outputs)}
    kinds["model exchange"] = FMUSimulator(path, fmi_type="ModelExchange", hold=plant.hold, **given)
    if plant.hold == "zoh":
        kinds["co-simulation"] = FMUSimulator(path, fmi_type="CoSimulation", initial=list(plant.states), **given)
    row: dict[str, Any] = {"arm": arm, "entropy": entropy, "plant": plant.name, "rows": len(question.X)}
    row["truths"] = [[t.name, t.location, t.variable or ""] for t in case.truths]
    for kind in [kind for kind in kinds if kind in ("equations", *wanted)]:
        simulator = kinds[kind]
        verdict, names, seconds = answered(simulator, question)
        row[kind] = {"verdict": verdict, "names": names, "seconds": round(seconds, 1)}
        print(f"{arm} {plant.name} {kind}: {verdict} {names} {seconds:.1f} s", flush=True)
    return row


def main() -> None:
    """Compare, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--arms", nargs="+", default=["effect", "none"])
    parser.add_argument("--kinds", nargs="+", default=["model exchange", "co-simulation"])
    parser.add_argument("--rows", type=int, default=10**9)
    parser.add_argument("--out", type=Path, help="file of rows (JSON lines); its cases are not asked again")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    stored = given.out.read_text(encoding="utf-8").splitlines() if given.out and given.out.exists() else []
    rows = [json.loads(line) for line in stored]
    for k in range(len(rows), given.cases):
        entropy = int(np.random.SeedSequence([given.seed, k]).generate_state(1, np.uint64)[0])
        with tempfile.TemporaryDirectory() as folder:
            row = compared(given.arms[k % len(given.arms)], entropy, given.rows, given.kinds, Path(folder)) or {}
        rows.append(row)
        if given.out is not None:
            with given.out.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
    for kind in ("model exchange", "co-simulation"):
        pairs = [(row["equations"], row[kind]) for row in rows if kind in row]
        same = sum(a["verdict"] == b["verdict"] and a["names"] == b["names"] for a, b in pairs)
        times = [b["seconds"] / max(a["seconds"], 0.1) for a, b in pairs]
        print(
            f"{kind}: the same in {same} of {len(pairs)}, median time {np.median(times or [np.nan]):.1f} of the equations'"
        )


if __name__ == "__main__":
    main()
