"""The page that tells users how to test their library, run against libraries that are wrong in known ways."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from bodyimage_kin.testing import LAWS, Case, LawBroken, NotOffered, cases, robots
from bodyimage_kin.testing._reduce import reduced
from bodyimage_kin.testing.conform import random_cases

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "test_your_kinematics.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)

pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

# Bug -> (a law that finds it, the most joints of the smallest robot that shows it).
FOUND_BY = {
    "wrong axis default": ("pose_equals_oracle", 1),
    "float32 offsets": ("pose_equals_oracle", 1),
    "swapped columns": ("jacobian_equals_oracle", 2),
    "LOCAL for aligned": ("jacobian_equals_differences", 1),
    "dropped mimic": ("mimic_is_multiplier_times_column", 2),
    "dead hessian": ("hessian_equals_differences", 2),
    "raw axis": ("invariant_under_axis_scaling", 1),
    "alphabetical joints": ("invariant_under_renaming", 2),
    "mimic of a mimic": ("pose_equals_oracle", 3),
    "intrinsic rpy": ("pose_equals_oracle", 1),
    "angles modulo 360 degrees": ("full_turns_change_nothing", 1),
}

QUIET = settings(
    deadline=None, database=None, derandomize=True, suppress_health_check=list(HealthCheck), phases=list(Phase)[:-1]
)


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The small library, as ``import my_kinematics`` finds it."""
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.delitem(sys.modules, "my_kinematics", raising=False)
    import my_kinematics

    return my_kinematics


def adapter() -> Any:
    """The class of the page, with the hessian that the page adds to it further down."""
    page = ModuleType("page")
    for block in BLOCKS[:2]:
        exec(block, page.__dict__)
    return page.AdapterWithHessian


@pytest.fixture(scope="module")
def drawn() -> list[Case]:
    return random_cases(robots(), 400)


def test_the_page_has_fifteen_lines() -> None:
    assert len([line for line in BLOCKS[0].splitlines() if line.strip()]) <= 15


@pytest.mark.parametrize("block", BLOCKS[2:])
def test_what_else_the_page_shows_runs(block: str) -> None:
    exec(block, {})


def test_every_planted_bug_has_a_law(library: Any) -> None:
    assert set(FOUND_BY) == set(library.BUGS)


@pytest.mark.parametrize("law", LAWS.values())
def test_the_right_library_keeps_every_law(law: Any, library: Any) -> None:
    build = adapter()

    @settings(QUIET, max_examples=20)
    @given(case=cases())
    def check(case: Any) -> None:
        law(build, case)

    if law.needs <= {"jacobian", "hessian"}:
        check()
    else:
        with pytest.raises(NotOffered, match="does not offer"):
            check()


@pytest.mark.parametrize("bug", FOUND_BY)
def test_every_planted_bug_is_found_on_a_small_robot(
    bug: str, library: Any, drawn: list[Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    build = adapter()
    monkeypatch.setattr(library, "BUG", bug)
    law, joints = FOUND_BY[bug]
    found = [case for case in drawn if still_broken(law, build, case)]
    assert found, f"none of {len(drawn)} cases shows it"
    # Where shrinking ends depends a little on where it begins.
    begins = sorted(found, key=lambda case: len(case.robot.joints))[:5]
    ends = [reduced(case, lambda case: still_broken(law, build, case)) for case in begins]
    smallest = min(ends, key=lambda case: len(case.robot.joints))
    assert len(smallest.robot.joints) == joints, smallest.to_urdf()


def test_what_a_user_sees_is_small_and_says_all(library: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    build = adapter()
    monkeypatch.setattr(library, "BUG", "wrong axis default")

    @settings(QUIET, max_examples=200, report_multiple_bugs=False)
    @given(case=cases())
    def check(case: Any) -> None:
        LAWS["pose_equals_oracle"](build, case)

    with pytest.raises(LawBroken) as caught:
        check()
    broken = caught.value
    # Where random shrinking ends depends on where it began.
    assert len(broken.case.robot.joints) <= 3
    for part in ("pose_equals_oracle", repr(broken.case.link), broken.case.robot.to_urdf()):
        assert part in str(broken)


def still_broken(law: str, build: Any, case: Case) -> bool:
    try:
        LAWS[law](build, case)
    except LawBroken:
        return True
    return False


def test_the_page_runs_in_pytest_as_it_stands(tmp_path: Path) -> None:
    source = (HERE / "my_kinematics.py").read_text(encoding="utf-8")
    (tmp_path / "test_page.py").write_text(BLOCKS[0], encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    # A profile as users have them, to be quick.
    profile = "from hypothesis import Phase, settings\n"
    profile += "settings.register_profile('quick', max_examples=40, phases=[Phase.generate], derandomize=True)\n"
    (tmp_path / "conftest.py").write_text(profile + "settings.load_profile('quick')\n", encoding="utf-8")
    source = source.replace('BUG = ""', 'BUG = "wrong axis default"')
    (tmp_path / "my_kinematics.py").write_text(source, encoding="utf-8")
    laws = "pose_equals_oracle or batch_equals_loop"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", laws, str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 1 skipped" in done.stdout
    assert "LawBroken: pose_equals_oracle: pose against the oracle's" in done.stdout
