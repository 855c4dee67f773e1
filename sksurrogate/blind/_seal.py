"""The seal: the truth goes to a file that is random noise to everyone but the process that holds the pad."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sksurrogate.exceptions import SurrogateError


@dataclass(frozen=True)
class Seal:
    """A closed seal."""

    path: Path  #: File with the hash and the sealed truth
    sha256: str  #: Hash of the plain text, salt included: published before the diagnosis, it binds the truth
    pad: bytes = field(repr=False)  #: One-time pad, held in memory only

    def open(self) -> dict[str, Any]:
        """Open and verify.

        Returns what was sealed.
        Raises SurrogateError where the file is not the one that was sealed.
        """
        stored = json.loads(self.path.read_text(encoding="utf-8"))
        sealed = bytes.fromhex(stored["sealed"])
        plain = bytes(a ^ b for a, b in zip(sealed, self.pad))
        if len(sealed) != len(self.pad) or hashlib.sha256(plain).hexdigest() != self.sha256:
            raise SurrogateError(
                f"{self.path.name} is not what was sealed (its hash differs): the case does not count."
            )
        content: dict[str, Any] = json.loads(plain[32:].decode())
        return content

    def __getstate__(self) -> dict[str, Any]:
        raise TypeError("a seal stays in the process that closed it: its pad is the only key.")


def close_seal(content: dict[str, Any], folder: Any) -> Seal:
    """Seal plain data in a file of its own.

    ``content``: plain data, as JSON takes them.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     seal = close_seal({"name": "sensor_bias"}, folder)
    ...     b"sensor_bias" in seal.path.read_bytes(), seal.open()
    (False, {'name': 'sensor_bias'})
    """
    plain = secrets.token_bytes(32) + json.dumps(content, sort_keys=True).encode()
    plain += b" " * (-len(plain) % 4096)  # the length tells nothing either
    pad = secrets.token_bytes(len(plain))
    sha256 = hashlib.sha256(plain).hexdigest()
    path = Path(folder) / f"{secrets.token_hex(8)}.sealed"
    text = json.dumps({"sha256": sha256, "sealed": bytes(a ^ b for a, b in zip(plain, pad)).hex()})
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
    return Seal(path, sha256, pad)
