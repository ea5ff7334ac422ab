"""The wheel works without the repository, and takes no top-level name but its own."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an installation of the wheel puts among the site packages."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def juicer(installed: Path, cwd: Path, *arguments: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(installed), "JUICER_DATA": str(cwd / "data")}
    command = [sys.executable, "-P", "-c", "from juicer.__main__ import main; main()", *arguments]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_holds_one_package_with_all_that_the_command_needs(installed: Path):
    names = {path.name for path in installed.iterdir()}
    assert {name for name in names if not name.endswith(".dist-info")} == {"juicer"}
    bundle = installed / "juicer" / "bundle"
    for shipped in ("configs/demo.yaml", "configs/presets/laptop.yaml", "flows/command/cli.py", "stages/train.py"):
        assert (bundle / shipped).is_file(), shipped
    assert (installed / "juicer" / "reporting" / "report.html.j2").is_file()
    assert (installed / "juicer" / "pages" / "static" / "pages.css").is_file()
    assert (installed / "juicer" / "pages" / "templates" / "browsing" / "episode.html").is_file()
    assert (installed / "juicer" / "py.typed").is_file()


def test_it_plans_a_run_beside_packages_of_the_same_names(installed: Path, tmp_path: Path):
    for name in ("flows", "stages"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the package of the user was imported')\n")
    config = installed / "juicer" / "bundle" / "configs" / "smoke.yaml"
    said = juicer(installed, tmp_path, "explain", "record", "--config", str(config))
    assert "does not exist, and the stage has made no artifact before" in said


def test_users_packages_of_these_names_are_not_hidden(installed: Path, tmp_path: Path):
    (tmp_path / "flows").mkdir()
    (tmp_path / "flows" / "__init__.py").write_text("")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed), str(tmp_path)])}
    program = "import juicer, flows; print(flows.__file__)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(tmp_path / "flows" / "__init__.py")
