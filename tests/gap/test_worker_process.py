"""A second process answers as this one would, and its silence costs nothing but time."""

import os
import subprocess
import sys
import threading
import time

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate._parallel._worker_process import WorkerProcess, can_fork, one_thread

#: In a process of its own: test runners have threads, beside which no second process is made.
forks = """
import os
import time
import numpy as np
from sksurrogate._parallel._worker_process import WorkerProcess, can_fork
from sksurrogate._parallel._parallel_map import side_by_side
assert can_fork()
here = os.getpid()
"""
needs_fork = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="a second process needs a fork and a second core",
)


def printed(script):
    """What a script prints."""
    done = subprocess.run([sys.executable, "-c", forks + script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@needs_fork
def test_questions_are_answered_in_one_other_process_and_the_answers_come_back():
    script = """
second = WorkerProcess()
there = [second.ask(os.getpid).answer() for _ in range(3)]
print(there[0] == here, len(set(there)), WorkerProcess(apart=False).ask(os.getpid).answer() == here)
print([WorkerProcess(later=later).ask(lambda: os.nice(0)).answer() - os.nice(0) for later in (False, True)])
first, last = second.ask(lambda: 'first'), second.ask(lambda: 'last')
print(last.answer(), first.answer())
"""
    assert printed(script).splitlines() == ["False 1 True", "[0, 10]", "last first"]


@needs_fork
def test_arrays_travel_and_changes_stay_where_they_are_made():
    script = """
big = np.arange(6000.0)
strided = np.arange(12000.0).reshape(2, 3, 2000).transpose(2, 0, 1)
def changed():
    big[:] = 1.0
    return [big, np.zeros((2, 0)), strided, np.asfortranarray(strided[0]), np.arange(7), 'end']
found = WorkerProcess().ask(changed).answer()
found[0][0] = found[4][0] = 5
print(big.sum() == 5999 * 3000, found[0].sum(), found[1].shape, (found[2] == strided).all(), (found[3] == strided[0]).all())
print(found[4].sum(), found[5])
"""
    assert printed(script) == "True 6004.0 (2, 0) True True\n26 end"


@needs_fork
def test_what_is_known_from_the_beginning_does_not_travel():
    script = """
class Handle:
    def __reduce__(self): raise TypeError('not to be sent')
handle, other = Handle(), Handle()
second = WorkerProcess(known=[handle])
pid, back = second.ask(lambda: (os.getpid(), handle)).answer()
print(pid != here, back is handle, second.ask(lambda: (os.getpid(), other)[0]).answer() == here)
"""
    assert printed(script) == "True True True"


@needs_fork
def test_numpy_heeds_there_what_it_was_told_here():
    script = """
import warnings
warnings.simplefilter('error')
second = WorkerProcess()
with np.errstate(divide='ignore'):
    print(second.ask(lambda: np.ones(1) / 0).answer())
try:
    second.ask(lambda: np.ones(1) / 0).answer()
except RuntimeWarning as warning:
    print(warning)
"""
    assert printed(script).splitlines() == ["[inf]", "divide by zero encountered in divide"]


@needs_fork
def test_two_processes_meet_in_the_middle():
    slow = "second = WorkerProcess()\ndef slow(k):\n    time.sleep(0.3)\n    return k, os.getpid() == here\n"
    script = slow + "found = side_by_side(slow, list(range(6)), second)\n"
    assert printed(script + "print([k for k, _ in found], found[0][1], found[5][1])") == "[0, 1, 2, 3, 4, 5] True False"
    again = "print(all(side_by_side(lambda k: k * n, list(range(n)), second) == [k * n for k in range(n)] for n in range(200)))"
    assert printed(slow + again) == "True"


@needs_fork
def test_an_error_here_leaves_nobody_at_work_on_the_items():
    script = """
second = WorkerProcess()
waiting = second.ask(lambda: 'asked before')
def some(k):
    time.sleep(0.1)
    return 1 / (k - 1)
try:
    side_by_side(some, list(range(8)), second)
except ZeroDivisionError:
    print(waiting.answer(), side_by_side(lambda k: k, list(range(8)), second), second.ask(os.getpid).answer() != here)
"""
    assert printed(script) == "asked before [0, 1, 2, 3, 4, 5, 6, 7] True"


@needs_fork
@pytest.mark.parametrize(
    "question",
    ["lambda: 1 if os.getpid() == here else os.kill(os.getpid(), 9)", "lambda: 1 if os.getpid() == here else 1 / 0",
     "lambda: 1 if os.getpid() == here else (k for k in range(3))"],
    ids=["killed", "raised", "not to be sent"],
)  # fmt: skip
def test_without_an_answer_the_question_is_answered_here(question):
    assert (
        printed(f"second = WorkerProcess()\nprint(second.ask({question}).answer(), second.ask(lambda: 2).answer())")
        == "1 2"
    )


@needs_fork
def test_an_error_is_raised_where_the_answer_is_wanted_and_a_warning_is_heard_there():
    script = """
import warnings
second = WorkerProcess()
with warnings.catch_warnings(record=True) as heard:
    warnings.simplefilter('always')
    second.ask(lambda: warnings.warn('careful')).answer()
print(len(heard), heard[0].message)
wrong = second.ask(lambda: 1 / 0)
try:
    wrong.answer()
except ZeroDivisionError as error:
    print(repr(error))
"""
    assert printed(script) == "1 careful\nZeroDivisionError('division by zero')"


@needs_fork
@pytest.mark.parametrize(
    "refused",
    ["def refused(*given): raise BlockingIOError('no more processes')\nos.fork = refused\n",
     "import resource\nfrom sksurrogate._parallel._worker_process import libraries\nlibraries()\nresource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))\n"],
    ids=["no process", "no file"],
)  # fmt: skip
def test_where_no_process_may_be_made_the_question_is_answered_here(refused):
    assert printed("second = WorkerProcess()\n" + refused + "print(second.ask(os.getpid).answer() == here)") == "True"


@needs_fork
def test_a_process_that_is_left_is_ended():
    script = """
import multiprocessing
with WorkerProcess() as second:
    second.ask(lambda: time.sleep(60))
started = time.monotonic()
while multiprocessing.active_children() and time.monotonic() - started < 30:
    time.sleep(0.05)
print('there' if multiprocessing.active_children() else 'gone')
"""
    assert printed(script) == "gone"


@needs_fork
def test_processes_whose_first_one_is_gone_end():
    code = "import os, time\nfrom sksurrogate._parallel._worker_process import WorkerProcess\none, other = WorkerProcess(), WorkerProcess(later=True)\n"
    code += "print(one.ask(os.getpid).answer(), other.ask(os.getpid).answer(), flush=True)\ntime.sleep(120)\n"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as first:
        pids = first.stdout.readline().split()
        first.kill()
    started = time.monotonic()
    while any(map(alive, pids)) and time.monotonic() - started < 30:
        time.sleep(0.05)
    assert len(pids) == 2 and not any(map(alive, pids))


def alive(pid):
    """Whether a process is there that has not ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@needs_fork
def test_items_of_a_process_that_died_are_asked_here():
    script = "def asked(k):\n    time.sleep(0.05)\n"
    script += "    if k == 3 and os.getpid() != here:\n        os.kill(os.getpid(), 9)\n    return k\n"
    assert printed(script + "print(side_by_side(asked, list(range(8)), WorkerProcess()))") == "[0, 1, 2, 3, 4, 5, 6, 7]"


@needs_fork
def test_one_that_does_not_answer_in_time_is_not_waited_for():
    script = "from sksurrogate._parallel import _worker_process\n_worker_process.PATIENCE = 0.2\n_worker_process.TIMES = 0.0\n"
    question = "lambda: 1 if os.getpid() == here else time.sleep(60)"
    started = time.monotonic()
    assert printed(script + f"print(WorkerProcess().ask({question}).answer())") == "1"
    assert time.monotonic() - started < 50


def test_beside_other_threads_all_is_answered_here():
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    try:
        assert not can_fork()
        assert WorkerProcess().ask(os.getpid).answer() == os.getpid()
    finally:
        stop.set()
        other.join()


@pytest.mark.parametrize("second", [None, WorkerProcess(apart=False)], ids=["none", "not wanted"])
def test_here_every_item_is_asked_once_and_stays_in_its_place(second):
    asked = []
    assert side_by_side(lambda k: asked.append(k) or k**2, range(5), second) == [0, 1, 4, 9, 16]
    assert sorted(asked) == list(range(5))
    assert side_by_side(lambda k: k, [], second) == []


def test_linear_algebra_keeps_to_one_thread_and_has_its_own_back_afterwards():
    def threads():
        return [row["num_threads"] for row in threadpool_info() if row["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        with one_thread():
            assert set(threads()) == {1}
        assert set(threads()) == {2}


DIAGNOSIS = """
import warnings
from dataclasses import replace
from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.gap.results._provenance import UNKNOWN_PROVENANCE
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
count = []
wait = WorkerProcess.wait
def counted(self, *given):
    answer = wait(self, *given)
    count.append(answer.answered)
    return answer
WorkerProcess.wait = counted
X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
for n_jobs in (None, 1):
    diagnoser = GapDiagnoser(make_reactor(second=80.0), n_jobs=n_jobs, random_state=0)
    report = diagnoser.fit(X, y, groups=groups).report_
    report = replace(report, seconds=float("nan"), provenance=UNKNOWN_PROVENANCE)  # when it was made, and how long it took
    print(len(count) > 3 and all(count), str(report).encode(), report.shrink)
    count.clear()
"""


@needs_fork
def test_a_diagnosis_in_two_processes_gives_the_answer_of_one():
    two, one = printed(DIAGNOSIS).splitlines()
    assert two.startswith("True ") and one.startswith("False ")
    assert two.removeprefix("True ") == one.removeprefix("False ")
