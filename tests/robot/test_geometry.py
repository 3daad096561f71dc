"""What links have beside their frames is read as strictly as kinematics, and what is odd costs its part alone."""

from __future__ import annotations

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.errors import InvalidGeometry
from bodyimage_kin.robot.geometry import (
    Box,
    Capsule,
    Collision,
    Cylinder,
    Inertial,
    LinkGeometry,
    Mesh,
    Sphere,
    Visual,
)
from bodyimage_kin.robot.shapes import link_surface

ORIGIN = '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'
PLACE = {"xyz": (1.0, 2.0, 3.0), "rpy": (0.1, 0.2, 0.3)}


BOX_LINK = '<link name="b"><collision><geometry><box size="1 1 1"/></geometry></collision></link>'
WELD = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/>{}</joint>'


def robot(link, place="", others=""):
    links = f'<link name="a">{link}</link>{BOX_LINK}'
    return bk.Robot.from_urdf(f'<robot name="r">\n{links}{WELD.format(place)}{others}</robot>')


def visual(geometry, material="", origin=""):
    return f"<visual>{origin}<geometry>{geometry}</geometry>{material}</visual>"


SHAPES = {
    '<box size="1 2 3"/>': Box((1.0, 2.0, 3.0)),
    '<sphere radius="0.5"/>': Sphere(0.5),
    '<cylinder radius="0.5" length="2"/>': Cylinder(0.5, 2.0),
    '<capsule length="2" radius="0.5"/>': Capsule(0.5, 2.0),
    '<mesh filename="a b.stl"/>': Mesh("a b.stl"),
    '<mesh filename="package://p/a.stl" scale="1 -1 0.001"/>': Mesh("package://p/a.stl", (1.0, -1.0, 0.001)),
    '<mesh filename="a.stl" scale="0.001"/>': Mesh("a.stl", (0.001, 0.001, 0.001)),
}


@pytest.mark.parametrize("text", SHAPES)
def test_shapes_are_read_with_their_places(text):
    parts = visual(text) + visual(text, origin=ORIGIN)
    link = robot(parts + parts.replace("visual", "collision")).geometry["a"]
    assert link == LinkGeometry(
        (Visual(SHAPES[text]), Visual(SHAPES[text], **PLACE)),
        (Collision(SHAPES[text]), Collision(SHAPES[text], **PLACE)),
    )
    joint = robot("", ORIGIN).tree.joints[0]
    np.testing.assert_array_equal(link.visuals[1].origin, joint.origin)
    with pytest.raises(ValueError, match="read-only"):
        joint.origin[0, 0] = 2.0


def test_masses_are_read():
    inertia = '<inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="3"/>'
    link = robot(f'<inertial>{inertia}<mass value="4"/>{ORIGIN}</inertial>').geometry["a"]
    assert link.inertial == Inertial(4.0, (1.0, 0.1, 0.2, 2.0, 0.3, 3.0), **PLACE)
    np.testing.assert_array_equal(link.inertial.inertia, [[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 3]])
    alone = robot('<inertial><mass value="0"/></inertial>').geometry["a"].inertial
    assert (alone.mass, alone.moments) == (0.0, None)
    with pytest.raises(InvalidGeometry, match="a mass alone; add <inertia>"):
        _ = alone.inertia


MATERIALS = {
    '<material name="m"><color rgba="1 0 0.5 0.25"/></material>': (1.0, 0.0, 0.5, 0.25),
    '<material name="m"><color rgba="1 0 0.5"/></material>': (1.0, 0.0, 0.5, 1.0),
    '<material name="m"><color rgba="7 -1 0.5 2"/></material>': (1.0, 0.0, 0.5, 1.0),
    '<material name="global"/>': (0.0, 1.0, 0.0, 1.0),
    '<material name="elsewhere"/>': (0.0, 0.0, 1.0, 1.0),
    '<material name="nobody"/>': None,
    '<material name="m"><texture filename="a.png"/></material>': None,
    "": None,
}


@pytest.mark.parametrize("material", MATERIALS)
def test_colours_are_those_of_the_materials(material):
    box = '<box size="1 1 1"/>'
    elsewhere = visual(box, '<material name="elsewhere"><color rgba="0 0 1 1"/></material>')
    others = '<material name="global"><color rgba="0 1 0 1"/></material>'
    found = robot(visual(box, material) + elsewhere, others=others).geometry["a"].visuals[0]
    assert found.colour == MATERIALS[material]
    assert found.material == (material.split('"')[1] if material else "")


ODD = {
    "<box/>": "<box> has no size; write size=",
    '<box size="1 1"/>': "<box> size='1 1' has 2 numbers; give 3",
    '<box size="1 1 0"/>': "<box> size is not positive: 0.0; give lengths in metres",
    '<box size="1 1 nan"/>': "'nan' is not a number; numbers must be finite",
    '<box size="1 1 ${x}"/>': "a leftover expression",
    '<box sze="1 1 1"/>': "sze= in <box> is not known; did you mean size=",
    '<sphere radius="-1"/>': "<sphere> radius is not positive: -1.0",
    '<cylinder radius="1"/>': "<cylinder> has no length",
    '<capsule radius="1" length="0"/>': "<capsule> length is not positive",
    "<mesh/>": "<mesh> has no filename",
    '<mesh filename=""/>': "<mesh> has an empty filename",
    '<mesh filename="a.stl" scale="1 0 1"/>': "the scale of a mesh is zero",
    '<mesh filename="a.stl" scale="1 1"/>': "<mesh> scale='1 1' has 2 numbers; give 1 or 3",
    "": "a {part} without geometry; give a box, sphere, cylinder, capsule or mesh",
    '<box size="1 1 1"/><sphere radius="1"/>': "a {part} with several shapes",
    '<box size="1 1 1"/><box size="1 1 2"/>': "a second <box> in one <geometry>; keep one",
    "<blob/>": "<blob> in <geometry> is not known; known here: <box>, <capsule>, <cylinder>, <mesh>, <sphere>",
    '<Box size="1 1 1"/>': "<Box> is not <box>",
    "<xacro:shape/>": "a leftover <xacro:shape>; expand the file with xacro",
    '<box size="1 1 1">1</box>': "text inside <box>",
}


@pytest.mark.parametrize("part", ["visual", "collision"])
@pytest.mark.parametrize("text", ODD)
def test_an_odd_shape_costs_its_part_alone(part, text):
    good = visual('<sphere radius="0.5"/>').replace("visual", part)
    odd = good.replace('<sphere radius="0.5"/>', text)
    found = robot(good + odd)
    link = found.geometry["a"]
    assert len(link.visuals if part == "visual" else link.collisions) == 1
    (note,) = found.notes
    problem = ODD[text].format(part=part)
    assert note.startswith("link 'a', line 2: ")
    assert problem in note
    assert note.endswith(f"(the {part} is left out)")
    with pytest.raises(InvalidGeometry) as caught:
        link.check(part)
    assert problem in str(caught.value)
    link.check("visual" if part == "collision" else "collision")
    # Nor does it trouble another link, nor the kinematics.
    assert [shape.kind for shape in link_surface(found, "b").surface] == ["box"]
    assert bk.Robot.from_urdf(found.to_urdf()).tree == found.tree
    if part == "collision":
        with pytest.raises(InvalidGeometry, match="link 'a', line 2"):
            link_surface(found, "a")


@pytest.mark.parametrize(
    "origin",
    [
        '<orgin xyz="1 2 3"/>', '<origin pos="1 2 3"/>', '<origin xyz="1 2"/>', '<origin xyz="a b c"/>',
        '<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>', '<origin xyz="1 2 3"/><origin xyz="1 2 4"/>',
    ],
)  # fmt: skip
def test_a_misplaced_part_is_left_out(origin):
    parts = visual('<sphere radius="0.5"/>', origin=origin)
    parts += parts.replace("visual", "collision") + f'<inertial>{origin}<mass value="1"/></inertial>'
    found = robot(parts)
    assert found.geometry["a"].visuals == found.geometry["a"].collisions == ()
    assert found.geometry["a"].inertial is None
    assert len(found.notes) == 3


@pytest.mark.parametrize(
    ("inertial", "problem"),
    [
        ("<inertial/>", "<inertial> has no <mass>"),
        ('<inertial><mass value=""/></inertial>', "is empty"),
        ('<inertial><mass value="heavy"/></inertial>', "'heavy' is not a number"),
        ('<inertial><mass value="-1"/></inertial>', "the mass is negative: -1.0"),
        ("<inertial><mass/></inertial>", "<mass> has no value"),
        ('<inertial><mass value="1"/><inertia ixx="1"/></inertial>', "<inertia> has no ixy"),
        ('<inertial><mass value="1"/></inertial><inertial><mass value="2"/></inertial>', "a second <inertial>"),
    ],
)
def test_an_odd_mass_is_no_mass(inertial, problem):
    found = robot(inertial)
    assert found.geometry["a"].inertial is None
    assert problem in found.notes[0]
    with pytest.raises(InvalidGeometry, match="link 'a', line 2"):
        found.geometry["a"].check("inertial")


@pytest.mark.parametrize(
    "material",
    [
        '<material name="m"><color rgba="1 0"/></material>', '<material name="m"><color rgba="red"/></material>',
        '<material name="m"><colour rgba="1 0 0"/></material>', '<material name="m"><color rgb="1 0 0"/></material>',
    ],
)  # fmt: skip
def test_an_odd_colour_costs_the_colour_alone(material):
    found = robot(visual('<box size="1 1 1"/>', material))
    assert found.geometry["a"].visuals == (Visual(Box((1.0, 1.0, 1.0)), material="m"),)
    assert "(the colour is left out)" in found.notes[0]


def test_a_part_of_a_robot_keeps_the_geometry_of_its_links():
    whole = bk.load_embodiment("infant").robot
    part = whole.subtree(["left_hand"])
    assert dict(part.geometry) == {link: whole.geometry[link] for link in part.link_names}
    assert part.geometry["left_hand"].inertial.mass > 0
    assert bk.Robot.from_urdf(part.source) != part
