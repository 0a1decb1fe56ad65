"""Running the whole replication: the Snakefile, its rules, and the driver behind ``reproduce.sh``."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
