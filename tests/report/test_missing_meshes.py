"""A page is made of what was computed, also where the robot's meshes are not there."""

from __future__ import annotations

import pytest

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.figures.visuals import link_surfaces
from bodyimage_kin.report.fuke2007 import _drawable


def test_a_robot_whose_meshes_are_missing_is_drawn_as_rods_and_one_that_has_them_is_not(tmp_path):
    urdf = '<robot name="m"><link name="a"><visual><geometry>{}</geometry></visual></link><link name="b"/>'
    urdf += '<joint name="j" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0 0 0.3"/></joint></robot>'
    robot = bk.Robot.from_urdf(urdf.format('<mesh filename="no.stl"/>'), mesh_folder=tmp_path)
    with pytest.raises(InvalidGeometry):
        link_surfaces(robot)
    drawn = _drawable(robot)
    assert set(link_surfaces(drawn)) == {"a", "b"}
    assert drawn.link_names == robot.link_names
    ball = bk.Robot.from_urdf(urdf.format('<sphere radius="0.1"/>'))
    assert _drawable(ball) is ball
