"""Python, the libraries that juicer was tested with, and the device that torch computes on."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
from collections.abc import Iterator

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from flows.doctor.program import run_program
from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.device import REMEDY, lack_of
from flows.running.settings import Settings

_TORCH = """
import json, torch
cuda = torch.version.cuda or torch.version.hip
gpus = torch.cuda.device_count() if cuda and torch.cuda.is_available() else 0
print(json.dumps({"version": torch.__version__, "cuda": cuda, "threads": torch.get_num_threads(), "gpus": gpus}))
"""
_CLASSIFIER = "Programming Language :: Python :: 3."


def check_python(settings: Settings) -> Iterator[Verdict]:
    """The interpreter against what juicer needs and what it was tested with."""
    if not _is_installed():
        yield warning("juicer is not installed here, so nobody knows what it needs", "pip install --editable .")
        return
    found = platform.python_version()
    facts = importlib.metadata.metadata("juicer")
    needed = str(facts["Requires-Python"] or ">=3.11")
    tested = [entry.rpartition(" ")[2] for entry in facts.get_all("Classifier") or [] if entry.startswith(_CLASSIFIER)]
    if not SpecifierSet(needed).contains(found, prereleases=True):
        yield problem(f"Python {found}; juicer needs {needed}", "make a virtual environment with a newer Python")
    elif tested and found.rpartition(".")[0] not in tested:
        yield warning(f"Python {found}; juicer is tested with {', '.join(tested)}", "use that if something fails")
    else:
        yield ok(f"Python {found}")


def check_libraries(settings: Settings) -> Iterator[Verdict]:
    """Every library that juicer asks for, against the range it was tested with."""
    if not _is_installed():
        return
    requirements = [Requirement(text) for text in importlib.metadata.requires("juicer") or ()]
    wanted = [each for each in requirements if each.marker is None or each.marker.evaluate({"extra": ""})]
    fine = 0
    for requirement in wanted:
        remedy = f"pip install '{requirement.name}{requirement.specifier}'"
        try:
            version = importlib.metadata.version(requirement.name)
        except importlib.metadata.PackageNotFoundError:
            yield problem(f"{requirement.name} is not installed", remedy)
            continue
        if requirement.specifier.contains(version, prereleases=True):
            fine += 1
        else:
            yield problem(f"{requirement.name} is {version}, tested with {requirement.specifier}", remedy)
    if fine == len(wanted):
        yield ok(f"all {fine} libraries are of tested versions")


def _is_installed() -> bool:
    try:
        importlib.metadata.distribution("juicer")
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def check_torch(settings: Settings) -> Iterator[Verdict]:
    """Which torch this is, and whether it has the device of the settings."""
    facts = json.loads(run_program(_TORCH))
    build = f"for CUDA or ROCm {facts['cuda']}" if facts["cuda"] else "for processors"
    threads = f"{facts['threads']} thread{'s' if facts['threads'] != 1 else ''}"
    found = f"torch {facts['version']} {build}, {threads}, {facts['gpus']} GPUs; JUICER_DEVICE is {settings.device}"
    if lack := lack_of(settings.devices, facts["gpus"], facts["cuda"]):
        yield problem(lack, REMEDY)
    elif facts["gpus"] and settings.device == "cpu":
        yield warning(found, "set JUICER_DEVICE=cuda to train on the GPU")
    elif settings.workers > 1 and facts["threads"] > 1 and "OMP_NUM_THREADS" in os.environ:
        yield warning(found, "OMP_NUM_THREADS=1 lets stages that run side by side not slow each other down")
    else:
        yield ok(found)
