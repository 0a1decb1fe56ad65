"""Run a command so that nothing of it outlives whoever started it: ``python -m workflow.lifeline COMMAND…``

Standard input is the lifeline: a pipe that its starter holds open. The system closes it when the starter
ends, by kill -9 as well; the command and all that it started are then interrupted, and after a while killed.
The command has a session of its own, so that Ctrl-C in a terminal reaches the starter alone, and one order of
events serves every end. Kernels of notebooks have sessions of their own in turn: a notebook that is
interrupted ends its kernel, and a kernel whose notebook was killed ends itself.
"""

import os
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress

GRACE = 3.0  # s for what is interrupted to end by itself, Slurm's jobs to be cancelled among it
ORPHANED = 2.0  # s after which a kernel has ended whose parent was killed: it looks once a second
POLL = 0.2  # s between two looks at the command


def end_group(group: int, number: int) -> bool:
    """Send a signal to a process group; False if none of it is left."""
    try:
        os.killpg(group, number)
    except (ProcessLookupError, PermissionError):  # the latter on macOS, of a group that has ended
        return False
    return True


def run(command: list[str]) -> int:
    """Run the command to its end, or to that of the lifeline; returns its exit status."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # which `nohup … &` had ignored; the command inherits it
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        close_fds=False,  # what the starter has given away, its lock, is held by the command as well
    )
    while process.poll() is None and not select.select([sys.stdin], [], [], POLL)[0]:
        pass
    if process.poll() is None:
        end_group(process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(GRACE)
    if end_group(process.pid, signal.SIGKILL):
        time.sleep(ORPHANED)
    return process.wait()


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
