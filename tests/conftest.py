"""For all tests: no window, one thread a process, no time limit on hypothesis' examples (other jobs may share the machine)."""

import os

from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile("shared", deadline=None)
settings.load_profile("shared")
