"""Memory that is freed and asked for again at every step of a kernel."""

from __future__ import annotations

import numpy as np

#: Bytes of the block whose release tells the C library to keep as much; below the 32 MiB from where it no longer learns.
_RELEASED_BYTES = 8 * 2**20


def keep_freed_memory() -> None:
    """Let the C library keep some megabytes of freed memory.

    By default glibc hands temporaries of 128 KiB and more back to the system as soon as they are freed, and a kernel that
    makes a few at every stage pays for their pages again and again, up to half of its time. It raises that limit to
    twice the size of the largest block that was ever freed: one is made, untouched, and freed. Without glibc nothing happens.
    """
    np.empty(_RELEASED_BYTES // 8)
