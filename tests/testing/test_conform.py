"""Conformance: the verdicts are right, the report says so, and what failed can be asked again."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.testing import LAWS, Case, LawBroken, NotOffered, RobotSpec, oracle, robots
from bodyimage_kin.testing.conform import conform, random_cases

pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")

HERE = Path(__file__).parent
ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="tip"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 2"/></joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="tip"/><origin xyz="0.1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.delitem(sys.modules, "my_kinematics", raising=False)
    import my_kinematics

    return my_kinematics


@pytest.fixture
def adapter(library: Any) -> type:
    class Adapter:
        def __init__(self, urdf: str) -> None:
            self.robot = library.Robot(urdf)

        def pose_and_jacobian(self, q: Any, link: str) -> Any:
            return library.forward(self.robot, q, link), library.jacobian(self.robot, q, link)

    return Adapter


def test_our_backends_conform_and_the_report_says_so(tmp_path: Path) -> None:
    told: list[Any] = []
    report = conform(None, ["pinocchio", "mujoco"], 5, tmp_path, laws=["pose_equals_oracle"], tell=told.append)
    assert report.exit_status == 0
    assert tuple(told) == report.verdicts
    assert "pose_equals_oracle" in str(report)
    assert "pinocchio" in str(report)
    read = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert [verdict["status"] for verdict in read["verdicts"]] == ["passed", "passed"]
    assert read["versions"]["pin"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "mujoco" in page
    assert "http" not in page.replace("http-equiv", "")


def test_a_broken_law_is_failed_with_a_file_that_asks_it_again(tmp_path: Path, library: Any, adapter: type) -> None:
    library.BUG = "wrong axis default"
    report = conform(None, {"mine": adapter}, 40, tmp_path, laws=["pose_equals_oracle", "batch_equals_loop"])
    assert report.exit_status == 1
    broken, missing = report.verdicts
    assert (broken.status, missing.status) == ("failed", "not offered")
    failure = broken.failures[0]
    assert len(failure.case.robot.joints) == 1
    file = tmp_path / str(failure.file)
    again = conform(file, {"mine": adapter}, 1, laws=["pose_equals_oracle"])
    assert again.exit_status == 1
    assert again.verdicts[0].failures[0].case.q == failure.case.q
    library.BUG = ""
    assert conform(file, {"mine": adapter}, 1, laws=["pose_equals_oracle"]).exit_status == 0


def test_what_a_library_raises_does_not_hide_what_it_gets_wrong(library: Any, adapter: type) -> None:
    library.BUG = "wrong axis default"

    class Fragile(adapter):  # type: ignore[misc]
        def __init__(self, urdf: str) -> None:
            if "prismatic" in urdf:
                raise RuntimeError("sliding is not for us")
            super().__init__(urdf)

    # Which robots are drawn hangs on what modules are loaded (see random_cases): enough of them to have both kinds.
    failures = conform(None, {"fragile": Fragile}, 200, laws=["pose_equals_oracle"]).verdicts[0].failures
    assert len(failures) == 2
    assert "against the oracle" in str(failures[0])
    assert "raises RuntimeError: sliding is not for us" in str(failures[1])
    assert len(failures[1].case.robot.joints) == 1


def test_each_kind_of_failure_is_reduced_by_itself(library: Any, adapter: type) -> None:
    library.BUG = "wrong axis default"

    class Empty(adapter):  # type: ignore[misc]
        def __init__(self, urdf: str) -> None:
            if "<joint" not in urdf:
                raise ValueError("a robot has joints")
            super().__init__(urdf)

    wrong = conform(None, {"empty": Empty}, 6, laws=["pose_equals_oracle"]).verdicts[0].failures[0]
    # A robot without joints is smaller still, but what it shows is another failure.
    assert "against the oracle" in wrong.detail
    assert wrong.case.robot.joints


def test_an_infinite_error_and_nothing_offered_are_no_success(tmp_path: Path, adapter: type) -> None:
    class Shapeless(adapter):  # type: ignore[misc]
        def pose_and_jacobian(self, q: Any, link: str) -> Any:
            return np.eye(3), np.zeros((6, len(q)))

    report = conform(None, {"shapeless": Shapeless}, 2, tmp_path, laws=["pose_equals_oracle"])
    assert report.exit_status == 1
    assert json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["verdicts"][0]["error"] == "inf"
    assert conform(None, {"mine": adapter}, 2, laws=["hessian_symmetry"]).exit_status == 1


def test_threads_that_get_in_each_other_s_way_are_found(library: Any, adapter: type) -> None:
    class Careful(adapter):  # type: ignore[misc]
        offers = ("threads",)

    class Sharing(Careful):
        """Keeps what it was asked in one place for all."""

        def pose_and_jacobian(self, q: Any, link: str) -> Any:
            self.q = q
            pose = library.forward(self.robot, self.q, link)
            return pose, library.jacobian(self.robot, self.q, link)

    law = LAWS["threads_equal_one"]
    case = next(case for case in random_cases(robots(), 20) if len(case.robot.path(case.link)) > 2 and case.robot.n > 1)
    assert law(Careful, case) == 0.0
    with pytest.raises(LawBroken, match="of 4 threads against one"):
        law(Sharing, case)
    with pytest.raises(NotOffered, match="does not offer threads"):
        law(adapter, case)


def test_a_library_of_poses_alone_is_asked_for_poses_alone(adapter: type, library: Any) -> None:
    class Poses:
        def __init__(self, urdf: str) -> None:
            self.robot = library.Robot(urdf)

        def pose(self, q: Any, link: str) -> Any:
            return library.forward(self.robot, q, link)

    status = {verdict.law: verdict.status for verdict in conform(None, {"poses": Poses}, 10).verdicts}
    assert status["pose_equals_oracle"] == status["invariant_under_renaming"] == "passed"
    assert status["mimic_is_multiplier_times_column"] == "passed"
    assert status["jacobian_equals_oracle"] == status["jacobian_equals_differences"] == "not offered"


def test_the_library_may_have_its_own_order_and_take_a_robot(library: Any, tmp_path: Path) -> None:
    class Ordered:
        def __init__(self, robot: Any) -> None:
            self.robot = library.Robot(robot.source.decode())
            self.ours = robot.joint_names
            self.joint_names = sorted(robot.joint_names)

        def pose_and_jacobian(self, q: Any, link: str) -> Any:
            order = [self.joint_names.index(name) for name in self.ours]
            back = [list(self.ours).index(name) for name in self.joint_names]
            jacobian = library.jacobian(self.robot, q[order], link)
            return library.forward(self.robot, q[order], link), jacobian[:, back]

        def hessian(self, q: Any, link: str) -> Any:
            order = [self.joint_names.index(name) for name in self.ours]
            back = [list(self.ours).index(name) for name in self.joint_names]
            return library.hessian(self.robot, q[order], link)[:, back][:, :, back]

    report = conform(None, {"ordered": Ordered}, 25)
    assert report.exit_status == 0, str(report)
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    report = conform(tmp_path / "arm.urdf", {"ordered": Ordered}, 3)
    assert report.exit_status == 0, str(report)


def test_a_folder_of_files_and_what_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper" / "bad.urdf").write_text(ARM.replace("0.1 0 0", "0.1 nan 0"), encoding="utf-8")
    report = conform(tmp_path, ["pinocchio"], 3, tmp_path / "report")
    assert not report.failures, str(report)
    assert report.robots == 1
    assert "nan" in report.refused["deeper/bad.urdf"]
    assert "refused deeper/bad.urdf" in str(report)
    # It was named, and was not asked.
    assert report.exit_status == 1
    read = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert read["exit_status"] == 1
    assert [line for line in read["shortcomings"] if line.startswith("refused deeper/bad.urdf")]
    (tmp_path / "deeper" / "bad.urdf").unlink()
    assert conform(tmp_path, ["pinocchio"], 3).exit_status == 0


def test_nothing_is_passed_where_nothing_was_read(tmp_path: Path) -> None:
    file = tmp_path / "bad.urdf"
    file.write_text(ARM.replace("0.1 0 0", "0.1 nan 0"), encoding="utf-8")
    report = conform(file, ["pinocchio", "torch"], 1, tmp_path / "report")
    assert {verdict.status for verdict in report.verdicts} == {"not asked"}
    assert report.exit_status == 1
    assert "pinocchio: nothing was asked" in str(report)
    assert report.summary.endswith("not asked")
    assert " passed" not in report.summary
    read = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert {verdict["status"] for verdict in read["verdicts"]} == {"not asked"}
    assert {verdict["asked"] for verdict in read["verdicts"]} == {0}
    assert "bad.urdf" in read["refused"]
    assert 'class="not-asked"' in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


def test_a_law_that_a_robot_has_no_case_for_is_not_asked(tmp_path: Path, adapter: type) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(ARM, encoding="utf-8")
    report = conform(file, {"mine": adapter}, 3)
    verdicts = {verdict.law: verdict for verdict in report.verdicts}
    # Nothing in it follows anything; its deepest link has every joint on its path.
    assert verdicts["mimic_is_multiplier_times_column"].status == "not asked"
    assert verdicts["pose_equals_oracle"].asked == 3
    # What nobody named may be left unasked; what was named may not.
    assert report.exit_status == 0, str(report)
    named = conform(file, {"mine": adapter}, 3, laws=["pose_equals_oracle", "mimic_is_multiplier_times_column"])
    assert named.exit_status == 1
    assert named.shortcomings == ("mine: mimic_is_multiplier_times_column: not asked",)
    offered = conform(file, {"mine": adapter}, 3, laws=["pose_equals_oracle", "hessian_symmetry"])
    assert offered.shortcomings == ("mine: hessian_symmetry: not offered",)
    assert offered.exit_status == 1
    assert conform(file, {"mine": adapter}, 3, laws=[]).exit_status == 1


def test_a_statue_is_asked_what_a_statue_knows(tmp_path: Path) -> None:
    file = tmp_path / "statue.urdf"
    file.write_text('<robot name="statue"><link name="plinth"/></robot>', encoding="utf-8")
    status = {verdict.law: verdict.status for verdict in conform(file, ["pinocchio"], 2).verdicts}
    assert status["pose_equals_oracle"] == status["empty_batch"] == "passed"
    about_motion = ("jacobian_equals_differences", "gradcheck", "gradgradcheck", "hessian_equals_differences")
    for law in (*about_motion, "off_path_columns_are_zero", "full_turns_change_nothing"):
        assert status[law] == "not asked", law


def test_files_count_whatever_the_case_of_their_ending(tmp_path: Path) -> None:
    (tmp_path / "CAD.URDF").write_text(ARM, encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    (tmp_path / "arm.urdf.bak").write_text(ARM, encoding="utf-8")
    assert conform(tmp_path, ["torch"], 1, laws=["pose_equals_oracle"]).robots == 2


class TestTolerance:
    """Libraries that are right but not exact pass within a tolerance, and wrong ones do not."""

    @pytest.fixture
    def single(self, adapter: type) -> type:
        """A library that computes in float32."""

        class Single(adapter):  # type: ignore[misc]
            def pose_and_jacobian(self, q: Any, link: str) -> Any:
                return tuple(values.astype(np.float32) for values in super().pose_and_jacobian(q, link))

        return Single

    @pytest.fixture
    def by_differences(self, adapter: type) -> type:
        """A library that has a Jacobian by central differences of two points."""

        class ByDifferences(adapter):  # type: ignore[misc]
            def pose_and_jacobian(self, q: Any, link: str) -> Any:
                pose = super().pose_and_jacobian(q, link)[0]
                columns = []
                for step in 1e-5 * np.eye(len(q)):
                    ahead, behind = (
                        super(ByDifferences, self).pose_and_jacobian(q + s, link)[0] for s in (step, -step)
                    )
                    rate = (ahead - behind) / 2e-5
                    spin = rate[:3, :3] @ pose[:3, :3].T
                    columns.append([*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
                return pose, np.array(columns).T.reshape(6, len(q))

        return ByDifferences

    @pytest.mark.parametrize(("kind", "tolerance"), [("single", 1e-5), ("by_differences", 1e-4)])
    def test_what_is_right_but_not_exact(self, kind: str, tolerance: float, request: pytest.FixtureRequest) -> None:
        build = request.getfixturevalue(kind)
        assert conform(None, {kind: build}, 30).exit_status == 1
        report = conform(None, {kind: build}, 60, tolerance=tolerance)
        assert report.exit_status == 0, str(report)
        assert f"tolerance {tolerance:g}" in report.summary

    @pytest.mark.parametrize("bug", ["wrong axis default", "swapped columns", "dropped mimic", "intrinsic rpy"])
    def test_what_is_wrong(self, bug: str, single: type, library: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(library, "BUG", bug)
        assert conform(None, {"single": single}, 60, tolerance=1e-5, laws=["jacobian_equals_oracle"]).failures

    def test_differences_of_what_is_not_exact_still_find_a_wrong_jacobian(
        self, single: type, library: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        law = "jacobian_equals_differences"
        monkeypatch.setattr(library, "BUG", "LOCAL for aligned")
        report = conform(None, {"single": single}, 60, tolerance=1e-5, laws=[law])
        assert report.failures
        assert report.verdicts[0].bound < 2e-3


def test_a_class_in_the_current_folder_is_found(tmp_path: Path, library: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    source = "import my_kinematics as library\n\nclass Mine:\n    def __init__(self, urdf):\n"
    source += "        self.robot = library.Robot(urdf)\n    def pose(self, q, link):\n"
    source += "        return library.forward(self.robot, q, link)\n"
    (tmp_path / "lies_beside_me.py").write_text(source, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    # Restored afterwards, with what is added to it.
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setitem(sys.modules, "lies_beside_me", None)
    monkeypatch.delitem(sys.modules, "lies_beside_me")
    report = conform(None, ["lies_beside_me:Mine"], 3, laws=["pose_equals_oracle"])
    assert report.exit_status == 0, str(report)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"target": "no-such-package-or-file"}, "no file, no folder and no installed package"),
        ({"target": "hypothesis"}, "no [*].urdf"),
        ({"backends": ["pinochio"]}, "no backend 'pinochio'"),
        ({"backends": ["nowhere:Class"]}, "No module named 'nowhere'; put nowhere.py into .*pip install -e"),
        ({"examples": 0}, "at least 1"),
        ({"laws": ["gravity"]}, "laws='gravity': give one of 'pose_equals_oracle'"),
        ({"tolerance": -1.0}, "tolerance=-1.0"),
        ({"backends": ["subprocess:Popen"]}, "'subprocess:Popen' has no method pose_and_jacobian or pose"),
    ],
)
def test_what_cannot_be_asked_is_said(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidConfig, match=message):
        conform(**arguments)


def test_the_oracle_knows_the_planar_arm() -> None:
    from bodyimage_kin.robot import Robot

    text = ARM.replace("prismatic", "revolute").replace('"0.1 0 0"/>', '"0.7 0 0"/><axis xyz="0 0 1"/>')
    text = text.replace("</robot>", '<link name="end"/><joint name="weld" type="fixed"><parent link="tip"/>'
                        '<child link="end"/><origin xyz="0.4 0 0"/></joint></robot>')  # fmt: skip
    robot = RobotSpec.from_robot(Robot.from_urdf(text))
    a, b = 0.3, -1.1
    truth = oracle(Case(robot, (a, b), "end"))
    x, y = 0.7 * np.cos(a) + 0.4 * np.cos(a + b), 0.7 * np.sin(a) + 0.4 * np.sin(a + b)
    u, v = 0.4 * np.cos(a + b), 0.4 * np.sin(a + b)
    np.testing.assert_allclose(truth.pose[:3, 3], [x, y, 0.0], atol=1e-15)
    np.testing.assert_allclose(truth.jacobian[:2], [[-y, -v], [x, u]], atol=1e-15)
    np.testing.assert_allclose(truth.jacobian[5], [1.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(truth.hessian[0], [[-x, -u], [-u, -u]], atol=1e-15)
    np.testing.assert_allclose(truth.hessian[1], [[-y, -v], [-v, -v]], atol=1e-15)
    np.testing.assert_allclose(truth.hessian[3:], 0.0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="needs mujoco")
def test_published_robots_agree_or_are_refused_for_a_reason() -> None:
    pytest.importorskip("pinocchio")
    try:
        report = conform("example-robot-data", None, 2)
    except InvalidConfig:
        pytest.skip("example-robot-data is not installed")
    assert not report.failures, str(report)
    assert report.robots >= 67
    # One has no name for the robot; one has a follower of a joint that does not exist.
    assert all("has no name" in why or "does not exist" in why for why in report.refused.values()), report.refused
