"""Linear least squares end on any numbers."""

from pathlib import Path

import numpy as np
import pytest

import sksurrogate
from sksurrogate.kernels.arrow import _solve
from sksurrogate.kernels.linear_fit import linear_least_squares


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    A = np.eye(3)
    A[0, 1] = bad
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        linear_least_squares(A, np.ones(3))
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        linear_least_squares(np.eye(3), np.array([1.0, bad, 0.0]))
    assert np.isnan(_solve(A, np.ones(3))).all()


def test_shortest_solution_satisfies_the_normal_equations():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(9, 4)), rng.normal(size=(9, 2))
    A[:, 3] = A[:, 0]  # one direction is not seen
    x = linear_least_squares(A, b, rcond=1e-10)
    np.testing.assert_allclose(A.T @ (A @ x - b), 0.0, atol=1e-12)
    np.testing.assert_allclose(x[0], x[3])  # the shortest one shares it


def test_no_module_hands_raw_numbers_to_lapack_least_squares():
    """Of nan it may not return: only the guarded function may call it, and two places that stand apart from the kernels."""
    root = Path(sksurrogate.__file__).parent
    code = {p.relative_to(root).as_posix(): p.read_text("utf-8") for p in root.rglob("*.py")}
    callers = {
        name
        for name, text in code.items()
        if any("linalg.lstsq(" in line and ">>>" not in line for line in text.splitlines())
    }
    assert {name for name in callers if not name.startswith(("blind/", "export/"))} == {"kernels/linear_fit.py"}
