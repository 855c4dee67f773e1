"""Whole runs of a unit by FMPy: what a unit gives that shows no equations."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulationDiverged, SimulatorError, require
from sksurrogate.physics._fmu_unit import OpenUnit, equal_steps

#: How the types of variables begin that are no whole numbers, in FMI 2 and 3; text is left to FMPy.
CONTINUOUS = ("Real", "Float", "String", "Binary")


def run_whole(
    unit: OpenUnit, path: Any, rows: np.ndarray, times: np.ndarray, dt: float, values: dict[str, float], inputs: list[str],
    outputs: list[str],
) -> np.ndarray:  # fmt: skip
    """Outputs (n_samples, n_outputs) of one run by FMPy; inputs are held by stating each both at its first and just before the
    next sample. Values of integers, booleans and enumerations are rounded to the nearest whole number.

    ``path``: as the user gave it.
    ``rows`` (n_samples, n_inputs), ``times`` (n_samples,).
    ``dt``: width of the step behind a single row.
    ``values``: start values by name.
    Raises SimulationDiverged where the unit stopped.
    Raises SimulatorError where it takes no steps of several widths.
    """
    counted = {
        variable.name for variable in unit.description.modelVariables if not variable.type.startswith(CONTINUOUS)
    }
    rows = np.where([name in counted for name in inputs], np.rint(rows), rows)
    values = {name: np.rint(value) if name in counted else value for name, value in values.items()}
    single = len(rows) == 1
    if single:
        rows, times = np.repeat(rows, 2, axis=0), np.array([times[0], times[0] + dt])
    exchange = unit.kind == "ModelExchange"
    # Two rows at one time are an event: there the solver of a model exchange halts and writes its outputs down.
    doubled, held = (np.repeat(times, 2)[1:-1], np.repeat(rows[:-1], 2, axis=0)) if exchange else (times, rows)
    signal = None
    if inputs or exchange:
        signal = np.array(
            [(a, *b) for a, b in zip(doubled, held)], dtype=[("time", float), *((name, float) for name in inputs)]
        )
    stretches = [(0, len(times) - 1)] if exchange else equal_steps(times)
    if len(stretches) > 1 and not unit.description.coSimulation.canHandleVariableCommunicationStepSize:
        raise SimulatorError(
            f"t has steps from {np.diff(times).min():g} to {np.diff(times).max():g}, but the unit {path!s} takes steps of one "
            "width only (canHandleVariableCommunicationStepSize is false): resample U and t evenly."
        )

    def once(instance: Any) -> np.ndarray:
        parts = [_stretch(unit, path, instance, times, a, b, values, signal, outputs) for a, b in stretches]
        return np.concatenate([part[k > 0 :] for k, part in enumerate(parts)])

    try:
        found = unit.run(once)
    except SimulatorError:
        raise
    except Exception as error:  # whatever a binary and its wrapper raise
        raise SimulationDiverged(
            f"the unit {path!s} stopped: {type(error).__name__}: {error}.{unit.messages}"
        ) from error
    return found[:1] if single else found


def _stretch(
    unit: OpenUnit, path: Any, instance: Any, times: np.ndarray, a: int, b: int, values: dict[str, float], signal: np.ndarray | None,
    outputs: list[str],
) -> np.ndarray:  # fmt: skip
    """Outputs at the rows a to b, which are evenly apart for a co-simulation; it goes on where the last one ended."""
    step, last = float(times[a + 1] - times[a]), b == len(times) - 1
    result = require("fmpy", "fmu").simulate_fmu(
        unit.folder, model_description=unit.description, fmu_instance=instance, fmi_type=unit.kind, start_time=times[a],
        stop_time=times[b], step_size=step, output_interval=step, start_values=dict(values), input=signal, output=outputs,
        relative_tolerance=1e-8, validate=False, initialize=a == 0, terminate=last, set_stop_time=a == 0 and last,
    )  # fmt: skip
    clock = np.asarray(result["time"], dtype=float)
    rows_at = np.searchsorted(clock, times[a : b + 1] - 1e-9 * step, side="left")
    if rows_at.max() >= len(clock):
        raise SimulatorError(
            f"the unit {path!s} ended at t = {clock[-1]:g}, expected values up to t = {times[b]:g}: leave out the rows behind, or "
            f"let the model run on.{unit.messages}"
        )
    return np.stack([np.asarray(result[name], dtype=float)[rows_at] for name in outputs], axis=1)
