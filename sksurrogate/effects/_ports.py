"""Laws at a port: ``- c f(v)`` added to a force, flow or heat that enters; at which ports they are sought, and what drives them.

A force at a port may move several balances at once, as a torque does through the inverse of a mass matrix. Where an input
moves one balance only, and always in proportion, a law there is a law of that balance and is sought there. Ports that a
simulator offers beside its inputs (joints) say where its forces enter: laws are sought there, not in what they make.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._structure import Structure, structure_of
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: Speeds that a port moves, up to which each may drive a law there where it cannot be determined which is the port's own.
FEW = 2


@dataclass(frozen=True)
class Port:
    """A port at which laws are sought."""

    name: str
    #: speeds, positions, levels: states that may drive a law: speeds that the port moves and their integrals, or other
    #: states that it moves
    speeds: tuple[str, ...] = ()
    positions: tuple[str, ...] = ()
    levels: tuple[str, ...] = ()
    coupled: tuple[str, ...] = ()  #: Speeds and positions of other ports, whose losses and stiffnesses may act here
    constant: bool = False  #: Whether a constant force is sought too: at an input it is the input's bias
    loaded: bool = True  #: Whether it is known what enters beside a law
    is_a_balance: bool = False  #: Whether only laws that depend on that are sought here: all others are, in the balance

    def drivers(self, kind: type[BalanceEffect]) -> tuple[str | None, ...]:
        """Signals that may drive a law here; None for a function of time or a constant."""
        if (kind.of_load and not self.loaded) or (self.is_a_balance and not kind.of_load):
            return ()
        if not kind.drivers:
            sought = "time" in kind.at_port or (self.constant and bool(kind.at_port))
            return (None,) if sought and self.speeds else ()
        if "state" not in kind.drivers:
            return ()
        found: tuple[str | None, ...] = ()
        for what, names in (("speed", self.speeds), ("position", self.positions), ("level", self.levels)):
            found += names if what in kind.at_port else ()
        return found + (self.coupled if "coupled" in kind.at_port else ())


@dataclass(frozen=True)
class Places:
    """Where laws are sought."""

    balances: tuple[str, ...]  #: States
    ports: tuple[Port, ...] = ()

    def instances(self, kind: type[BaseEffect], plant: Plant) -> Iterator[BaseEffect]:
        """All places and variables of a plant where a kind of effect makes sense."""
        absent = set(getattr(plant.simulator, "absent_params", None) or ())
        is_law = issubclass(kind, BalanceEffect)
        balances = () if is_law and kind.of_load else self.balances
        yield from (e for e in kind.instances(plant, balances) if e.kind != "parameter" or e.location not in absent)
        if is_law:
            for port in self.ports:
                for variable in port.drivers(kind):
                    yield kind(port.name, variable)


def kind_at(effect: BaseEffect, plant: Plant) -> str:
    """What the location of an effect is on a plant: "state", "input" (or another port), "output" or "parameter"."""
    return "input" if at_port(effect, plant) else effect.kind


def at_port(effect: BaseEffect, plant: Plant) -> bool:
    """Whether a law acts at a port of a plant; a name that is a state's too means the state."""
    return effect.kind == "state" and effect.location not in plant.states and effect.location in plant.ports


def places_of(plant: Plant, balances: Sequence[str]) -> Places:
    """Where laws are sought on a plant: balances, and ports that are no balances.

    ``balances``: states whose balance may hold an effect.
    Returns Places: forces at further ports (joints) that together make every acceleration stand for laws of those
        balances.
    """
    if plant.access == "trajectory" or not plant.ports:
        return Places(tuple(balances))
    structure = structure_of(PlantModel(plant))
    speeds = tuple(dict.fromkeys(v for v in structure.speed_of.values() if v is not None))
    chosen = [k for k in range(len(plant.ports)) if _is_sought(structure, plant, k, speeds)]
    found = [_port(structure, plant, k, chosen, speeds) for k in chosen]
    further = [k for k in chosen if k >= len(plant.inputs)]
    made = _made_by(structure, plant, further, speeds)
    for k in _balanced(structure, plant, further):
        moved = tuple(plant.states[i] for i in np.flatnonzero(structure.moved[:, k]))
        found.append(Port(plant.ports[k], levels=moved, is_a_balance=True))
    return Places(tuple(name for name in balances if name not in made), tuple(p for p in found if p is not None))


def _balanced(structure: Structure, plant: Plant, further: Sequence[int]) -> list[int]:
    """Inputs that enter one balance in proportion, and no joint."""
    return [
        k
        for k in range(len(plant.inputs))
        if structure.is_a_balance(k) and not any(structure.parallel(k, other) for other in further)
    ]


def _is_sought(structure: Structure, plant: Plant, k: int, speeds: Sequence[str]) -> bool:
    """Whether laws are sought at a port: it is not a balance, and no further port says the same."""
    first = len(plant.inputs)
    if not np.isfinite(structure.gain[:, k]).any() or not structure.moved[:, k].any():
        return False
    moved = [plant.states[i] for i in np.flatnonzero(structure.moved[:, k])]
    offered = k >= first and set(moved) <= set(speeds)
    if structure.is_a_balance(k) and not offered:
        return False
    if len(moved) == 1 and moved[0] not in speeds:  # a flow times a state in one balance: a law of that balance, nearly
        return False
    others = range(first, len(plant.ports)) if k < first else range(first, k)
    return not any(structure.parallel(k, other) for other in others)


def _port(structure: Structure, plant: Plant, k: int, chosen: Sequence[int], speeds: Sequence[str]) -> Port | None:
    """A port with the states that may drive laws there."""
    name, loaded = plant.ports[k], k < len(plant.inputs) or hasattr(plant.simulator, "drive_forces")
    moved = tuple(plant.states[i] for i in np.flatnonzero(structure.moved[:, k]))
    if not set(moved) <= set(speeds):
        return Port(name, levels=moved, loaded=loaded)
    own = _own_speeds(structure, plant, k, chosen, moved, speeds)
    if not own:
        return None
    integrals = {v: q for q, v in structure.speed_of.items() if v is not None}
    others = tuple(v for v in moved if v not in own) if len(moved) <= FEW and k < len(plant.inputs) else ()
    coupled = (*others, *(integrals[v] for v in others))
    return Port(name, own, tuple(integrals[v] for v in own), (), coupled, k >= len(plant.inputs), loaded)


def _own_speeds(
    structure: Structure, plant: Plant, k: int, chosen: Sequence[int], moved: Sequence[str], speeds: Sequence[str]
) -> tuple[str, ...]:
    """The speed of the port itself, where there are as many ports as speeds they move.

    The gains are the inverse of a mass matrix then, columns times the gears. Of a matrix that is symmetric and positive
    definite, no permutation has a larger product of its entries than the diagonal, whatever factors rows and columns have.
    """
    fast = np.array([name in speeds for name in plant.states])
    same = [p for p in chosen if not structure.moved[~fast, p].any()]
    rows = np.flatnonzero(structure.moved[:, same].any(axis=1))
    size = np.nanmean(np.abs(structure.gain[rows][:, same]), axis=2)
    if len(same) < len(rows) and len(moved) <= FEW:
        return tuple(moved)
    found = linear_sum_assignment(-np.log(np.maximum(size, 1e-300)))
    own = [plant.states[rows[i]] for i, j in zip(*found) if same[j] == k]
    return tuple(name for name in own if name in moved)


def _made_by(structure: Structure, plant: Plant, ports: Sequence[int], speeds: Sequence[str]) -> set[str]:
    """Speeds whose every change of rate forces at some ports can make together: those ports span their rows of gains."""
    rows = [i for i, name in enumerate(plant.states) if name in speeds and structure.moved[i, list(ports)].any()]
    gain = structure.gain[rows][:, list(ports)]
    gain = gain[:, :, np.isfinite(gain).all(axis=(0, 1))]
    if not rows or not gain.size or len(ports) < len(rows):
        return set()
    size = np.maximum(np.max(np.abs(gain), axis=(1, 2), keepdims=True), 1e-300)
    ranks = np.linalg.matrix_rank((gain / size).transpose(2, 0, 1), tol=1e-9)
    return {plant.states[i] for i in rows} if np.all(ranks == len(rows)) else set()
