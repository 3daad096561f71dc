"""Where a robot's meshes lie is said once, in code or in the body's file, and whoever draws looks there."""

from __future__ import annotations

import importlib

import pytest
import trimesh

import bodyimage_kin as bk
from bodyimage_kin import cli
from bodyimage_kin.body import check_embodiment, file
from bodyimage_kin.errors import InvalidConfig, InvalidGeometry
from bodyimage_kin.figures.visuals import triangles
from bodyimage_kin.robot import meshes
from bodyimage_kin.study.blocks import blocks
from bodyimage_kin.study.bodies import load_body

URDF = """<robot name="arm"><link name="base"/>
<link name="hand"><visual><geometry><mesh filename="{}"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
BODY = """name = "arm"
urdf = "urdf/arm.urdf"
joints = ["turn"]
[hand]
link = "hand"
offset = [0, 0, 0.3]
[camera]
link = "base"
model = "tracker"
forward = [0, 0, 1]
right = [1, 0, 0]
"""


@pytest.fixture
def folder(tmp_path):
    """A body's file, its URDF in a folder and the mesh in another, as packages of robots are laid out."""
    for place in ("urdf", "meshes/visual"):
        (tmp_path / place).mkdir(parents=True)
    trimesh.creation.box(extents=[1, 1, 1]).export(tmp_path / "meshes" / "visual" / "cube.stl")
    (tmp_path / "urdf" / "arm.urdf").write_text(URDF.format("package://arm_description/visual/cube.stl"))
    (tmp_path / "arm.toml").write_text(BODY)
    return tmp_path


def told(body, **settings):
    return [finding.text for finding in check_embodiment(body, **settings) if finding.about == "meshes"]


def test_a_file_says_where_meshes_lie(folder, capsys):
    body = bk.load_embodiment(folder / "arm.toml")
    assert "1 of 1 mesh files are not found" in told(body)[0]
    with pytest.raises(InvalidGeometry, match="set mesh_folder or ROS_PACKAGE_PATH"):
        triangles(body.robot, {})
    (folder / "arm.toml").write_text(BODY.replace("joints", 'mesh_folder = "meshes"\njoints'))
    again = bk.load_embodiment(folder / "arm.toml")
    assert told(again) == []
    assert len(triangles(again.robot, {}).corners) == 12
    # It is no part of what a body is.
    assert again == body
    assert again.sha256 == body.sha256


def test_the_command_line_says_it_too(folder, capsys):
    arguments = ["embodiment", "check", str(folder / "arm.toml")]
    cli.main(arguments)
    assert "mesh files are not found" in capsys.readouterr().out
    cli.main([*arguments, "--mesh-folder", str(folder / "meshes")])
    assert "mesh files" not in capsys.readouterr().out


def test_code_says_it_as_the_file_does_and_it_is_kept_when_the_body_is_written(folder, tmp_path):
    robot = bk.Robot.from_urdf(folder / "urdf" / "arm.urdf", mesh_folder=folder / "meshes")
    loaded = bk.load_embodiment(folder / "arm.toml")
    body = bk.Embodiment.build(robot, joints=["turn"], hand=loaded.hand, camera=loaded.camera)
    assert body == loaded
    assert told(body) == []
    body.save(folder / "saved.toml")
    assert told(bk.load_embodiment(folder / "saved.toml")) == []
    text = body.to_toml("robot.urdf")
    assert f'mesh_folder = "{(folder / "meshes").as_posix()}"' in text


def test_meshes_beside_a_urdf_are_found_when_it_is_written_elsewhere(folder):
    (folder / "meshes" / "visual" / "cube.stl").rename(folder / "urdf" / "cube.stl")
    (folder / "urdf" / "arm.urdf").write_text(URDF.format("cube.stl"))
    body = bk.load_embodiment(folder / "arm.toml")
    assert told(body) == []
    other = folder / "store"
    other.mkdir()
    (other / "robot.urdf").write_bytes(body.robot.source)
    (other / "body.toml").write_text(body.to_toml("robot.urdf"))
    assert told(bk.load_embodiment(other / "body.toml")) == []


def test_meshes_of_installed_packages_are_found(folder, monkeypatch):
    shared = folder / "prefix" / "share" / "arm_description"
    shared.parent.mkdir(parents=True)
    (folder / "meshes").rename(shared)
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.setattr(meshes.sysconfig, "get_path", lambda name: str(folder / "prefix"))
    assert told(bk.load_embodiment(folder / "arm.toml")) == []


def test_a_folder_that_is_none_is_told_with_the_other_mistakes(folder):
    (folder / "arm.toml").write_text(BODY.replace("joints", "mesh_folder = 3\njoints").replace("turn", "trun"))
    with pytest.raises(bk.errors.ManyMistakes, match=r"mesh_folder=3: give a text(.|\n)*did you mean 'turn'"):
        bk.load_embodiment(folder / "arm.toml")


def test_studies_look_where_they_are_told_and_so_do_their_workers(folder):
    body = bk.load_embodiment(folder / "arm.toml", mesh_folder=folder / "meshes")
    assert told(body) == []
    for place in ("meshes", folder / "meshes"):
        table = {"embodiment": "arm.toml", "mesh_folder": place}
        study = bk.Study({"arm": table}, {"a": bk.motions.Babbling()}, ["LeastSquares"], seeds=1, folder=folder)
        (block,) = blocks({**study.origin(), "folder": str(folder)}, folder / "store")
        found = load_body(block)
        assert found == body
        assert told(found) == []
    with pytest.raises(InvalidConfig, match="mesh_folder is of a body that is loaded"):
        bk.Study({"arm": {"given": "0" * 64, "mesh_folder": "meshes"}}, {"a": "Circle"}, ["LeastSquares"])


def test_a_reproduction_looks_where_it_is_told(folder, monkeypatch, capsys):
    """The arm is none of the paper's: it is refused, but not before it was loaded with its meshes."""
    asked = []
    real = file.load_embodiment

    def loaded(*given, **settings):
        asked.append(settings.get("mesh_folder"))
        return real(*given, **settings)

    modules = ("bodyimage_kin.study.bodies", "bodyimage_kin.published.fuke2007.grid")
    for module in map(importlib.import_module, modules):
        monkeypatch.setattr(module, "load_embodiment", loaded)
    arguments = ["reproduce", "--out", str(folder / "out"), "--embodiment", str(folder / "arm.toml")]
    assert cli.main([*arguments, "--mesh-folder", str(folder / "meshes")]) == 2
    assert "no skin" in capsys.readouterr().err
    assert asked == [folder / "meshes"] * len(asked)
    assert asked
    assert not (folder / "out").exists()
