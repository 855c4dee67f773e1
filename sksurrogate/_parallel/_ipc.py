"""Messages between two processes: arrays travel in memory that both see, what both know from their beginning by name."""

from __future__ import annotations

import io
import mmap
import os
import pickle
import socket
import struct
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

try:
    import cloudpickle
except ImportError:  # an older joblib brings its own
    from joblib.externals import cloudpickle

#: Bytes of which the place of an array that travels is a multiple.
ALIGNED = 64
#: Bytes of an array from which it is worth a place of its own.
OWN_PLACE = 1024
#: What goes through the socket: bytes of what is pickled, number of arrays beside it.
HEAD = struct.Struct("<qq")


def send(line: socket.socket, message: object, known: Mapping[int, int]) -> None:
    """A message; of objects that are ``known`` (place by id) only their place."""
    stream, arrays = io.BytesIO(), []

    def beside(array: pickle.PickleBuffer) -> bool:
        small = array.raw().nbytes < OWN_PLACE
        if not small:
            arrays.append(array.raw())
        return small

    _Pickler(known, stream, 5, buffer_callback=beside).dump(message)
    memory = os.memfd_create("message")
    try:
        sizes = np.array([array.nbytes for array in arrays], np.int64)
        for block in (stream.getbuffer(), memoryview(sizes.tobytes()), *arrays):
            _write(memory, block)
        socket.send_fds(line, [HEAD.pack(stream.tell(), len(arrays))], [memory])
    finally:
        os.close(memory)


def receive(line: socket.socket, known: Sequence[object]) -> Any:
    """The next message; its arrays lie where they were written, changes stay here.

    Raises EOFError where the other process is gone.
    """
    head, memories, _, _ = socket.recv_fds(line, HEAD.size, 1)
    if not memories:
        raise EOFError("the other process is gone")
    try:
        n, count = HEAD.unpack(head)
        whole = memoryview(mmap.mmap(memories[0], 0, flags=mmap.MAP_PRIVATE))
    finally:
        os.close(memories[0])
    at = n + -n % ALIGNED
    sizes = np.frombuffer(whole, np.int64, count, at).tolist() if count else []
    ends = accumulate((size + -size % ALIGNED for size in [8 * count, *sizes]), initial=at)
    arrays = [whole[end : end + size] for end, size in zip(list(ends)[1:], sizes)]
    return _Unpickler(known, io.BytesIO(whole[:n]), buffers=arrays).load()


def _write(memory: int, block: memoryview) -> None:
    """Behind what is there, so that the next begins at a multiple of :data:`ALIGNED`."""
    done = 0
    while done < len(block):
        done += os.write(memory, block[done:])
    os.write(memory, bytes(-done % ALIGNED))


class _Pickler(cloudpickle.Pickler):
    """Functions travel with what they close over."""

    def __init__(self, known: Mapping[int, int], *given: Any, **more: Any):
        super().__init__(*given, **more)
        self._known = known

    def persistent_id(self, obj: object) -> int | None:
        return self._known.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, known: Sequence[object], *given: Any, **more: Any):
        super().__init__(*given, **more)
        self._known = known

    def persistent_load(self, place: int) -> object:
        return self._known[place]
