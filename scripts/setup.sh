#!/usr/bin/env bash
# Make the virtual environment $VENV and install juicer into it, with the versions of constraints.txt.
# Called by `make setup`.
set -euo pipefail

VENV=${VENV:-.venv}
TORCH_INDEX=${TORCH_INDEX:-}

fail() {
    echo "juicer set-up: $1" >&2
    exit 1
}

suitable() {
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1
}

find_python() {
    if [ -n "${PYTHON:-}" ]; then
        suitable "$PYTHON" || fail "PYTHON=$PYTHON is no Python 3.11 or newer; name one that is."
        echo "$PYTHON"
        return
    fi
    # 3.11 first: it is the version juicer is tested with.
    for candidate in python3.11 python3.12 python3.13 python3; do
        if suitable "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    fail "Python 3.11 or newer is missing; on Debian 12, Ubuntu 24.04 or later: apt-get install python3 python3-venv; \
elsewhere name one with PYTHON=."
}

# One that was interrupted while it was made may have Python and lack pip.
if ! "$VENV/bin/python" -m pip --version >/dev/null 2>&1; then
    python=$(find_python)
    was_there=$([ -e "$VENV" ] && echo yes || true)
    echo "juicer set-up: creating $VENV with $("$python" --version)"
    if ! "$python" -m venv "$VENV"; then
        [ -n "$was_there" ] || rm -rf "$VENV"
        fail "$python cannot create a virtual environment; on Debian or Ubuntu: apt-get install python3-venv."
    fi
fi
suitable "$VENV/bin/python" || fail "$VENV holds a Python older than 3.11; remove it and start again."

pip=("$VENV/bin/python" -m pip --disable-pip-version-check --no-input)
progress=on
[ -t 1 ] || progress=off

# torch comes first and alone, because it is large: its download is shown. An environment that has it keeps its build.
torch=$(grep '^torch==' constraints.txt)
if [[ $("${pip[@]}" freeze) != *"$torch"* ]]; then
    echo "juicer set-up: installing $torch"
    "${pip[@]}" install --no-compile --progress-bar="$progress" --constraint constraints.txt \
        ${TORCH_INDEX:+--extra-index-url "$TORCH_INDEX"} torch ||
        fail "$torch cannot be installed; see 'Which build of torch' in README.md."
fi
echo "juicer set-up: installing juicer and what it needs (some minutes, about 2 GB)"
"${pip[@]}" install --no-compile --quiet --constraint constraints.txt --editable ".[dev]" ||
    fail "the dependencies cannot be installed; pip's message is above."
# pip would compile one file after the other. Some libraries bring files that are not meant to compile.
"$VENV/bin/python" -m compileall -qq -j 0 "$VENV"/lib/python3.*/site-packages || true
