#!/usr/bin/env bash
# The tests on a real Slurm: ./reproduce.sh test, first, makes .venv; then tests/slurm/run.sh [PYTEST OPTIONS].
# Debian's packages are installed where they are missing (as root; a few MB). The plugin goes to an environment on
# top of .venv: in .venv it would ask the Slurm controller at every start of the workflow.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
if ! type munged slurmctld slurmd &> /dev/null; then
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -qq --no-install-recommends slurm-wlm munge
fi
packages() { "$1/bin/python" -c "import sysconfig; print(sysconfig.get_path('purelib'))"; }
if [ ! -x .venv-slurm/bin/python ]; then
    .venv/bin/python -m venv --without-pip .venv-slurm
    packages .venv > "$(packages .venv-slurm)/venv.pth"
fi
.venv/bin/python -m pip --python .venv-slurm/bin/python install --quiet --no-deps -r requirements-slurm.txt
exec .venv-slurm/bin/python -m pytest tests/slurm -m 'slurm or not slurm' "$@"
