#!/usr/bin/env bash
# The whole replication: makes its own environment, then runs what is asked for. See ./reproduce.sh --help
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
python=${PYTHON:-python3}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || {
    echo "reproduce.sh: Python 3.11 or newer is needed: name one in the variable PYTHON" >&2
    exit 2
}
exec "$python" -B -m workflow.driver "$@"
