"""Configurations and presets that come with juicer, by name."""

from __future__ import annotations

from pathlib import Path

from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable

CONFIGS = Path(__file__).absolute().parents[1] / "configs"
PRESETS = CONFIGS / "presets"
SUFFIXES = (".yaml", ".yml")


def names(folder: Path) -> list[str]:
    """Names of the configurations in one of the folders above, in order."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def is_name(text: str) -> bool:
    """Whether a text names something that comes with juicer; with a slash or the ending ``.yaml`` it is a path."""
    return "/" not in text and not text.startswith("~") and not text.endswith(SUFFIXES)


def shipped_path(text: str) -> Path | None:
    """File that comes with juicer and has this path in the folder of configurations, e.g. ``presets/laptop.yaml``."""
    files = [*CONFIGS.glob("*.yaml"), *PRESETS.glob("*.yaml")]
    return next((path for path in files if str(path.relative_to(CONFIGS)) == text), None)


def find_configuration(name: str) -> Path:
    """File of a configuration, or of a preset, which is one too.

    Raises:
        ConfigError: If nothing has that name.
    """
    return _find(name, (CONFIGS, PRESETS), "configuration")


def find_preset(name: str) -> Path:
    """File of a preset, or of a configuration, to start from.

    Raises:
        ConfigError: If nothing has that name.
    """
    return _find(name, (PRESETS, CONFIGS), "preset")


def _find(name: str, folders: tuple[Path, ...], kind: str) -> Path:
    for folder in folders:
        if name in names(folder):
            return folder / f"{name}.yaml"
    remedy = did_you_mean(name, names(folders[0]))
    raise ConfigError(
        f"no {kind} that comes with juicer is called '{printable(name)}'{remedy.rstrip('?')}; "
        "a file of your own is named by its path, as in ./mine.yaml"
    )
