"""Snakemake on this machine, without its timers: ``python -m workflow.scheduler OPTIONS…``

Its command line always sets a limit of jobs per time, and with one it looks for jobs to start again a second
after every look. The end of each job begins such a chain: after n jobs it looks n times a second, at the
inputs of all jobs that wait. Here as many jobs run as there are cores, so that only the end of a job makes
room for another, and at that end it looks anyway.
"""

import sys

from snakemake.cli import main  # type: ignore[import-untyped]
from snakemake.scheduling.job_scheduler import JobScheduler  # type: ignore[import-untyped]


def look_at_ends_alone() -> None:
    """Take the timers from Snakemake's scheduler, in this process."""
    if not hasattr(JobScheduler, "_schedule_reevalutation"):
        raise RuntimeError("Snakemake has no timers any more: run it by itself")
    JobScheduler._schedule_reevalutation = lambda self, delay: None


if __name__ == "__main__":
    look_at_ends_alone()
    sys.exit(main())
