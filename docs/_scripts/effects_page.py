"""Write docs/effects.md from the catalogue: ``python docs/_scripts/effects_page.py``."""

from pathlib import Path

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect

HEAD = """# The catalogue of effects

An *effect* is a small parametric change to a simulator. Its null value gives the original simulator. The tables use these
symbols: x is the state of the `location`, v is the `variable` that drives the effect, c is the first parameter (the
*magnitude*), and t is the time from the first row of a run.

- Terms on a balance are added to dx/dt, so c has the unit of dx/dt divided by the unit of the form.
- Several effects on one input, or on one sensor, act in the order of this page.
- Twins are effects that often predict the same outputs. The diagnosis computes from the data which ones do.

`docs/_scripts/effects_page.py` writes this page from the classes in `sksurrogate.effects`. You can add
[an effect of your own](extending.md).
"""

PORTS = """
## At a port

A *port* is a place where a force, a flow or heat enters: every input, and every joint of `MuJoCoSimulator`. Every law of the tables
*on the balance of a state* and *with a hidden state*, except limits and overflow, can act at a port. It is added to the force or
flow there: `location` is the port, `variable` a state, and c has the unit of the port. x is the input.

- The diagnosis tries laws at inputs that move several balances, and at the joints of a simulator. If an input enters one
  balance in proportion, a law there is a law of that balance, and only that one is tried.
- `load_friction` depends on what enters beside it (F: the input, or what the actuators bring at a joint). It is tried at every
  port where that is known, and in no balance. A simulator with `ports` says so with `drive_forces(x, u, p)`.
- By default a speed drives frictions and losses, a position drives springs, stops and hidden parts, a level drives outflows:

| driven by | laws |
| --- | --- |
"""

DRIVERS = {
    "speed": "the speed of a joint",
    "position": "its position",
    "level": "a level that a flow moves",
    "time": "time",
}

PLACES = {
    "parameter": "On a parameter",
    "state": "On the balance of a state",
    "hidden": "With a hidden state",
    "input": "On an input (before the simulator)",
    "output": "On a sensor (after the simulator)",
}


def place_of(cls: type[BaseEffect]) -> str:
    """Section of the page."""
    return "hidden" if issubclass(cls, HiddenEffect) else cls.kind


def parameter_text(cls: type[BaseEffect]) -> str:
    """Parameters with units, nulls and bounds."""
    texts = []
    for i, p in enumerate(cls.parameters):
        notes = [p.unit] if p.unit else []
        if i == 0:
            notes.append(f"null {p.null:g}")
        if p.low > float("-inf"):
            notes.append("> 0" if 0 < p.low < 1e-6 else f">= {p.low:g}")
        texts.append(f"`{p.name}` ({'; '.join(notes)})" if notes else f"`{p.name}`")
    return ", ".join(texts) or "none"


NEEDS = {
    "trajectory": "`simulate` only",
    "step": "a right-hand side or a step",
}


#: What stands below the table of a place.
BELOW = {
    "output": (
        "\nReadings on a grid finer than a hundredth of their deviation are those of a display, whose resolution is noise:\n"
        "`sensor_quantization` is a candidate there only where you ask for it by name.\n"
    )
}


def section(place: str) -> str:
    """One table."""
    found = {name: cls for name, cls in CATALOGUE.items() if place_of(cls) == place}
    access = {cls.access for cls in found.values()}
    head = ["name", "form", "parameters, magnitude first", *(["needs"] if len(access) > 1 else []), "seen as", "twins"]
    rows = [" | ".join(["", *head, ""]).strip(), "| " + " | ".join("---" for _ in head) + " |"]
    for name, cls in found.items():
        needs = [NEEDS[cls.access]] if len(access) > 1 else []
        form = cls.equation.replace("|", "\\|")
        cells = [f"`{name}`", form, parameter_text(cls), *needs, cls.signature, ", ".join(cls.twins)]
        rows.append(f"| {' | '.join(cells)} |")
    common = "" if len(access) > 1 else f"The simulator needs {NEEDS[access.pop()]}.\n\n"
    return f"\n## {PLACES[place]}\n\n{common}" + "\n".join(rows) + "\n" + BELOW.get(place, "")


def ports() -> str:
    """Laws at ports by what drives them."""
    rows = []
    for what, words in DRIVERS.items():
        names = [name for name, cls in CATALOGUE.items() if what in getattr(cls, "at_port", ())]
        rows.append(f"| {words} | {', '.join(f'`{name}`' for name in names)} |")
    return PORTS + "\n".join(rows) + "\n\nYou can ask for others by name and place.\n"


def page() -> str:
    """The whole page."""
    return HEAD + "".join(section(place) for place in PLACES) + ports()


if __name__ == "__main__":
    (Path(__file__).parents[1] / "effects.md").write_text(page())
