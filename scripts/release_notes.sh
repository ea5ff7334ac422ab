#!/usr/bin/env bash
# Print what CHANGELOG.md says of the version given, without its heading.
set -euo pipefail

version=${1:?the version, as in 0.2.0}
notes=$(awk -v heading="## $version (" '/^## /{ours = index($0, heading) == 1; next} ours' "$(dirname "$0")/../CHANGELOG.md")
if [ -z "$notes" ]; then
    echo "CHANGELOG.md has no section '## $version (DATE)'; see docs/releasing.md." >&2
    exit 1
fi
echo "$notes"
