"""Versions of juicer's own code and of the libraries it uses."""

from __future__ import annotations

import subprocess
import sys

import pytest

import juicer.seeding
from juicer.artifacts.code_version import PLUMBING, code_version, library_versions, module_versions
from juicer.errors import ArtifactError


def test_a_module_and_its_name_have_one_version() -> None:
    assert code_version(juicer.seeding) == code_version("juicer.seeding")


def test_modules_with_different_code_have_different_versions() -> None:
    assert code_version("juicer.seeding") != code_version("juicer.geometry")


def test_the_modules_behind_a_version_are_known_by_name() -> None:
    assert set(module_versions("juicer.storage.evaluations")) == {
        "juicer.episode",
        "juicer.storage.evaluations",
        "juicer.storage.tables",
    }


def test_the_store_itself_shapes_no_result() -> None:
    assert "juicer.artifacts" in PLUMBING
    assert not any(name.startswith("juicer.artifacts") for name in module_versions("juicer.storage.episodes"))


@pytest.mark.parametrize("stage", ["record", "collect"])
def test_making_data_does_not_depend_on_how_results_are_compared(stage: str) -> None:
    modules = module_versions(f"stages.{stage}")
    assert "juicer.seed_ranges" in modules
    assert "juicer.evaluation" not in modules


def test_a_version_imports_nothing() -> None:
    program = """
import sys
from juicer.artifacts.code_version import code_version
code_version("juicer.storage.episodes")
assert "zarr" not in sys.modules and "juicer.storage" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_library_versions_are_those_installed() -> None:
    import numpy as np

    assert library_versions(["zarr", "numpy"])["numpy"] == np.__version__


def test_a_library_that_is_not_installed_is_named() -> None:
    with pytest.raises(ArtifactError, match="'no-such-library' is not installed"):
        library_versions(["no-such-library"])
