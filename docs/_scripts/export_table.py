"""Write the table of exports on docs/from_report_to_controller.md: ``python docs/_scripts/export_table.py``.

Every effect of the catalogue is put on a plant of three states, exported and linearised.
"""

from pathlib import Path

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import ODESimulator, linearise

PAGE = Path(__file__).parents[1] / "from_report_to_controller.md"
BEGIN, END = "<!-- written by docs/_scripts/export_table.py -->", "<!-- end -->"
X, U = [0.05, 0.01, 0.2], [0.1, 0.1]


def rhs(t, x, u, p):
    """A mass with a spring, and a tank that it drives."""
    q, v, h = x
    return v, u[0] - p["k"] * q - 0.6 * v, u[1] - 0.5 * h + 0.1 * q


def model_with(name: str) -> AugmentedSimulator:
    """The plant with one effect; a delay of two samples and a half."""
    plant = ODESimulator(rhs, states=["q", "v", "h"], inputs=["u", "w"], outputs=["q", "h"], params={"k": 4.0}, dt=0.05)
    kind = CATALOGUE[name]
    place = {"parameter": "k", "input": "u", "output": "q", "state": "v"}[kind.kind]
    variables = kind.variables(plant_of(plant), place)
    effect = kind(place, "q" if "q" in variables else variables[0])
    values = [0.125 if "delay" in name else 0.3 + 0.1 * k for k in range(len(kind.parameters))]
    return AugmentedSimulator(plant, [effect], [values], scale=1.0)


def plant_of(simulator: ODESimulator):
    """What the package knows of the plant."""
    from sksurrogate.physics._simulator import describe

    return describe(simulator)


def row(name: str) -> tuple[str, str]:
    """States in the export, and what ``linearise`` gives."""
    model = model_with(name)
    extra = len(model.to_graph().states or ()) - 3
    timed = (model.to_graph().states or [""])[-1] == "time"
    if "delay" in name:
        export = "one state for each sample of delay, exact"
    else:
        export = "the time" if timed else {0: "none", 1: "one", 2: "two"}[extra]
    try:
        local = len(linearise(model, X, U).A) - 3
    except SurrogateError as error:
        return export, "refused: " + str(error).split(": ")[1].split(". ")[0]
    if "delay" in name:
        return export, "Padé, order 2 (`pade=`)"
    return export, {0: "none", 1: "one", 2: "two"}[local]


def table() -> str:
    """The effects by what becomes of them."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in CATALOGUE:
        groups.setdefault(row(name), []).append(f"`{name}`")
    lines = ["| effects | further states in CasADi, C, ONNX | further states in `linearise` |", "| --- | --- | --- |"]
    lines += [f"| {', '.join(names)} | {export} | {local} |" for (export, local), names in groups.items()]
    return "\n".join(lines)


def page() -> str:
    """The page with the table of today."""
    before, rest = PAGE.read_text().split(BEGIN)
    return f"{before}{BEGIN}\n\n{table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(page())
