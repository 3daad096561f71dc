"""A calibrated robot as the file it was read from, its joints where they were found."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from bodyimage_kin.robot import Robot

__all__ = ["urdf_of"]


def urdf_of(robot: Robot, found: Robot) -> str:
    """The text that a robot was read from, with the joint origins of another: visuals, inertials and comments stay.

    Args:
        robot: As it was read.
        found: The same robot with other joint origins.

    Returns:
        URDF; links and joints alone where the robot's text cannot be told joint by joint.
    """
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    try:
        root = ET.fromstring(robot.source, parser)
    except ET.ParseError:
        return found.to_urdf()
    elements = {str(one.get("name")).strip(): one for one in root.iter("joint")}
    for before, after in zip(robot.tree.joints, found.tree.joints, strict=True):
        if (before.xyz, before.rpy) == (after.xyz, after.rpy):
            continue
        if after.name not in elements:
            return found.to_urdf()
        origin = elements[after.name].find("origin")
        if origin is None:
            origin = ET.Element("origin")
            elements[after.name].insert(0, origin)
        origin.attrib.clear()
        for key, values in (("xyz", after.xyz), ("rpy", after.rpy)):
            origin.set(key, " ".join(map(repr, values)))
    return f"{ET.tostring(root, encoding='unicode')}\n"
