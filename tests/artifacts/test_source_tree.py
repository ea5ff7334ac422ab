"""Fingerprints of source: what runs counts, what is said about it does not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from juicer.artifacts.source_tree import SourceTree
from juicer.errors import ArtifactError

ENTRY = '''
"""The stage."""
from __future__ import annotations
from typing import TYPE_CHECKING
import math
from pkg.middle import transform

if TYPE_CHECKING:
    from pkg.typing_only import Shape


def stage(x: Shape) -> float:
    """Run."""
    from pkg.late import late
    return late(transform(x))
'''
FILES = {
    "__init__.py": '"""The package."""\n__version__ = "1"\n',
    "entry.py": ENTRY,
    "middle.py": "from . import constants\nfrom .sub import leaf\n\n\ndef transform(x):\n    return constants.SCALE\n",
    "constants.py": "SCALE = 2.0\n",
    "late.py": "def late(x):\n    return x\n",
    "typing_only.py": "Shape = int\n",
    "unrelated.py": "X = 1\n",
    "sub/__init__.py": '"""Package."""\n',
    "sub/leaf.py": "from ..late import late\nimport pkg.sub.other as other\n",
    "sub/other.py": "ASSETS = ('*.xml', 'data/table.csv')\n",
    "sub/robot.xml": "<robot/>",
    "sub/data/table.csv": "1,2\n",
    "plumbing/__init__.py": "",
    "plumbing/pipe.py": "from pkg import unrelated\n",
}
REACHED = {
    "pkg.entry",
    "pkg.middle",
    "pkg.constants",
    "pkg.late",
    "pkg.sub.leaf",
    "pkg.sub.other",
}


def versions(folder: Path, changes: Mapping[str, str] | None = None, plumbing: tuple[str, ...] = ()) -> dict[str, str]:
    """Fingerprints after writing the package anew, with some files changed."""
    for name, content in {**FILES, **(changes or {})}.items():
        path = folder / "pkg" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return SourceTree({"pkg": folder / "pkg"}, plumbing).versions("pkg.entry")


def test_imports_are_followed_wherever_they_stand_but_not_for_type_checking(tmp_path: Path) -> None:
    assert set(versions(tmp_path)) == REACHED


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("entry.py", ENTRY.replace('"""The stage."""', '"""Other words,\nand more of them."""')),
        ("entry.py", ENTRY.replace('    """Run."""\n', "")),
        ("entry.py", ENTRY.replace("import math", "import math  # for its sine")),
        ("entry.py", ENTRY.replace("return late(transform(x))", "return late(\n        transform(x),\n    )")),
        ("entry.py", ENTRY.replace("pkg.typing_only import Shape", "pkg.unrelated import X")),
        ("constants.py", '# Why two.\nSCALE = 2.0\n"""Factor."""\n'),
        ("sub/__init__.py", ""),
        ("unrelated.py", "X = 2\n"),
        ("typing_only.py", "Shape = float\n"),
        ("__init__.py", '__version__ = "2"\n'),
    ],
)
def test_words_layout_and_other_modules_do_not_count(tmp_path: Path, name: str, content: str) -> None:
    before = versions(tmp_path)
    assert versions(tmp_path, {name: content}) == before


@pytest.mark.parametrize(
    ("name", "content", "changed"),
    [
        ("entry.py", ENTRY.replace("return late", "return -late"), "pkg.entry"),
        ("constants.py", "SCALE = 3.0\n", "pkg.constants"),
        ("constants.py", "SCALE = 2\n", "pkg.constants"),
        ("late.py", "def late(x=1):\n    return x\n", "pkg.late"),
        ("late.py", "def late(x):\n    return 'x'\n", "pkg.late"),
        ("sub/leaf.py", "from ..late import late\nimport pkg.sub.other as another\n", "pkg.sub.leaf"),
        ("sub/robot.xml", "<robot name='x'/>", "pkg.sub.other"),
        ("sub/data/table.csv", "1,3\n", "pkg.sub.other"),
        ("sub/second.xml", "<robot/>", "pkg.sub.other"),
    ],
)
def test_what_runs_counts_at_any_distance(tmp_path: Path, name: str, content: str, changed: str) -> None:
    before = versions(tmp_path)
    after = versions(tmp_path, {name: content})
    assert {module for module in REACHED if before[module] != after[module]} == {changed}


def test_a_new_import_brings_its_module_in(tmp_path: Path) -> None:
    after = versions(tmp_path, {"late.py": "import pkg.unrelated\n\n\ndef late(x):\n    return x\n"})
    assert set(after) == REACHED | {"pkg.unrelated"}


def test_plumbing_is_not_followed(tmp_path: Path) -> None:
    changes = {"late.py": "import pkg.plumbing.pipe\n"}
    assert "pkg.unrelated" in versions(tmp_path, changes)
    assert set(versions(tmp_path, changes, plumbing=("pkg.plumbing",))) == REACHED


def test_the_same_parts_in_another_place_are_another_program(tmp_path: Path) -> None:
    programs = [
        "x[:1]\n",
        "x[1:]\n",
        "x[::1]\n",
        "f(a, *b)\n",
        "f(a, b)\n",
        "f(*a, b)\n",
        "if x:\n    y\nz\n",
        "if x:\n    y\n    z\n",
    ]
    assert len({versions(tmp_path, {"late.py": program})["pkg.late"] for program in programs}) == len(programs)


def test_source_is_read_once(tmp_path: Path) -> None:
    versions(tmp_path)
    tree = SourceTree({"pkg": tmp_path / "pkg"})
    before = tree.versions("pkg.entry")
    (tmp_path / "pkg" / "late.py").write_text("changed = 1\n")
    assert tree.versions("pkg.entry") == before


def test_a_module_without_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"'pkg\.nothing' has no source"):
        SourceTree({"pkg": tmp_path}).versions("pkg.nothing")


def test_a_declared_asset_must_exist(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"asset 'missing\.xml'"):
        versions(tmp_path, {"constants.py": "ASSETS = ('missing.xml',)\n"})


JUNCTION = {
    "heads/__init__.py": '"""Junction."""\n',
    "heads/shared.py": "from pkg.unrelated import X\n",
    "heads/one/__init__.py": '"""Member."""\n',
    "heads/one/config.py": "from pkg.heads.shared import X\n",
    "heads/one/network.py": "from pkg.heads.two.config import SIZE\nfrom pkg.late import late\n",
    "heads/two/__init__.py": '"""Member."""\n',
    "heads/two/config.py": "SIZE = 2\n",
    "heads/two/network.py": "SIZE = 2\n",
    "late.py": "from pkg.heads.one.config import X\nfrom pkg.heads.two.config import SIZE\n",
}
ONE = {"pkg.heads.shared", "pkg.heads.one.config", "pkg.heads.one.network", "pkg.heads.two.config", "pkg.unrelated"}


def at_junction(folder: Path, plugins: tuple[str, ...], changes: Mapping[str, str] | None = None) -> dict[str, str]:
    versions(folder, {**JUNCTION, **(changes or {})})
    return SourceTree({"pkg": folder / "pkg"}, junctions=("pkg.heads",)).versions("pkg.entry", plugins)


def test_what_knows_all_members_of_a_junction_depends_on_none(tmp_path: Path) -> None:
    before = at_junction(tmp_path, ())
    assert set(before) == REACHED
    assert at_junction(tmp_path, (), {"heads/three/__init__.py": "", "heads/two/network.py": "SIZE = 3\n"}) == before


def test_a_chosen_member_counts_with_its_whole_folder_and_what_that_imports(tmp_path: Path) -> None:
    assert set(at_junction(tmp_path, ("pkg.heads.one",))) == REACHED | ONE


def test_another_member_counts_only_if_the_chosen_one_imports_it(tmp_path: Path) -> None:
    before = at_junction(tmp_path, ("pkg.heads.one",))
    assert at_junction(tmp_path, ("pkg.heads.one",), {"heads/two/network.py": "SIZE = 3\n"}) == before
    after = at_junction(tmp_path, ("pkg.heads.one",), {"heads/two/config.py": "SIZE = 3\n"})
    assert {name for name in after if after[name] != before[name]} == {"pkg.heads.two.config"}


def test_a_member_does_not_concern_what_never_meets_its_junction(tmp_path: Path) -> None:
    nested = {f"policy/{name}": content.replace("pkg.heads", "pkg.policy.heads") for name, content in JUNCTION.items()}
    versions(tmp_path, {name: content for name, content in nested.items() if name != "policy/late.py"})
    tree = SourceTree({"pkg": tmp_path / "pkg"}, junctions=("pkg.policy.heads",))
    assert set(tree.versions("pkg.entry", ("pkg.policy.heads.two",))) == REACHED
