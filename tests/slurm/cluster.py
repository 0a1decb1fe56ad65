"""A Slurm of one node on loopback, in a folder of its own; nothing of the machine's configuration is touched.

Needs Debian's packages: ``apt-get install --no-install-recommends slurm-wlm munge``. As a script it runs a
command in that cluster: ``python tests/slurm/cluster.py ./reproduce.sh --slurm --quick``.
"""

import getpass
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "sinfo", "scontrol")
CONFIGURATION = """
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
SlurmdTimeout={lost_after}
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory={memory} State=UNKNOWN
PartitionName=only Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
LOST_AFTER = 10  # s without an answer after which the controller gives a node up
PATIENCE = 180.0  # s for a daemon to answer, and for a queued job to start again after it lost its node


def missing() -> list[str]:
    """The programs of Slurm that this machine lacks."""
    return [name for name in PROGRAMS if shutil.which(name) is None]


def _free_ports(number: int) -> list[int]:
    sockets = [socket.socket() for _ in range(number)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


def _until(done: Callable[[], bool], what: str) -> None:
    """Wait for a condition; raises TimeoutError that names it."""
    end = time.monotonic() + PATIENCE
    while not done():
        if time.monotonic() > end:
            raise TimeoutError(f"{what} after {PATIENCE:g} s")
        time.sleep(0.2)


class Cluster:
    """Daemons of one user on free ports; as a context, started and ended.

    Attributes:
        environment: of processes that are to see this cluster.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        paths = {"SLURM_CONF": f"{folder}/slurm.conf", "PATH": f"{folder}:{os.environ['PATH']}"}
        self.environment = os.environ | paths
        self.processes: dict[str, psutil.Popen] = {}

    def __enter__(self) -> Self:
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        key = self.folder / "munge.key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(128))
        host, ports = socket.gethostname().partition(".")[0], _free_ports(2)
        text = CONFIGURATION.format(
            host=host,
            user=getpass.getuser(),
            folder=self.folder,
            controller_port=ports[0],
            node_port=ports[1],
            memory=psutil.virtual_memory().total // 2**21,  # half of it, in MB
            lost_after=LOST_AFTER,
        )
        (self.folder / "slurm.conf").write_text(text)
        srun = self.folder / "srun"  # the workflow's jobs start without the variables that begin with SLURM
        srun.write_text(f'#!/bin/sh\nSLURM_CONF={self.folder}/slurm.conf exec {shutil.which("srun")} "$@"\n')
        srun.chmod(0o755)
        files = {name: self.folder / f"munge.{name}" for name in ("socket", "key", "log", "pid", "seed")}
        options = [
            f"--{option}={files[option.partition('-')[0]]}"
            for option in ("socket", "key-file", "log-file", "pid-file", "seed-file")
        ]
        self._start("munged", "--foreground", "--force", *options)
        _until(files["socket"].exists, "no munged")
        self._start("slurmctld", "-D")
        self.bring_node()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._kill_node()
        for process in reversed(self.processes.values()):
            process.terminate()
            process.wait(PATIENCE)

    def _start(self, name: str, *options: str) -> None:
        with (self.folder / f"{name}.out").open("a") as log:
            self.processes[name] = psutil.Popen(
                [name, *options], env=self.environment, stdout=log, stderr=log
            )

    def ask(self, *command: str) -> str:
        """What a client of Slurm prints; empty if it fails."""
        return subprocess.run(command, env=self.environment, capture_output=True, text=True).stdout.strip()

    def bring_node(self) -> None:
        """Start slurmd and wait until the node takes jobs."""
        self._start("slurmd", "-D")
        _until(lambda: self.ask("sinfo", "-h", "-o", "%T") in ("idle", "mixed", "allocated"), "no node")

    def until_running(self, job: str) -> None:
        """Wait until a job runs."""
        _until(
            lambda: self.ask("squeue", "-h", "-j", job, "-o", "%T") == "RUNNING", f"job {job} does not run"
        )

    def lose_node(self) -> None:
        """Kill all that runs on the node, and wait until the controller has given it up."""
        self._kill_node()
        _until(lambda: self.ask("sinfo", "-h", "-o", "%T").startswith("down"), "the lost node is not down")

    def _kill_node(self) -> None:
        """Kill slurmd, the steps that it started and all that runs in them."""
        steps = [p for p in psutil.process_iter(["name"]) if p.info["name"] == "slurmstepd" and self._owns(p)]
        daemons = [self.processes.pop("slurmd")] if "slurmd" in self.processes else []
        lost = [*daemons, *steps]
        lost += [child for step in steps for child in step.children(recursive=True)]
        for process in lost:
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue
        psutil.wait_procs(lost, timeout=PATIENCE)

    def _owns(self, process: psutil.Process) -> bool:
        """Whether a process is of this cluster, not of another on the machine."""
        try:
            variables = Path(f"/proc/{process.pid}/environ").read_bytes()
        except OSError:  # it has ended
            return False
        return f"SLURM_CONF={self.folder}/slurm.conf".encode() in variables.split(b"\0")


def main() -> int:
    """Run a command in a cluster; returns its exit status."""
    if len(sys.argv) < 2 or missing():
        sys.exit(f"usage: cluster.py COMMAND…; missing programs: {', '.join(missing()) or 'none'}")
    with tempfile.TemporaryDirectory(prefix="slurm-") as folder, Cluster(Path(folder)) as cluster:
        return subprocess.run(sys.argv[1:], env=cluster.environment).returncode


if __name__ == "__main__":
    sys.exit(main())
