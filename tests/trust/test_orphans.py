"""A killed main process leaves no helper behind, and two processes share one file."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from sksurrogate._files import append_line

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="process numbers are read from /proc")

BLOCKED = """
import os, sys, time
from sksurrogate._parallel import _worker_process
_worker_process.can_fork = lambda: True
read, write = os.pipe()
told = os.dup(1)  # what a worker prints is let go

def question():
    os.write(told, f"{os.getpid()}\\n".encode())
    os.read(read, 1)  # for good: both ends are open here, as of a simulator that never answers

second = _worker_process.WorkerProcess()
second.ask(question)
time.sleep(3600)
"""

ANSWERS_NEVER = """
import os, sys, time
sys.argv = ["solver", "os:getpid"]
from sksurrogate.blind import _solve

def serve(function, source, target):
    os.write(2, f"{os.getpid()}\\n".encode())
    time.sleep(3600)

_solve.serve = serve
_solve.main()
"""

WORKERS = """
import os, time
from sksurrogate._parallel._interrupts import delayed, workers

def blocks(told):
    with open(told, "w") as file:
        file.write(f"{os.getpid()}\\n")
    time.sleep(3600)  # as of a simulator that never answers

if __name__ == "__main__":
    workers(2)(delayed(blocks)(f"/proc/{os.getpid()}/fd/1") for _ in range(4))
"""

STARTS = """
import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=1)
time.sleep(3600)
"""


def alive(number):
    """Whether a process runs; one that has ended and was not yet read does not."""
    try:
        with open(f"/proc/{number}/stat") as stream:
            return stream.read().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [[BLOCKED], [STARTS, ANSWERS_NEVER], [WORKERS]], ids=["fork", "started", "workers of joblib"]
)
def test_a_killed_process_leaves_no_helper(command):
    main = subprocess.Popen([sys.executable, "-c", *command], stdout=subprocess.PIPE, text=True)
    with main.stdout:
        helper = int(main.stdout.readline())
    assert helper != main.pid and alive(helper)
    os.kill(main.pid, signal.SIGKILL)
    main.wait()
    until = time.monotonic() + 60
    while alive(helper) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(helper)


APPENDS = """
import sys
from sksurrogate._files import append_line
for k in range(200):
    append_line(sys.argv[1], '{"who": "%s", "k": %d, "text": "%s"}' % (sys.argv[2], k, "x" * 3000))
"""


def test_lines_of_two_processes_do_not_mix(tmp_path):
    path = tmp_path / "rows.jsonl"
    append_line(path, '{"who": "first", "k": 0, "text": ""}')
    both = [subprocess.Popen([sys.executable, "-c", APPENDS, str(path), who]) for who in "ab"]
    assert [process.wait() for process in both] == [0, 0]
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    for who in "ab":
        assert [row["k"] for row in rows if row["who"] == who] == list(range(200))
    assert len(rows) == 401
