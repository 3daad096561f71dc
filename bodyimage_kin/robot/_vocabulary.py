"""Every element and attribute that a URDF may have: what is read, and what is known to move no link."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from bodyimage_kin.robot._wording import closest


class Known(NamedTuple):
    """What is known of one element.

    Attributes:
        read: Child elements that are read.
        attributes: Attributes that are read.
        passed_over: Child elements that say nothing of what is read here.
        ignored: Attributes that say nothing of what is read here.
        text: Whether text between the children is passed over; else it is refused.
    """

    read: frozenset[str] = frozenset()
    attributes: frozenset[str] = frozenset()
    passed_over: frozenset[str] = frozenset()
    ignored: frozenset[str] = frozenset()
    text: bool = False


def _known(read: str = "", attributes: str = "", passed_over: str = "", ignored: str = "", text: bool = False) -> Known:
    split = [frozenset(names.split()) for names in (read, attributes, passed_over, ignored)]
    return Known(split[0], split[1], split[2], split[3], text)


VOCABULARY: Final = {
    "robot": _known(
        "link joint material",
        "name",
        # Simulators, controllers, sensors, planners and exporters, and what has slipped up one level.
        "gazebo transmission ros2_control sensor mujoco bullet velocity inertial frame RefLink create author date "
        "description license contact collision_filter_group force_element parameter cable deformable "
        "reduced_deformable schedule_topic_creator_file self_collision_checking disable_collisions static plugin",
        "version",
        text=True,
    ),
    "link": _known(
        "inertial visual collision",
        "name",
        # URDF knows no origin of a link, and no parser of note reads one.
        "origin gazebo sensor contact gravity kinematic surface self_collision_checking collision_checking self_filter "
        "audio_source bullet velocity material selfCollide turnGravityOff",
        "type concave",
        text=True,
    ),
    "joint": _known(
        "origin axis limit mimic parent child",
        "name type",
        "dynamics safety_controller calibration gazebo sensor transmission hardwareInterface actuator anchor traits "
        "controller_gains joint_properties",
        "dont_collapse",
    ),
    "origin": _known(attributes="xyz rpy quat_xyzw"),
    "axis": _known(attributes="xyz rpy"),
    "limit": _known(
        attributes="lower upper",
        ignored="effort velocity acceleration deceleration jerk current command_effort gear_velocity k_velocity "
        "k_position damping friction stiffness twist",
    ),
    "mimic": _known(attributes="joint multiplier offset"),
    "parent": _known(attributes="link"),
    "child": _known(attributes="link"),
    "visual": _known("origin geometry material", passed_over="bullet verbose", ignored="name group", text=True),
    "collision": _known(
        "origin geometry",
        passed_over="material contact surface bullet verbose max_contacts",
        ignored="name group mask concave",
        text=True,
    ),
    "inertial": _known("origin mass inertia", passed_over="gravity", ignored="name", text=True),
    "geometry": _known("box sphere cylinder capsule mesh", passed_over="material", ignored="name", text=True),
    "material": _known("color", "name", "texture specular ambient diffuse emissive shininess script", text=True),
    "box": _known(attributes="size"),
    "sphere": _known(attributes="radius"),
    "cylinder": _known(attributes="radius length"),
    "capsule": _known(attributes="radius length"),
    "mesh": _known(attributes="filename scale"),
    "mass": _known(attributes="value"),
    "inertia": _known(attributes="ixx ixy ixz iyy iyz izz", ignored="iyx izx izy"),
    "color": _known(attributes="rgba"),
}
"""By tag. What is neither read nor passed over is refused: it may be a misspelt word for something that is read."""

GEOMETRIC: Final = frozenset({"visual", "collision", "inertial", "material"})
"""The parts that may fail alone: an error inside costs the part, and not the robot."""

MANY: Final = frozenset({("robot", "link"), ("robot", "joint"), ("robot", "material"), ("link", "visual"),
                         ("link", "collision")})  # fmt: skip
"""(Parent, child) where there may be several; elsewhere a second one is refused unless it says the same."""

_MACROS: Final = frozenset({"include", "property", "macro", "if", "unless", "arg", "insert_block", "call", "element"})
_FORBIDDEN: Final = {
    "loop_joint": "a robot is a tree: loops are not computed; leave it out to read the open chain",
    "robot": "one file is one robot: move its links and joints up",
    "group": "groups belong into an SRDF file, and links and joints directly into <robot>",
    "joint": "a joint stands directly in <robot>",
    "link": "a link stands directly in <robot>",
}
"""What must not be passed over wherever it stands, prefixed or not, and what to do about it."""
KINEMATIC: Final = frozenset(_FORBIDDEN) | _MACROS | VOCABULARY["joint"].read
"""Words that would move links: under a prefix, too, they are refused."""


def remedy_for(tag: str, parent: str) -> str:
    """What to do about an element that is unknown inside a parent."""
    if tag in _MACROS:
        return "expand the file with xacro"
    if tag in _FORBIDDEN and tag not in VOCABULARY[parent].read:
        return _FORBIDDEN[tag]
    read, passed_over = VOCABULARY[parent].read, VOCABULARY[parent].passed_over
    guess = closest(tag, read) or closest(tag, passed_over)
    if guess:
        return f"did you mean <{guess}>?"
    return "a macro is expanded with xacro; anything else is removed" if parent == "robot" else _list(read, "<{}>")


def remedy_for_attribute(key: str, tag: str) -> str:
    """What to do about an attribute that is unknown in an element."""
    guess = closest(key, VOCABULARY[tag].attributes) or closest(key, VOCABULARY[tag].ignored)
    return f"did you mean {guess}=?" if guess else _list(VOCABULARY[tag].attributes, "{}=")


def _list(names: Iterable[str], form: str) -> str:
    known = ", ".join(form.format(name) for name in sorted(names))
    return f"known here: {known}" if known else "remove it"
