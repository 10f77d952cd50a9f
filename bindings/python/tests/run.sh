#!/bin/sh
# Runs the tests of the package. Arguments go to pytest. OUTCROP_LIBRARY: the shared library. OUTCROP_INCLUDE: the folder
# of outcrop.h, or the repository's.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
python=$(sh "$here/venv.sh")
cd "$here/.."
if ! "$python" -c 'import numpy, pytest'; then
    echo "run.sh: skipped: numpy or pytest is missing" >&2
    [ -z "${CI:-}" ] || [ -n "${OUTCROP_ALLOW_MISSING_PACKAGES:-}" ]
    exit
fi
PYTHONPATH=. PYTHONDONTWRITEBYTECODE=1 exec "$python" -m pytest "$@"
