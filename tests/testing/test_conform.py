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
from bodyimage_kin.testing import Case, RobotSpec, oracle
from bodyimage_kin.testing.conform import conform

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

    failures = conform(None, {"fragile": Fragile}, 60, laws=["pose_equals_oracle"]).verdicts[0].failures
    assert len(failures) == 2
    assert "against the oracle" in str(failures[0])
    assert "raises RuntimeError: sliding is not for us" in str(failures[1])
    assert len(failures[1].case.robot.joints) == 1


def test_an_infinite_error_and_nothing_offered_are_no_success(tmp_path: Path, adapter: type) -> None:
    class Shapeless(adapter):  # type: ignore[misc]
        def pose_and_jacobian(self, q: Any, link: str) -> Any:
            return np.eye(3), np.zeros((6, len(q)))

    report = conform(None, {"shapeless": Shapeless}, 2, tmp_path, laws=["pose_equals_oracle"])
    assert report.exit_status == 1
    assert json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["verdicts"][0]["error"] == "inf"
    assert conform(None, {"mine": adapter}, 2, laws=["hessian_symmetry"]).exit_status == 1


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
    report = conform(tmp_path, ["pinocchio"], 3)
    assert report.exit_status == 0, str(report)
    assert report.robots == 1
    assert "nan" in report.refused["deeper/bad.urdf"]
    assert "refused deeper/bad.urdf" in str(report)
    (tmp_path / "arm.urdf").unlink()
    assert conform(tmp_path, ["pinocchio"], 3).exit_status == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"target": "no-such-package-or-file"}, "no file, no folder and no installed package"),
        ({"target": "hypothesis"}, "no [*].urdf"),
        ({"backends": ["pinochio"]}, "no backend 'pinochio'"),
        ({"backends": ["nowhere:Class"]}, "cannot load library"),
        ({"examples": 0}, "at least 1"),
        ({"laws": ["gravity"]}, "no law 'gravity'"),
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
    assert report.exit_status == 0, str(report)
    assert report.robots >= 67
    # One has no name for the robot; one has a follower of a joint that does not exist.
    assert all("has no name" in why or "does not exist" in why for why in report.refused.values()), report.refused
