"""Imported last by the process that stage processes are forked from: takes down what code it has imported.

Source that is edited later is then not taken for what runs; see :func:`stages.runtime.isolation.run_isolated`.
"""

from __future__ import annotations

import importlib

from juicer.artifacts.code_version import junction_modules, module_versions
from stages.runtime.names import STAGES

PLUGINS = junction_modules()
for _name in PLUGINS:
    importlib.import_module(_name)
# Source is read once a process: reading it here, behind each stage and every plug-in of ours, keeps it as it is now.
for _name in STAGES:
    module_versions(f"stages.{_name}", PLUGINS)
