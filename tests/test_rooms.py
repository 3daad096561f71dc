"""The house: imports go one way, no room reaches into another's private things, and what is public says so."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = "bodyimage_kin"
ROOMS = (
    *("robot", "backends", "body", "recordings", "estimators", "body_image", "metrics", "calibration"),
    *("study", "published", "figures", "report", "view", "cli"),
)
"""From left to right: nothing imports anything to its right. ``testing`` stands beside ``backends``."""
BESIDE = {"testing": "backends"}


class Import(NamedTuple):
    """What a module uses of the package: a module, its name without the package's, and perhaps a name in it."""

    module: str
    name: str
    line: int

    @property
    def room(self) -> str:
        return self.module.partition(".")[0]

    @property
    def private(self) -> bool:
        """Whether it is somebody's own: a private module of a room, or a private name of any module."""
        shared = self.module.split(".")[1:] if self.room in (*ROOMS, *BESIDE) else []
        return any(part.startswith("_") and not part.startswith("__") for part in (*shared, self.name))


def modules() -> dict[str, Path]:
    """Every module of the package by its name without the package's."""
    found = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        parts = path.relative_to(ROOT / PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imports(tree: ast.AST, module: str = "", is_package: bool = False) -> Iterator[Import]:
    """What a module uses of the package: imports wherever they stand, and attributes of modules imported."""
    bound: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if _inside(alias.name) is not None:
                    yield Import(_inside(alias.name) or "", "", node.lineno)
                    if alias.asname:
                        bound[alias.asname] = _inside(alias.name) or ""
        elif isinstance(node, ast.ImportFrom):
            base = _inside(_absolute(node, module, is_package))
            for alias in node.names if base is not None else []:
                inner = f"{base}.{alias.name}".lstrip(".")
                if inner in MODULES:
                    bound[alias.asname or alias.name] = inner
                    yield Import(inner, "", node.lineno)
                else:
                    yield Import(base or "", alias.name, node.lineno)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and (place := _dotted(node.value)) is not None:
            head, _, rest = place.partition(".")
            inner = f"{bound[head]}.{rest}".strip(".") if head in bound else _inside(place)
            if inner is not None and inner in MODULES and f"{inner}.{node.attr}".lstrip(".") not in MODULES:
                yield Import(inner, node.attr, node.lineno)


def _inside(name: str) -> str | None:
    """A dotted name without the package's; None of another package."""
    package, _, rest = name.partition(".")
    return rest if package == PACKAGE else None


def _absolute(node: ast.ImportFrom, module: str, is_package: bool) -> str:
    if not node.level:
        return node.module or ""
    above = [PACKAGE, *module.split(".")] if module else [PACKAGE]
    above = above[: len(above) - node.level + is_package]
    return ".".join([*above, node.module] if node.module else above)


def _dotted(node: ast.expr) -> str | None:
    if isinstance(node, ast.Name):
        return node.id
    inner = _dotted(node.value) if isinstance(node, ast.Attribute) else None
    return None if inner is None else f"{inner}.{node.attr}"  # type: ignore[attr-defined]


def is_public(module: str) -> bool:
    return not any(part.startswith("_") for part in module.split("."))


def place(room: str) -> int:
    """Where a room stands; what all rooms share (errors, helpers) is left of every room."""
    room = BESIDE.get(room, room)
    return ROOMS.index(room) if room in ROOMS else -1


def wrong(module: str, used: Import) -> str:
    """What is wrong with a module's use of another; empty if nothing is."""
    room = module.partition(".")[0]
    if room == used.room:
        return ""
    if module and not used.module and used.name not in ("", "__version__"):
        return "takes a name from the front door; import it where it lives"
    if module and (place(used.room) > place(room) or (used.room in BESIDE and room != "cli")):
        return "imports what is to its right"
    return "reaches into private things" if used.private else ""


def violations(module: str, tree: ast.AST, is_package: bool) -> dict[tuple[str, str], str]:
    found = {}
    for used in imports(tree, module, is_package):
        if problem := wrong(module, used):
            found[module, used.module] = f"{module}, line {used.line}, {problem}: {used.module} {used.name}".rstrip()
    return found


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def test_every_folder_is_a_room() -> None:
    rooms = {module.partition(".")[0] for module, path in MODULES.items() if path.name == "__init__.py"} - {""}
    assert rooms <= {*ROOMS, *BESIDE}


def test_imports_go_one_way_and_into_no_private_room() -> None:
    found: dict[tuple[str, str], str] = {}
    for module, path in MODULES.items():
        found |= violations(module, parsed(path), path.name == "__init__.py")
    assert not found, "\n".join(found.values())


@pytest.mark.parametrize(
    ("module", "code", "problem"),
    [
        ("body.reach", "from bodyimage_kin.study import Study", "to its right"),
        ("body.reach", "def f():\n    import bodyimage_kin.metrics.maps", "to its right"),
        ("body.reach", "from bodyimage_kin import recordings", "to its right"),
        ("body.reach", "if TYPE_CHECKING:\n    from ..estimators.base import Pairs", "to its right"),
        ("backends", "from ..estimators import base", "to its right"),
        ("errors", "from bodyimage_kin.robot import Robot", "to its right"),
        ("_named", "import bodyimage_kin.robot.tree as tree", "to its right"),
        ("study.cells", "from bodyimage_kin.testing import oracle", "to its right"),
        ("testing.laws", "from bodyimage_kin.body import Embodiment", "to its right"),
        ("study.cells", "from bodyimage_kin.metrics._postures import chunks", "private"),
        ("study.cells", "from bodyimage_kin.metrics import _postures", "private"),
        ("study.cells", "from bodyimage_kin.metrics.probes import _face", "private"),
        ("study.cells", "from bodyimage_kin.metrics import probes\nprobes._face(1)", "private"),
        ("study.cells", "import bodyimage_kin.metrics.probes\nbodyimage_kin.metrics.probes._face", "private"),
        ("study.cells", "import bodyimage_kin as bk\nbk.Robot", "front door"),
        ("study.cells", "from bodyimage_kin import Robot", "front door"),
        ("study.cells", "from bodyimage_kin.study._x import y\nfrom ._x import z\nfrom . import _x", ""),
        ("study.cells", "from bodyimage_kin.robot import Robot\nfrom bodyimage_kin._arrays import as_floats", ""),
        ("study.cells", "from bodyimage_kin import __version__, errors, _files\nimport numpy._core\nself._x", ""),
        ("testing.laws", "from bodyimage_kin.backends import kinematics", ""),
        ("cli.study", "from bodyimage_kin.testing.conform import conform", ""),
        ("", "from bodyimage_kin.study import Study", ""),
    ],
)
def test_the_law_of_rooms_sees_what_is_wrong(module: str, code: str, problem: str) -> None:
    found = violations(module, ast.parse(code), module == "backends")
    assert bool(found) == bool(problem), found
    assert all(problem in text for text in found.values())


# What is public -------------------------------------------------------------------------------------------------------


def public_names(tree: ast.Module) -> list[str] | None:
    """What ``__all__`` says; None without one."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__":
            return list(ast.literal_eval(node.value))
    return None


def top_level_names(tree: ast.Module) -> set[str]:
    """Names that a module binds where everybody sees them, at once or when they are first used."""
    found = set()
    unseen = [one for one in tree.body if isinstance(one, ast.If) and ast.unparse(one.test) == "TYPE_CHECKING"]
    for node in [*tree.body, *(node for one in unseen for node in one.body)]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
        elif isinstance(node, ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
    return found


def test_every_public_module_says_what_is_public_in_it() -> None:
    lacking = set()
    for module, path in MODULES.items():
        if not module or not is_public(module):
            continue
        tree = parsed(path)
        said = public_names(tree)
        if said is None:
            lacking.add(module)
            continue
        assert len(said) == len(set(said)), module
        assert not [name for name in said if name.startswith("_")], module
        assert set(said) <= top_level_names(tree), f"{module} has no {set(said) - top_level_names(tree)}"
    assert not lacking, f"give __all__ to {sorted(lacking)}"


# What stands outside the package --------------------------------------------------------------------------------------


def outside() -> dict[str, str]:
    """Python of comparisons and documentation by where it stands."""
    files = [*(ROOT / "comparisons").rglob("*.py"), *(ROOT / "docs").rglob("*.py")]
    found = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in sorted(files)}
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for number, block in enumerate(
            re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
        ):
            found[f"{page.relative_to(ROOT)}, block {number}"] = block
    return found


OUTSIDE = outside()


def test_comparisons_and_pages_use_public_names_only() -> None:
    assert len(OUTSIDE) > 20
    found = set()
    for where, code in OUTSIDE.items():
        for used in imports(ast.parse(code)):
            private = any(part.startswith("_") and part != "__version__" for part in used.module.split("."))
            if private or used.private:
                found.add((where, f"{used.module}.{used.name}".strip(".")))
            said = public_names(parsed(MODULES[used.module])) if used.module and used.name and not private else None
            assert said is None or used.name in said, (
                f"{where}, line {used.line}: {used.module} keeps {used.name} to itself"
            )
    assert not found, found
