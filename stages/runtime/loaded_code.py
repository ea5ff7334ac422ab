"""Imported last by the process that stage processes are forked from: takes down what code it has imported.

Source that is edited later is then not taken for what runs; see :func:`stages.runtime.isolation.run_isolated`.
"""

from __future__ import annotations

from juicer.artifacts.code_version import module_versions
from stages.runtime.names import STAGES

VERSIONS = {name: module_versions(f"stages.{name}") for name in STAGES}
"""Versions of the modules behind each stage; reading them here keeps them, as source is read once a process."""
