"""For all tests: no window, one thread a process, no time limit on hypothesis' examples, the same random numbers in every run."""

import os
import sys

import numpy as np
import pytest
from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile("shared", deadline=None)
settings.load_profile("shared")


@pytest.fixture(autouse=True)
def _seeded():
    """Estimators without ``random_state`` draw the same numbers in every run, whatever ran before on the same worker."""
    np.random.seed(0)  # noqa: NPY002  the generator that scikit-learn takes by default
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(0)
