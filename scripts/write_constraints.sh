#!/usr/bin/env bash
# Write the versions that are installed in $VENV to constraints.txt. Called by `make lock`.
set -euo pipefail

VENV=${VENV:-.venv}

# "+cpu" and its like name a build. Which one it is, the package index decides; the constraint is the release.
installed=$("$VENV/bin/python" -m pip --disable-pip-version-check freeze --exclude-editable | sed 's/+[^+]*$//')

cat >constraints.txt <<END
# The versions that juicer was tested with. \`make setup\` and docker/Dockerfile install these; \`make lock\` renews them.
# What a build of torch for GPUs needs besides is fixed by that build.
$installed
END
