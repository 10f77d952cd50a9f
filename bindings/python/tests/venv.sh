#!/bin/sh
# Makes build/python/venv with the packages of requirements.txt, and prints the path of its Python. Without an index, the
# packages of the system remain: tests that need others are then skipped, or fail under CI.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
venv=$(cd "$here/../../.." && pwd)/build/python/venv
stamp=$venv/requirements.txt

if ! cmp -s "$here/requirements.txt" "$stamp"; then
    [ -x "$venv/bin/python" ] || python3 -m venv --system-site-packages "$venv" >&2
    if "$venv/bin/python" -m pip install -q --disable-pip-version-check --timeout 20 --retries 1 -r "$here/requirements.txt" >&2; then
        cp "$here/requirements.txt" "$stamp"
    else
        echo "venv.sh: pip cannot install tests/requirements.txt; tests that need its packages are skipped" >&2
    fi
fi
echo "$venv/bin/python"
