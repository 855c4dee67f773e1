"""The other process: it gets questions, gives answers as plain data, and knows nothing else."""

from __future__ import annotations

import importlib
import json
import os
import pickle
import select
import struct
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, BinaryIO

import numpy as np
from joblib.externals.loky.backend.reduction import dumps

from sksurrogate._parallel._interrupts import interrupts_blocked
from sksurrogate._parallel._orphans import watch_parent
from sksurrogate.blind._cases import Question
from sksurrogate.exceptions import SimulatorError

#: Which function of the other process answers.
DEFAULT = "sksurrogate.blind._solve:ask_gap_diagnoser"

#: A process answers this many questions; then a fresh one takes over, so that memory does not grow.
FRESH = 40


def ask_gap_diagnoser(question: Question) -> dict[str, Any]:
    """The package's own diagnosis, as plain data."""
    from sksurrogate.gap import GapDiagnoser

    simulator = question.simulator
    diagnoser = GapDiagnoser(
        simulator, effects=question.effects, free_params=question.free_params, time=question.time, random_state=0
    )  # the same seed in every case: it only orders bootstrap draws
    started, busy = time.perf_counter(), processor_seconds()
    report = diagnoser.fit(question.X, question.y, groups=question.groups).report_
    seconds, busy = time.perf_counter() - started, processor_seconds() - busy
    shrink = report.shrink
    return {
        "verdict": report.verdict,
        "sentence": report.sentence,
        "reasons": {"rule": report.reasons.rule, **plain(report.reasons.features)},
        "effects": [
            {
                "name": e.name, "location": e.location, "variable": e.variable, "share": e.share, "params": e.params,
                "intervals": {k: list(v) for k, v in e.intervals.items()}, "probability": e.probability,
                "equivalents": [list(other) for other in e.equivalents],
            }
            for e in report.effects
        ],
        "remainder": plain(asdict(report.remainder)),
        "where": {
            "location": report.where.location, "kind": report.where.kind,
            "by_region": [dict(row) for row in report.where.by_region], "by_time": [dict(row) for row in report.where.by_time],
        },
        "shrink": {
            "before": shrink.before, "after": shrink.after, "floor": shrink.floor, "fraction": shrink.fraction,
            "interval": list(shrink.interval), "retuning": shrink.fraction_retuning, "correction": shrink.fraction_correction,
        },
        "missing_term": missing(report.missing_term),
        "law": law(report.missing_term),
        "predicted_far": None if question.X_far is None else predict(diagnoser.augmented_, question, far=True),
        "next_experiment": suggestion(report.next_experiment),
        "notes": list(report.notes),
        "predicted": predict(diagnoser.augmented_, question),
        "evidence": [
            [r["name"], r["location"], r["variable"], r["evidence"]] for r in report.ranking if np.isfinite(r["evidence"])
        ],
        "seconds": seconds, "processor_seconds": busy,
        "columns": int(getattr(simulator.rhs, "columns", 0)),
    }  # fmt: skip


def plain(features: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers, flags and words as JSON holds them."""

    def one(value: Any) -> Any:
        if value is None or isinstance(value, str):
            return value
        return bool(value) if isinstance(value, bool | np.bool_) else float(value)

    return {key: one(value) for key, value in features.items()}


def processor_seconds() -> float:
    """Of this process and of those that it started and that have ended."""
    return sum(os.times()[:4])


def missing(term: Any) -> dict[str, Any] | None:
    """The shape of what is missing."""
    if term is None:
        return None
    keys = ("variable", "at", "value", "low", "high", "explained")
    curves = [{key: getattr(curve, key) for key in keys} for curve in term.curves]
    return {"location": term.location, "kind": term.kind, "curves": curves, "candidates": list(term.candidates)}


def law(term: Any) -> dict[str, Any] | None:
    """The formula for what is missing: text, place, and the shapes and drivers of each of its terms."""
    found = getattr(term, "law", None)
    if found is None:
        return None
    terms = [
        {"shapes": [f[0] for f in one.factors], "drivers": list(one.variables)}
        for one in found.effect.terms
        if one.factors
    ]
    return {
        "text": str(found),
        "location": found.location,
        "kind": found.kind,
        "certified": found.certified,
        "terms": terms,
    }


def suggestion(following: Any) -> dict[str, Any] | None:
    """The next experiment: the best option and its gain in nats."""
    if following is None:
        return None
    options = [row for row in following.options if row["gain"] >= 3.0]
    best = max(options, key=lambda row: row["gain"]) if options else {"experiment": None, "gain": None}
    return {"sentence": following.sentence, "best": best["experiment"], "gain": best["gain"]}


def predict(simulator: Any, question: Question, far: bool = False) -> list[Any]:
    """Free runs over the test inputs, or over those beyond the range; nan where they diverge."""
    found = []
    inputs, starts = (question.X_far, question.x0_far) if far else (question.X_test, question.x0_test)
    for U, x0 in zip([] if inputs is None else inputs, [] if starts is None else starts):
        try:
            found.append(np.asarray(simulator.simulate(U, x0=x0)).tolist())
        except Exception:  # a prediction that fails is scored as no prediction
            found.append(np.full((len(U), question.y.shape[1]), np.nan).tolist())
    return found


class Solver:
    """A process that answers questions, started by exec and not by fork: it inherits no memory.

    ``function``: ``module:function`` of one argument, a :class:`Question`; it returns plain data.
    ``limit``: seconds for one question.
    """

    def __init__(self, function: str = DEFAULT, limit: float = 600.0):
        self.function = function
        self.limit = limit
        self._process: subprocess.Popen[bytes] | None = None
        self._asked = 0

    def ask(self, question: Question) -> dict[str, Any]:
        """The answer; ``{"error": ...}`` where the diagnosis fails, dies or takes too long."""
        if self._asked >= FRESH:
            self.close()
        process = self._started()
        self._asked += 1
        assert process.stdin is not None and process.stdout is not None
        try:
            send(process.stdin, _packed(question))
            answer: dict[str, Any] = json.loads(receive(process.stdout, time.monotonic() + self.limit))
        except (OSError, EOFError, TimeoutError) as error:
            self.close()
            return {"error": f"{type(error).__name__}: {error}"}
        return answer

    def _started(self) -> subprocess.Popen[bytes]:
        """The process, started where there is none."""
        if self._process is None or self._process.poll() is not None:
            paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
            threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
            self._asked = 0
            with interrupts_blocked():
                self._process = subprocess.Popen(
                    [sys.executable, "-c", "from sksurrogate.blind._solve import main; main()", self.function],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=tempfile.gettempdir(),
                    env={**os.environ, "PYTHONPATH": paths, **threads},
                )  # fmt: skip
        return self._process

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout):
                if stream is not None:
                    stream.close()
            self._process = None

    def __enter__(self) -> Solver:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _packed(question: Question) -> bytes:
    """A question as bytes; what is defined in a script or in a file that no import finds goes along by value."""
    try:
        return bytes(dumps(question))
    except (TypeError, AttributeError, pickle.PicklingError) as error:
        raise SimulatorError(
            f"simulator={question.simulator!r} cannot be sent to the diagnosing process ({error}): use plain functions or "
            "classes, without open files, locks or handles."
        ) from error


def send(stream: BinaryIO | Any, message: bytes) -> None:
    """Length, then the message."""
    stream.write(struct.pack(">Q", len(message)) + message)
    stream.flush()


def receive(stream: BinaryIO | Any, deadline: float | None = None) -> bytes:
    """A message; waits until the deadline."""
    (length,) = struct.unpack(">Q", _exactly(stream, 8, deadline))
    return _exactly(stream, int(length), deadline)


def _exactly(stream: BinaryIO | Any, count: int, deadline: float | None) -> bytes:
    """That many bytes."""
    parts, have = [], 0
    while have < count:
        if deadline is not None and not select.select([stream], [], [], max(deadline - time.monotonic(), 0.0))[0]:
            raise TimeoutError("no answer in time")
        part = os.read(stream.fileno(), min(count - have, 1 << 20))
        if not part:
            raise EOFError("the other process ended")
        parts.append(part)
        have += len(part)
    return b"".join(parts)


def serve(function: Callable[[Question], dict[str, Any]], source: BinaryIO, target: BinaryIO) -> None:
    """Answer questions until there are no more."""
    while True:
        try:
            question = pickle.loads(receive(source))
        except EOFError:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                answer = function(question)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            answer = {"error": f"{type(error).__name__}: {error} ({os.path.basename(last.filename)}:{last.lineno})"}
        send(target, json.dumps(answer, default=_plain).encode())


def _plain(value: Any) -> Any:
    """numpy's numbers and arrays as plain data."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)


def main() -> None:
    """Entry point of the other process; what it prints goes to the error stream."""
    watch_parent()  # a question may take minutes, and nobody would read its answer
    module, _, name = sys.argv[1].partition(":")
    target = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    serve(getattr(importlib.import_module(module), name), sys.stdin.buffer, target)
