#!/usr/bin/env bash
# Make sure that MuJoCo can draw without a screen; policies that look at images need it, and videos.
# Ends with status 0 if it can, 1 (and one sentence) if it cannot. Called by `make gl`.
set -euo pipefail

VENV=${VENV:-.venv}
# What juicer draws with on Linux unless the variable says otherwise.
export MUJOCO_GL=${MUJOCO_GL:-egl}
PACKAGES="libegl1 libgl1-mesa-dri"
if [ "$MUJOCO_GL" = osmesa ]; then PACKAGES=libosmesa6; fi

can_draw() {
    "$VENV/bin/python" -c '
import mujoco
mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16).close()' >/dev/null 2>&1
}

can_draw && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "juicer set-up: installing $PACKAGES, which draw images without a screen"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086  # one argument a package
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends $PACKAGES; } >/dev/null || true
    can_draw && exit 0
fi
echo "juicer set-up: no OpenGL platform for drawing without a screen, so there can be no policies that look at images, and" \
    "no images or videos of others;" \
    "install them with: apt-get install $PACKAGES" >&2
exit 1
