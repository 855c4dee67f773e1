"""What ``simulate`` gives for inputs, parameters and initial states: every simulation counts, and is made once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import ParameterEffect
from sksurrogate.effects._trajectory import acting_rows, plain_runs, readings, retuned_simulator
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.gap.fit._known_parameters import value_of
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.sampling import read_between, with_slopes
from sksurrogate.physics._foreign import LARGEST_OFFERED, offered
from sksurrogate.physics._simulator import Plant

#: Simulations that are kept.
RUNS_KEPT = 256
NOT_FINITE = "outputs that are not finite"


@dataclass(frozen=True, eq=False)
class Simulations:
    """Runs of a simulator over a record, and those with effects around it."""

    plant: Plant
    record: Record
    kept: dict[bytes, np.ndarray] = field(default_factory=dict)  #: The latest simulations
    #: What the simulator raised with effects, by its text: these candidates are lost
    raised: dict[str, None] = field(default_factory=dict)

    def run(self, u: np.ndarray, changed: Mapping[str, float], x0: np.ndarray | None) -> np.ndarray:
        """Outputs (n_outputs, n_samples) under inputs (n_inputs, n_samples); nan where the simulator fails."""
        check_time()
        key = u.tobytes() + repr(sorted(changed.items())).encode() + (b"" if x0 is None else x0.tobytes())
        if key in self.kept:
            return self.kept[key]
        try:
            out = self.simulated(u, changed, x0)
        except Exception as error:
            self.raised[f"{type(error).__name__}: {error}"] = None
            out = np.full((self.record.y.shape[0], self.record.n_samples), np.nan)
        if len(self.kept) >= RUNS_KEPT:
            self.kept.pop(next(iter(self.kept)))
        self.kept[key] = out
        return out

    def simulated(self, u: np.ndarray, changed: Mapping[str, float], x0: np.ndarray | None) -> np.ndarray:
        """The same; what the simulator raises comes through, but where it says that a run diverged."""
        record = self.record
        simulator = retuned_simulator(self.plant.simulator, changed)
        out = np.full((record.y.shape[0], record.n_samples), np.nan)
        if not offered(u).all():
            return out
        lengths = record.lengths
        for n in np.unique(lengths):
            runs = np.flatnonzero(lengths == n)
            rows = record.starts[runs][:, None] + np.arange(n)
            try:
                Y = plain_runs(simulator, u[:, rows].transpose(1, 2, 0), None if x0 is None else x0[runs], None)
            except SimulationDiverged as error:
                said = error.__cause__  # of a program that refused the run
                self.raised[NOT_FINITE if said is None else f"{type(said).__name__}: {said}"] = None
                continue
            if Y.shape[1] != n:
                raise SimulatorError(f"simulate returned {Y.shape[1]} rows for {n} rows of inputs: one for each row.")
            if Y.shape[2] != len(out):
                raise SimulatorError(
                    f"simulate returned {Y.shape[2]} outputs, but y has {len(out)} columns: one for each output."
                )
            out[:, rows] = Y.transpose(2, 0, 1)
        bearable = np.abs(out) <= LARGEST_OFFERED
        if not bearable.all():
            self.raised.setdefault(NOT_FINITE)
        return np.where(bearable, out, np.nan)

    def outputs(
        self, effects: Sequence[BaseEffect], theta: np.ndarray, x0: np.ndarray | None, free: Sequence[str]
    ) -> np.ndarray:
        """All runs with effects, (n_outputs, n_samples); ``free``: parameters that are re-tuned."""
        y = self.run(self.acting(effects, theta), self.changed(effects, theta, free), x0)
        return self.read(effects, theta, y)

    def changed(self, effects: Sequence[BaseEffect], theta: np.ndarray, free: Sequence[str]) -> dict[str, float]:
        """Parameters that differ from the simulator's."""
        *parts, rest = parts_of(effects, theta)
        out = {name: value_of(self.plant.params[name], phi) for name, phi in zip(free, rest)}
        for effect, values in zip(effects, parts):
            if isinstance(effect, ParameterEffect):
                name = str(effect.location)
                out[name] = float(effect.value(out.get(name, self.plant.params[name]), 0.0, list(values), 0.0))
        return {name: value for name, value in out.items() if value != self.plant.params[name]}

    def acting(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Inputs behind the actuators (n_inputs, n_samples)."""
        record = self.record
        if not any(effect.kind == "input" for effect in effects):
            return record.u
        return acting_rows(self.plant, list(effects), parts_of(effects, theta)[:-1], record.u, record.dt, record.starts)

    def read(self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Readings of the sensors along outputs (n_outputs, n_samples)."""
        if not any(effect.kind == "output" for effect in effects):
            return self.at_stamps(y)
        record, parts = self.record, parts_of(effects, theta)[:-1]
        out, acting = y.copy(), self.acting(effects, theta)
        for a, b in record.spans:
            t = record.t[a:b] - record.t[a]
            out[:, a:b] = readings(self.plant, list(effects), parts, y[:, a:b].T, acting[:, a:b].T, t, record.dt).T
        return self.at_stamps(out)

    def at_stamps(self, y: np.ndarray) -> np.ndarray:
        """Outputs (n_outputs, n_samples) where their readings were taken."""
        record = self.record
        if record.offset is None:
            return y
        slope = with_slopes(y, record.dt, record.starts)
        return read_between(y, slope, slope, y, -record.offset[None] / record.dt, record.dt, record.starts)[0]


def parts_of(effects: Sequence[BaseEffect], theta: np.ndarray) -> list[np.ndarray]:
    """Parameters of every effect, and the free parameters."""
    return np.split(theta, np.cumsum([len(effect.parameters) for effect in effects], dtype=int))


_BOUND = "Bound what the simulator computes (np.clip) or check x0 and the units of X."
_LEAVE = "Give smaller inputs, or leave the run out."


def divergence(plant: Plant, record: Record, nominal: np.ndarray, labels: Sequence[object]) -> SimulationDiverged:
    """The error for the first run whose outputs are not finite, with what the simulator itself says of it.

    Runs of one length are simulated at once, and one that raises takes the others with it: each is tried alone.

    ``nominal`` (n_outputs, n_samples): outputs of the simulator, not all finite.
    ``labels``: one for each run.
    """
    for run, (a, b) in enumerate(record.spans):
        Y = nominal[:, a:b]
        if np.all(np.isfinite(Y)):
            continue
        label = labels[run] if len(labels) > 1 else None
        name = "" if label is None else f"run {label!r}, "
        try:
            Y = plain_runs(plant.simulator, record.u[None, :, a:b].transpose(0, 2, 1), None, None)[0].T
        except SimulationDiverged as error:
            return SimulationDiverged(
                f"simulate diverges for the inputs in X: {name}{str(error).rstrip('. ')}. {_LEAVE}",
                run=label,
                row=error.row,
                time=error.time,
                state=error.state,
            )
        bad = ~(np.abs(Y) <= LARGEST_OFFERED)
        if bad.any():
            row = int(np.flatnonzero(bad.any(axis=0))[0])
            output = plant.outputs[int(np.flatnonzero(bad[:, row])[0])]
            time, value = float(record.t[a + row]), Y[bad[:, row], row][0]
            return SimulationDiverged(
                f"simulate gives {value} for the inputs in X: {name}row {row}, t = {time:g}, output {output!r}, expected finite "
                f"numbers. {_BOUND} {_LEAVE}",
                run=label,
                row=row,
                time=time,
                state=output,
            )
    return SimulationDiverged(
        "simulate_batch gives values that are not finite for runs that are finite one by one, expected the same of both. "
        "Correct simulate_batch, or leave it out."
    )
