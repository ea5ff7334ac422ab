"""``juicer view``: an episode in Rerun, a viewer with time lines, plots and a scene in three dimensions."""

from __future__ import annotations

import os
import subprocess
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from flows.command.chosen import check_place, choose, episode_number
from flows.running.context import open_run
from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from flows.servers.addresses import LOOPBACK, listen_on, port_of
from flows.terminal.output import say, say_json
from juicer.errors import ServiceUnavailable

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


def view_episode(text: str, episode_name: str, output: Path | None, opens: bool, as_json: bool) -> None:
    """``juicer view``.

    Raises:
        ConfigError: If Rerun is not installed, there is no such episode, or the recording cannot be written.
        StateMissing: If the episode has no simulator states.
    """
    from juicer.imaging.rerun_recording import SUFFIX, require_rerun, write_recording

    require_rerun()
    settings = read_settings()
    store = open_store(settings)
    ref = store.resolve(text)
    index = episode_number(store, ref, episode_name)
    path = output or Path(f"{ref.id}-{index}{SUFFIX}")
    check_place(path, "recording", (SUFFIX,))
    with open_run(settings, None) as run_context:
        chosen = choose(store, ref, index, run_context.board, settings.devices[0])
    frames = write_recording(chosen.episode, path, chosen.name)
    if as_json:
        say_json({"recording": str(path), "frames": frames})
    else:
        say(f"{path}: {len(chosen.episode)} steps, {frames} with images")
    if opens:
        _open(path, as_json)


def _open(path: Path, as_json: bool) -> None:
    """Show a recording until the window is closed, or where there is no screen serve it until Ctrl-C."""
    from juicer.imaging.rerun_recording import viewer

    # Rerun listens on every address of the machine unless it is told otherwise.
    program = [str(viewer()), str(path), "--bind", LOOPBACK]
    with listen_on(LOOPBACK, 0) as first, listen_on(LOOPBACK, 0) as second:
        data, pages = port_of(first), port_of(second)
    program += ["--port", str(data)]
    if not any(os.environ.get(name) for name in SCREENS):
        program += ["--serve-web", "--web-viewer-port", str(pages)]
        if not as_json:
            source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
            say(f"open http://{LOOPBACK}:{pages}?url={source} in a browser of this machine; Ctrl-C ends it")
    with suppress(KeyboardInterrupt), subprocess.Popen(program, env={"RUST_LOG": "error", **os.environ}) as process:
        try:
            status = process.wait()
        finally:
            process.terminate()
        if status:
            raise ServiceUnavailable(
                f"Rerun ended with status {status}; '{path}' is written, open it with another viewer"
            )
