"""How much of a gap re-tuning cannot close: an effect that free parameters imitate is not a question about effects."""

from __future__ import annotations

from typing import Any

from sksurrogate.blind._cases import Case, draw
from sksurrogate.blind._gap import gap_beyond
from sksurrogate.blind._march import march


def beyond_retuning(case: Case) -> float:
    """The gap over the noise that stays when all parameters and initial states of the simulator are fitted to the plant.

    Without noise, from the true parameters, with the check's own integrator.

    >>> from sksurrogate.blind import draw
    >>> case = draw("effect", 1)
    >>> bool(0 <= beyond_retuning(case) <= 1.01 * case.facts["gap_over_noise"])
    True
    """
    plant, question = case.plant, case.question
    n_runs = int(question.groups.max()) + 1
    U = question.X.reshape(n_runs, -1, question.X.shape[1])
    outputs = march(plant, U, case.starts, case.truths, substeps=12).outputs
    return gap_beyond(plant, U, case.starts, outputs, case.unit, retune=True)


def with_retuning(row: dict[str, Any]) -> dict[str, Any]:
    """A row of the arm *detuned* with ``gap_beyond_retuning``; its case is drawn once more where that is not known."""
    if row["arm"] != "detuned" or "gap_beyond_retuning" in row or row.get("right") is None:
        return row
    return {**row, "gap_beyond_retuning": beyond_retuning(draw(row["arm"], row["seed"]))}
