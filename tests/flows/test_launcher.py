"""The command runs its own code and ends in order, whatever surrounds it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from flows.servers.proxies import bypass_proxies_on_loopback
from juicer.artifacts.store import ArtifactStore

ROOT = Path(__file__).parents[2]
SMOKE = ROOT / "configs" / "smoke.yaml"
NOWHERE = "127.0.0.1:9"
SCRIPT = "from juicer.__main__ import main\nif __name__ == '__main__':\n    main()\n"
"""What the installed command consists of."""


def juicer(*arguments: str, cwd: Path, shell: str = 'exec "$@"', **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JUICER_DATA": str(cwd / "data"), **variables}
    script = cwd / "bin" / "juicer"
    script.parent.mkdir(exist_ok=True)
    script.write_text(SCRIPT)
    command = ["sh", "-c", shell, "sh", sys.executable, str(script), *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=250, check=False)


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A working folder with packages of our names, and of libraries' names, all of which would break a run."""
    folder = tmp_path / "hostile"
    for package in ("flows", "stages", "juicer"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    stage = folder / "stages" / "record.py"
    stage.write_text(stage.read_text().replace('"device": DEVICE,', '"device": "another checkout",'))
    for name in ("prefect", "mlflow", "torch", "numpy", "uvicorn"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("raise RuntimeError('the folder of the user was imported')\n")
    (folder / "types.py").write_text("raise RuntimeError('the file of the user was imported')\n")
    # Prefect reads settings from the working directory, too.
    (folder / "prefect.toml").write_text("[results]\npersist_by_default = true\n[server.api]\nport = 1\n")
    (folder / ".env").write_text(f"PREFECT_API_URL=http://{NOWHERE}/api\n")
    return folder


def test_a_run_uses_its_own_code_and_servers_wherever_it_is_started(hostile: Path):
    long = hostile / ("t" * 120)
    long.mkdir()
    surroundings = {
        "TMPDIR": str(long),
        "HTTP_PROXY": f"http://{NOWHERE}",
        "http_proxy": f"http://{NOWHERE}",
        "HTTPS_PROXY": f"http://{NOWHERE}",
        "ALL_PROXY": f"socks5://{NOWHERE}",
        "all_proxy": f"socks5://{NOWHERE}",
    }
    arguments = ("stage", "record", "-c", str(SMOKE), "--set", "record.demonstrations=1")
    done = juicer(*arguments, cwd=hostile, shell='exec "$@" <&- >&-', **surroundings)
    assert done.returncode == 0, done.stderr
    (manifest,) = ArtifactStore(hostile / "data").list("logs")
    assert manifest.summary["device"] != "another checkout"
    assert not list(long.iterdir())


def test_our_packages_come_before_those_that_the_search_path_names(hostile: Path):
    # An empty entry, as in PYTHONPATH=$PYTHONPATH:/somewhere, is the working directory.
    for folder in ("types.py", "prefect", "mlflow", "torch", "numpy", "uvicorn", "juicer"):
        path = hostile / folder
        path.unlink() if path.is_file() else shutil.rmtree(path)
    done = juicer("ls", cwd=hostile, PYTHONPATH=f":{ROOT}")
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"no artifacts in {hostile / 'data'}\n")


def test_a_package_that_stands_before_ours_is_named(tmp_path: Path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "flows.py").write_text("")
    (tmp_path / "site" / "sitecustomize.py").write_text("import flows\n")
    done = juicer("ls", cwd=tmp_path, PYTHONPATH=f"{tmp_path / 'site'}{os.pathsep}{ROOT}")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("juicer: its package 'flows' should be in")
    assert f"'{tmp_path / 'site'}' is found in its place" in line


def test_closed_standard_streams_are_not_taken_by_files(tmp_path: Path):
    done = juicer("ls", "--json", cwd=tmp_path, shell='exec "$@" <&- 2>&-')
    assert (done.returncode, json.loads(done.stdout)) == (0, [])
    assert juicer("ls", cwd=tmp_path, shell='exec "$@" <&- >&- 2>&-').returncode == 0


@pytest.mark.parametrize("arguments", [("ls",), ("ls", "--json"), ("--help",)])
def test_output_that_nobody_takes_is_told(tmp_path: Path, arguments: tuple[str, ...]):
    done = juicer(*arguments, cwd=tmp_path, shell='exec "$@" > /dev/full')
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "juicer: standard output takes no more (No space left on device); the command is done"
    ]


def test_errors_that_nobody_reads_keep_their_status(tmp_path: Path):
    assert juicer("show", "0123", cwd=tmp_path, shell='exec "$@" 2> /dev/full').returncode == 1
    assert juicer("ls", "--bad", cwd=tmp_path, shell='exec "$@" 2> /dev/full').returncode == 2


def test_a_reader_that_has_seen_enough_is_no_failure(tmp_path: Path):
    done = juicer("--help", cwd=tmp_path, shell='{ "$@"; echo "status $?" >&2; } | head -n 1')
    assert done.stderr == "status 0\n"


def test_a_terminal_that_lacks_our_signs_shows_others(tmp_path: Path):
    assert juicer("--help", cwd=tmp_path, PYTHONIOENCODING="ascii").returncode == 0


def test_a_working_folder_that_is_gone_is_told(tmp_path: Path):
    done = juicer("ls", cwd=tmp_path, shell='mkdir gone && cd gone && rmdir ../gone && exec "$@"')
    assert done.returncode == 1
    assert done.stderr == "juicer: the working directory no longer exists; change to one that does\n"


@pytest.mark.parametrize("excepted", ["", "example.org, .internal", "127.0.0.1", "*"])
def test_loopback_is_reached_without_a_proxy(excepted: str, monkeypatch: pytest.MonkeyPatch):
    proxies = {"HTTP_PROXY": f"http://{NOWHERE}", "ALL_PROXY": f"socks5://{NOWHERE}", "NO_PROXY": excepted}
    for name, value in proxies.items():
        monkeypatch.setenv(name, value)
    bypass_proxies_on_loopback()
    with httpx.Client() as client:
        for url in ("http://127.0.0.1:4200", "http://localhost:4200", "http://[::1]:4200"):
            assert client._transport_for_url(httpx.URL(url)) is client._transport
        through = client._transport_for_url(httpx.URL("http://prefect.example.com")) is not client._transport
    assert through == (excepted != "*")
    assert set(excepted.replace(" ", "").split(",")) - {""} <= set(os.environ["no_proxy"].split(","))
