"""The field's humanoids as bodies: loaded, fit for the paper's experiment, clear of themselves at home."""

from __future__ import annotations

import pytest

import bodyimage_kin as bk
from bodyimage_kin.body.collisions import Hulls
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot.meshes import package_file

ROBOTS = ("g1", "icub", "romeo", "talos")


def there() -> bool:
    """Whether the robots are installed."""
    try:
        package_file("package://example-robot-data/robots/g1_description/urdf/g1_29dof_rev_1_0.urdf")
    except InvalidGeometry:
        return False
    return True


installed = pytest.mark.skipif(not there(), reason="the robots are not installed; install bodyimage-kin[robots]")


@installed
@pytest.mark.parametrize("name", ROBOTS)
def test_a_humanoid_is_fit_for_the_experiment(name):
    body = bk.load_embodiment(name)
    errors = [one for one in bk.body.check_embodiment(body, paper=True) if one.level == "error"]
    assert errors == []
    assert body.skin.shape == (21, 21)
    assert bool(body.visible(body.felt_home))
    assert not bool(body.visible(body.touch_postures([body.skin.middle]))[0])


@installed
@pytest.mark.parametrize("name", ROBOTS)
def test_at_home_a_humanoid_does_not_run_into_itself(name):
    body = bk.load_embodiment(name)
    assert Hulls(body.robot, body.joints).collisions(body.home) == ()


@installed
@pytest.mark.parametrize("dynamics", [False, True])
def test_a_humanoid_sees_its_circle_and_touches_its_face(dynamics):
    body = bk.load_embodiment("g1")
    seen = bk.simulate(body, bk.motions.Circle(turns=0.2), dynamics=dynamics)
    assert bool(seen.hand_image.notnull().all())
    touched = bk.simulate(body, bk.motions.RandomTouch(duration=4.0), dynamics=dynamics)
    assert int((touched.touched >= 0).sum()) > 20


def test_a_robot_of_a_package_that_is_not_there_is_said_with_the_remedy(tmp_path, monkeypatch):
    (tmp_path / "my.toml").write_text(
        (bk.body.file.embodiment_folder() / "g1.toml").read_text().replace("example-", "no-")
    )
    with pytest.raises(InvalidGeometry, match=r"bodyimage-kin\[robots\]"):
        bk.load_embodiment(tmp_path / "my.toml")
    package = tmp_path / "no-robot-data" / "robots" / "g1_description" / "urdf"
    package.mkdir(parents=True)
    (package / "g1_29dof_rev_1_0.urdf").write_text("<robot name='r'><link name='a'/></robot>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    with pytest.raises(bk.errors.BodyImageKinError, match="left_shoulder_pitch_joint"):
        bk.load_embodiment(tmp_path / "my.toml")


@installed
def test_links_with_a_mass_and_no_inertia_are_dragged_and_said():
    body = bk.load_embodiment("icub")
    found = [str(one) for one in bk.body.check_embodiment(body)]
    assert any("'l_wrist_1' have a mass and no inertia" in one for one in found)
    seen = bk.simulate(body, bk.motions.Circle(turns=0.1), dynamics=True)
    assert bool(seen.hand_image.notnull().all())
