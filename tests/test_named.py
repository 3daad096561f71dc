"""Classes named in text: where they are looked for, and what is refused before anything is built."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from bodyimage_kin._named import named_class
from bodyimage_kin.errors import InvalidConfig


@pytest.fixture(autouse=True)
def imports(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Imports as they were, and a current folder with nothing in it."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    for name in [name for name in sys.modules if name.startswith("mine_")]:
        monkeypatch.delitem(sys.modules, name)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")


def test_the_folder_of_the_file_comes_before_the_current_one(tmp_path: Path) -> None:
    beside = tmp_path / "beside"
    beside.mkdir()
    for folder, value in ((beside, 1), (tmp_path / "here", 2)):
        (folder / "mine_twice.py").write_text(f"class C:\n    value = {value}\n    def fit(self): ...\n")
    (tmp_path / "here" / "mine_here.py").write_text("class C:\n    def fit(self): ...\n")
    assert named_class("estimator", "mine_twice:C", ["fit"], beside).value == 1
    assert named_class("estimator", "mine_here:C", ["fit"], beside).__module__ == "mine_here"


def test_what_is_installed_comes_first_and_other_files_are_not_run(tmp_path: Path) -> None:
    for name in ("json", "mine_other"):
        (tmp_path / "here" / f"{name}.py").write_text("raise SystemExit('run without being asked')\n")
    (tmp_path / "here" / "mine_asked.py").write_text(
        "import json\nclass C:\n    dumps = staticmethod(json.dumps)\n    class Inner:\n        def fit(self): ...\n"
    )
    assert named_class("estimator", "mine_asked:C.Inner", ["fit"]).__name__ == "Inner"
    assert named_class("encoder", "json:JSONEncoder", ["encode"]).__module__ == "json.encoder"


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("mine_missing:C", "No module named 'mine_missing'; put mine_missing.py into .*here.* or install it"),
        ("mine_package.sub:C", "No module named 'mine_package'; put mine_package.py"),
        ("mine_imports:C", "importing mine_imports fails: No module named 'mine_absent'"),
        ("mine_breaks:C", "importing mine_breaks fails: ZeroDivisionError: division by zero"),
        ("mine_wrong:C", "importing mine_wrong fails: SyntaxError"),
        ("subprocess:Popen", "'subprocess:Popen' has no method fit; name a class that has"),
        ("math:pi", "has no method fit .it is no class but a float."),
        ("math:sine", "'math' has no 'sine'"),
        (".relative:C", "names no class"),
        ("math:", "names no class"),
        (":C", "names no class"),
        ("os:system('true')", "names no class"),
        ("math", "names no class"),
        ("a\0b:C", "names no class"),
    ],
)
def test_what_is_no_such_class_is_refused_with_a_remedy(place: str, message: str, tmp_path: Path) -> None:
    here = tmp_path / "here"
    (here / "mine_imports.py").write_text("import mine_absent\n")
    (here / "mine_breaks.py").write_text("1 / 0\n")
    (here / "mine_wrong.py").write_text("class\n")
    with pytest.raises(InvalidConfig, match=message) as caught:
        named_class("estimator", place, ["fit"])
    assert "\n" not in str(caught.value)


def test_nothing_is_built_of_what_does_not_fit(tmp_path: Path) -> None:
    (tmp_path / "here" / "mine_loud.py").write_text(
        "class Loud:\n    def __init__(self, *args, **named):\n        raise SystemExit('built')\n"
    )
    with pytest.raises(InvalidConfig, match="has no method fit"):
        named_class("estimator", "mine_loud:Loud", ["fit"])
