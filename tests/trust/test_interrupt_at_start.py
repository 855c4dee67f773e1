"""Ctrl-C while the package is still imported, here and in workers: a sentence, no traceback, no process left."""

import os
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a signal to a group of processes, and /proc")

#: Imports a module of the package slowly, and says when.
IMPORTS = """
import runpy, sys, time

class Slow:
    def find_spec(name, path=None, target=None):
        if name == "{module}":
            print("now", flush=True)
            time.sleep(60)

sys.meta_path.insert(0, Slow)
sys.argv = ["sksurrogate", "demo"]
runpy.run_module("sksurrogate", run_name="__main__")
"""

WORKS = """
import os, signal, sys, time
from sksurrogate._parallel._interrupts import delayed, workers

def number(k):
    time.sleep(0.2 + 60 * k)
    return os.getpid() if signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []) else "hears"

if __name__ == "__main__":
    found = workers(2)(delayed(number)(0) for _ in range(8))
    try:
        print(*set(found), flush=True)
        workers(2)(delayed(number)(1) for _ in range(8))
    except KeyboardInterrupt:
        sys.exit(130)
"""


def as_in_a_terminal():
    """A process that hears Ctrl-C, whatever the one that starts it has blocked or ignores."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(code):
    """First line of a process, its status and errors after Ctrl-C, which its children get too."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    options["preexec_fn"] = as_in_a_terminal
    process = subprocess.Popen([sys.executable, "-c", code], **options)
    said = process.stdout.readline().split()
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=50)
    return said, process.returncode, errors


@pytest.mark.parametrize("module", ["sksurrogate.cli", "numpy", "sksurrogate._csv"])
def test_an_interrupt_while_the_command_is_imported_is_a_sentence(module):
    said, status, errors = interrupted(IMPORTS.format(module=module))
    assert said == ["now"] and status == 130
    assert errors == "sksurrogate: interrupted before anything was known\n"


@pytest.mark.slow
def test_an_interrupt_while_the_demo_is_imported_is_a_sentence():
    # The exit status is that of a process that an interrupt ended where it came within a class that is made of text.
    said, status, errors = interrupted(IMPORTS.format(module="sksurrogate.gap._diagnose"))
    assert said == ["now"] and status in (130, -signal.SIGINT)
    assert errors == "sksurrogate: interrupted before anything was known\n"


@pytest.mark.slow
def test_workers_say_nothing_and_end_with_an_interrupt():
    # Two workers, started without the interrupt: the process that started them ends them.
    said, status, errors = interrupted(WORKS)
    assert (status, errors) == (130, "") and len(said) == 2
    until = time.monotonic() + 30
    while (left := [number for number in said if os.path.exists(f"/proc/{number}")]) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left
