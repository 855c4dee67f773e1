"""Signals that may drive a law at a place, and the effect that a formula of them is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sksurrogate._units import may_be_one
from sksurrogate.effects._formula import Term, signal_names
from sksurrogate.effects._law import AnyLaw, LawEffect, law_effect
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import at_end
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._law_places import shown_inputs
from sksurrogate.gap.unnamed._law_shapes import filtered, varies
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import units_of

#: Time constants of the recent past, in samples, and the share of the longest run up to which they are tried.
TIME_CONSTANTS, LONGEST_PAST = (3.0, 10.0, 30.0, 100.0), 0.25


@dataclass(frozen=True, eq=False)
class Drivers:
    """Signals that may drive a law at the place of a channel."""

    channel: Channel  #: At a state (its balance), an input, a parameter or an output (its sensor)
    signals: Mapping[str, np.ndarray]  #: (n_samples,): by name; "lag(v)" is the recent past of v
    late: Mapping[str, float]  #: Time constants of those, whose names end with a mark behind "#"
    #: (n_samples,): the same at the end of each sample, where a law acts over samples
    ends: Mapping[str, np.ndarray] | None = None
    #: At an input: names of the inputs. A law of these acts along the path of the input, one of states at its port.
    along: Sequence[str] = ()
    changes: Sequence[float] = ()  #: Times at which a law may begin
    units: Mapping[str, str] = field(default_factory=dict)  #: Of the signals, where they are known

    def comparable(self, a: str, b: str) -> bool:
        """Whether a difference of two signals means something: of a temperature and a power there is none."""
        return may_be_one(self.units.get(a, ""), self.units.get(b, ""))

    def values(self, terms: Sequence[Term]) -> np.ndarray:
        """Terms along the path (n_terms, n_samples); their means over each sample, by both ends, where they act over samples."""
        record = self.channel.record
        out = np.empty((len(terms), record.n_samples))
        with np.errstate(all="ignore"):
            for k, term in enumerate(terms):
                out[k] = term.value(self.signals, record.t)
                if self.ends is not None:
                    out[k] = 0.5 * (out[k] + term.value(self.ends, record.t))
        return out

    def responses(self, terms: Sequence[Term]) -> np.ndarray:
        """What terms move the outputs by: (n_outputs, n_terms, n_samples)."""
        return self.channel.respond(self.values(terms))

    def allows(self, terms: Sequence[Term]) -> bool:
        """Whether an effect can hold these terms: one recent past with its own signal; along a path one signal more."""
        names = {factor[1] for term in terms for factor in term.factors}
        late = {name for name in names if name in self.late}
        plain = {signal for name in names - late for signal in signal_names(name)} - {"t"}
        if late and (len(late) > 1 or plain - {past_name(next(iter(late)))}):
            return False
        location, kind = self.channel.location, self.channel.kind
        return kind in ("state", "parameter") or self.at_port(plain) or len(plain - {location}) < 2

    def time_constant(self, terms: Sequence[Term]) -> float | None:
        """Of the recent past that a formula holds; None where it holds none."""
        return next((self.late[f[1]] for term in terms for f in term.factors if f[1] in self.late), None)

    def at_port(self, names: set[str]) -> bool:
        """Whether a law of some signals acts at a port: it has a state among them, or the port is none of the inputs."""
        location, kind = self.channel.location, self.channel.kind
        further = location not in self.along
        return kind == "input" and (further or bool(names - set(self.along) - {f"lag({location})"}))

    def effect(self, terms: Sequence[Term], values: np.ndarray, free: bool) -> AnyLaw:
        """A formula as an effect: coefficients, constants where they are ``free``, the time constant of a recent past."""
        terms = tuple(Term(tuple((f[0], f[1].partition("#")[0], *f[2:]) for f in term.factors)) for term in terms)
        names = {name for term in terms for name in term.variables}
        numbers = tuple(map(float, values))
        if self.at_port(names):
            return LawEffect(self.channel.location, "*".join(sorted(names)) or None, terms, numbers, free)
        return law_effect(self.channel.kind, self.channel.location, terms, numbers, free)

    @property
    def moving(self) -> list[str]:
        """Names of those that move."""
        return [name for name, z in self.signals.items() if varies(z)]

    @property
    def present(self) -> list[str]:
        """Names of those that move and are no recent past."""
        return [name for name in self.moving if name not in self.late]


def past_name(name: str) -> str:
    """The signal behind "lag(v)#0".

    >>> past_name("lag(v)#0")
    'v'
    """
    return name.partition("#")[0][4:-1]


def drivers_at(base: OdeCandidate, channel: Channel, changes: Sequence[float]) -> Drivers:
    """Signals that may drive a law at the place of a channel: states and inputs in a balance or a parameter, outputs and inputs at a sensor.

    At an input these are inputs, and states where no single balance stands for its port; at a further port both.
    """
    problem = base.problem
    plant, record, location, kind = problem.plant, channel.record, channel.location, channel.kind
    units = units_of(plant.simulator)
    assert channel.x is not None
    if kind == "output":
        seen = {**dict(zip(plant.outputs, base.fit.y)), **dict(zip(plant.inputs, shown_inputs(base)))}
        return Drivers(channel, seen, {}, changes=changes, units=units)
    states, inputs = dict(zip(plant.states, channel.x)), dict(zip(plant.inputs, record.u))
    if kind == "input":
        states = states if channel.n_moved > 1 or location not in inputs else {}
        own = {location: inputs[location]} if location in inputs else {}  # no signal enters at a further port
        signals, past = {**inputs, **states}, _past(record, own)
        held = {*inputs, *past}
    else:
        signals = {**states, **inputs}
        past = _past(record, signals) if kind == "state" else {}
        held = set() if record.order_of_inputs(plant.hold) else set(plant.inputs)
    now = {**signals, **{name: z for name, (z, _) in past.items()}}
    ends = {name: z if name in held else at_end(record, z[None])[0] for name, z in now.items()} if states else None
    return Drivers(channel, now, {name: c for name, (_, c) in past.items()}, ends, plant.inputs, changes, units)


def _past(record: Record, signals: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, float]]:
    """First-order filters of signals, settled at the start of every run, with their time constants."""
    out = {}
    longest = LONGEST_PAST * float(record.lengths.max())
    for name, z in signals.items():
        for k, samples in enumerate(c for c in TIME_CONSTANTS if c <= longest):
            out[f"lag({name})#{k}"] = filtered(record, z[None], samples)[0], samples * record.dt
    return out
