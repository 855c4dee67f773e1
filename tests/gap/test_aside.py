"""A second process answers as this one would, and its silence costs nothing but time."""

import os
import subprocess
import sys
import threading
import time

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from sksurrogate.gap._aside import Aside, can_fork, one_thread, side_by_side

#: In a process of its own: test runners have threads, beside which no second process is made.
forks = "import os\nfrom sksurrogate.gap._aside import Aside, can_fork, side_by_side\nassert can_fork()\n"
needs_fork = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="a second process needs a fork and a second core",
)


def told(script):
    """What a script prints."""
    done = subprocess.run([sys.executable, "-c", forks + script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@needs_fork
def test_the_question_is_answered_in_another_process_and_the_answer_comes_back():
    assert told(
        "a = Aside(os.getpid); print(a.answer() == os.getpid(), Aside(os.getpid, False).answer() == os.getpid())"
    ) == ("False True")
    assert (
        told("print([Aside(lambda: os.nice(0), later=later).answer() - os.nice(0) for later in (False, True)])")
        == "[0, 10]"
    )
    arrays = "[np.arange(7.0), np.zeros((2, 0)), np.arange(12).reshape(3, 4).T, 'end']"
    changed = "a[0][:] = 1.0\nprint(a[0].sum(), a[1].shape, a[2][3, 2], a[3])"  # what comes back can be written to
    assert told(f"import numpy as np\na = Aside(lambda: {arrays}).answer()\n{changed}") == "7.0 (2, 0) 11 end"
    slow = "def slow(k):\n    time.sleep(0.3)\n    return k, os.getpid() == here\n"
    found = "found = side_by_side(slow, list(range(6)), True)\n"
    script = "import time\nhere = os.getpid()\n" + slow + found
    assert told(script + "print([k for k, _ in found], found[0][1], found[5][1])") == "[0, 1, 2, 3, 4, 5] True False"
    script = script.replace("True)", "True, lambda k: k in (2, 3))")  # the long ones stand at the ends
    assert told(script + "print([k for k, _ in found], found[2][1], found[3][1])") == "[0, 1, 2, 3, 4, 5] True False"


@needs_fork
@pytest.mark.parametrize(
    "question",
    ["lambda: 1 if os.getpid() == here else os.kill(os.getpid(), 9)", "lambda: 1 if os.getpid() == here else 1 / 0",
     "lambda: 1 if os.getpid() == here else (lambda: 0)"],
    ids=["killed", "raised", "not to be sent"],
)  # fmt: skip
def test_without_an_answer_the_question_is_answered_here(question):
    assert told(f"here = os.getpid()\nprint(Aside({question}).answer())") == "1"


@needs_fork
def test_an_error_is_raised_where_the_answer_is_wanted_and_a_warning_is_heard_there():
    script = (
        "import warnings\nwith warnings.catch_warnings(record=True) as heard:\n    warnings.simplefilter('always')\n"
    )
    assert told(
        script + "    Aside(lambda: warnings.warn('careful')).answer()\nprint(len(heard), heard[0].message)"
    ) == ("1 careful")
    assert "ZeroDivisionError" in told(
        "a = Aside(lambda: 1 / 0)\ntry:\n    a.answer()\nexcept ZeroDivisionError as e:\n    print(repr(e))"
    )


@needs_fork
def test_where_no_process_may_be_made_the_question_is_answered_here():
    script = "def refused(*given): raise BlockingIOError('no more processes')\nos.fork = refused\n"
    assert told(script + "print(Aside(os.getpid).answer() == os.getpid())") == "True"


@needs_fork
def test_a_process_whose_answer_is_not_wanted_any_more_is_ended():
    script = "import multiprocessing, time\na = Aside(lambda: time.sleep(60))\ndel a\nbegun = time.monotonic()\n"
    waited = "while multiprocessing.active_children() and time.monotonic() - begun < 30:\n    time.sleep(0.05)\n"
    assert told(script + waited + "print('gone' if not multiprocessing.active_children() else 'there')") == "gone"


@needs_fork
def test_items_of_a_process_that_died_are_asked_here():
    script = "import time\nhere = os.getpid()\ndef asked(k):\n    time.sleep(0.05)\n"
    script += "    if k == 3 and os.getpid() != here:\n        os.kill(os.getpid(), 9)\n    return k\n"
    assert told(script + "print(side_by_side(asked, list(range(8)), True))") == "[0, 1, 2, 3, 4, 5, 6, 7]"


@needs_fork
def test_one_that_does_not_answer_in_time_is_not_waited_for():
    script = "import time\nfrom sksurrogate.gap import _aside\n_aside.PATIENCE = 0.2\n_aside.TIMES = 0.0\nhere = os.getpid()\n"
    question = "lambda: 1 if os.getpid() == here else time.sleep(60)"
    begun = time.monotonic()
    assert told(script + f"print(Aside({question}).answer())") == "1"
    assert time.monotonic() - begun < 50


def test_beside_other_threads_all_is_answered_here():
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    try:
        assert not can_fork()
        assert Aside(os.getpid).answer() == os.getpid()
    finally:
        stop.set()
        other.join()


def test_here_every_item_is_asked_once_and_stays_in_its_place():
    asked = []
    assert side_by_side(lambda k: asked.append(k) or k**2, range(5), apart=False) == [0, 1, 4, 9, 16]
    assert sorted(asked) == list(range(5))
    assert side_by_side(lambda k: k, [], apart=True) == []


def test_linear_algebra_keeps_to_one_thread_and_has_its_own_back_afterwards():
    def threads():
        return [row["num_threads"] for row in threadpool_info() if row["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        with one_thread():
            assert set(threads()) == {1}
        assert set(threads()) == {2}


DIAGNOSIS = """
import warnings
import sksurrogate.gap._aside as aside
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
count = []
fork = aside.Aside._fork
def counted(self):
    count.append(1)
    fork(self)
aside.Aside._fork = counted
X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
for n_jobs in (None, 1):
    diagnoser = GapDiagnoser(make_reactor(second=80.0), n_jobs=n_jobs, random_state=0)
    report = diagnoser.fit(X, y, groups=groups).report_
    print(len(count) > 0, str(report).encode(), report.shrink)
    count.clear()
"""


@needs_fork
def test_a_diagnosis_in_two_processes_gives_the_answer_of_one():
    two, one = told(DIAGNOSIS).splitlines()
    assert two.startswith("True ") and one.startswith("False ")
    assert two.removeprefix("True ") == one.removeprefix("False ")
