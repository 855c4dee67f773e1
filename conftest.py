"""For all tests: no window, one thread a process, no time limit on hypothesis' examples, the same random numbers in every run.

``pytest --slow`` runs every test, and so does ``pytest`` with paths; a plain ``pytest`` only one in :data:`ONE_IN` of those
marked ``slow``, always the same ones.
"""

import os
import sys
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile("shared", deadline=None)
settings.load_profile("shared")


#: Of the slow tests one in so many is the sample.
ONE_IN = 6


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help=f"run all slow tests, not one in {ONE_IN}")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--slow") or {Path(arg).name for arg in config.args} != set(config.getini("testpaths")):
        return
    left = {item for item in items if item.get_closest_marker("slow") and crc32(item.nodeid.encode()) % ONE_IN}
    config.hook.pytest_deselected(items=list(left))
    items[:] = [item for item in items if item not in left]


@pytest.fixture(autouse=True)
def _seeded():
    """Estimators without ``random_state`` draw the same numbers in every run, whatever ran before on the same worker."""
    np.random.seed(0)  # noqa: NPY002  the generator that scikit-learn takes by default
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(0)
