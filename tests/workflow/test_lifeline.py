"""The lifeline: a command ends by itself with its status, or with its starter, and leaves nobody behind."""

import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).parents[2]
LIFELINE = [sys.executable, "-m", "workflow.lifeline", sys.executable, "-c"]
# The command's child says when it is ready; where it ignores SIGINT, nothing but SIGKILL ends it.
CHILD = """
import signal, time
signal.signal(signal.SIGINT, signal.{action})
print("ready", flush=True)
time.sleep(999)
"""
SLEEPER = """
import os, signal, subprocess, sys
process = subprocess.Popen([sys.executable, "-c", {child!r}], stdout=subprocess.PIPE)
process.stdout.readline()
print(process.pid, flush=True)
{last}
"""


def begin(program: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*LIFELINE, program], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def child_of(process: subprocess.Popen[str]) -> psutil.Process:
    """The command's child, which is ready by now."""
    assert process.stdout is not None
    return psutil.Process(int(process.stdout.readline()))


def test_a_command_ends_with_its_own_status() -> None:
    with begin("raise SystemExit(7)") as process:
        assert process.wait(60) == 7


@pytest.mark.parametrize("action", ["SIG_DFL", "SIG_IGN"])
def test_who_closes_the_lifeline_ends_all(action: str) -> None:
    with begin(SLEEPER.format(child=CHILD.format(action=action), last="process.wait()")) as process:
        child = child_of(process)
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(60) != 0
        psutil.wait_procs([child], timeout=10)
        assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE


def test_what_a_killed_command_leaves_is_ended() -> None:
    last = "os.kill(os.getpid(), signal.SIGKILL)"
    with begin(SLEEPER.format(child=CHILD.format(action="SIG_IGN"), last=last)) as process:
        child = child_of(process)
        assert process.wait(60) == -signal.SIGKILL % 256
        psutil.wait_procs([child], timeout=10)
        assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE
