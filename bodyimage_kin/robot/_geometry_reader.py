"""Visuals, collisions, inertials and materials out of the elements that were read with the kinematics."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot._numbers import number, numbers, placement, required
from bodyimage_kin.robot._wording import Notes
from bodyimage_kin.robot._xml import Element
from bodyimage_kin.robot.geometry import (
    Box,
    Capsule,
    Collision,
    Colour,
    Cylinder,
    Inertial,
    LinkGeometry,
    Mesh,
    Part,
    Shape,
    Sphere,
    Visual,
)

_Read = TypeVar("_Read")
_SHAPES = "a box, sphere, cylinder, capsule or mesh"


def read_geometry(robot: Element, links: Iterable[str], notes: Notes) -> dict[str, LinkGeometry]:
    """What each of these links has beside its frame; what cannot be read is left out and noted."""
    elements = {element.attributes["name"]: element for element in robot.parts("link")}
    colours = _Colours(robot, notes)
    # A link that the reader added itself has no element.
    return {link: _link(elements[link], colours, notes) if link in elements else LinkGeometry() for link in links}


class _Colours:
    """The colours of a file's materials. A name may be given its colour anywhere, last of all in the robot itself."""

    def __init__(self, robot: Element, notes: Notes) -> None:
        visuals = [visual for link in robot.parts("link") for visual in link.parts("visual")]
        materials = [material for visual in visuals for material in visual.parts("material")] + robot.parts("material")
        self._own = {id(material): _colour(material, notes) for material in materials}
        self._named = {_name(material): own for material in materials if (own := self._own[id(material)])}

    def of(self, material: Element) -> Colour | None:
        return self._own[id(material)] or (self._named.get(_name(material)) if _name(material) else None)


def _name(material: Element) -> str:
    return material.attributes.get("name", "")


def _link(link: Element, colours: _Colours, notes: Notes) -> LinkGeometry:
    if not link.children:
        return LinkGeometry()
    problems: list[tuple[Part, str]] = []
    visuals = _readable(link, "visual", lambda element: _visual(element, colours), problems)
    collisions = _readable(link, "collision", _collision, problems)
    inertials = _readable(link, "inertial", _inertial, problems)
    for part, problem in problems:
        notes.lose(f"{problem} (the {part} is left out)")
    # Of two inertials neither is trusted.
    doubtful = any(part == "inertial" for part, _ in problems)
    return LinkGeometry(visuals, collisions, None if doubtful or not inertials else inertials[0], tuple(problems))


def _readable(
    link: Element, part: Part, read: Callable[[Element], _Read], problems: list[tuple[Part, str]]
) -> tuple[_Read, ...]:
    """The parts of a kind that can be read; the others join the problems."""
    found = []
    for element in link.parts(part):
        try:
            if element.fault is not None:
                raise element.fault
            found.append(read(element))
        except InvalidURDF as problem:
            problems.append((part, str(problem)))
    return tuple(found)


def _collision(element: Element) -> Collision:
    return Collision(_shape(element), *placement(element.part("origin")))


def _visual(element: Element, colours: _Colours) -> Visual:
    shape, place = _shape(element), placement(element.part("origin"))
    material = element.part("material")
    return Visual(shape, *place) if material is None else Visual(shape, *place, _name(material), colours.of(material))


def _shape(element: Element) -> Shape:
    geometry = element.part("geometry")
    shapes = [] if geometry is None else geometry.children
    if len(shapes) != 1:
        problem = f"a {element.tag} without geometry" if not shapes else f"a {element.tag} with several shapes"
        (geometry or element).refuse(problem, f"give {_SHAPES}")
    shape = shapes[0]
    match shape.tag:
        case "box":
            x, y, z = _sizes(shape, "size", 3)
            return Box((x, y, z))
        case "sphere":
            return Sphere(*_sizes(shape, "radius"))
        case "cylinder":
            return Cylinder(*_sizes(shape, "radius"), *_sizes(shape, "length"))
        case "capsule":
            return Capsule(*_sizes(shape, "radius"), *_sizes(shape, "length"))
    scale = numbers(shape, "scale", 1, 3) or [1.0]
    if 0.0 in scale:
        shape.refuse("the scale of a mesh is zero", "leave scale out, or give factors")
    x, y, z = scale * 3 if len(scale) == 1 else scale
    return Mesh(required(shape, "filename"), (x, y, z))


def _sizes(shape: Element, key: str, count: int = 1) -> list[float]:
    found = numbers(shape, key, count)
    if found is None:
        shape.refuse(f"<{shape.tag}> has no {key}", f'write {key}="..."')
    if min(found) <= 0.0:
        shape.refuse(f"<{shape.tag}> {key} is not positive: {min(found)!r}", "give lengths in metres")
    return found


def _inertial(element: Element) -> Inertial:
    mass, inertia = element.part("mass"), element.part("inertia")
    if mass is None:
        element.refuse("<inertial> has no <mass>", "add <mass>")
    kilograms = number(mass, "value")
    if kilograms < 0.0:
        mass.refuse(f"the mass is negative: {kilograms!r}", "give it in kilograms")
    place = placement(element.part("origin"))
    if inertia is None:
        return Inertial(kilograms, None, *place)
    xx, xy, xz, yy, yz, zz = (number(inertia, key) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    return Inertial(kilograms, (xx, xy, xz, yy, yz, zz), *place)


def _colour(material: Element, notes: Notes) -> Colour | None:
    """The colour that a material gives itself; one that cannot be read costs the colour alone."""
    try:
        if material.fault is not None:
            raise material.fault
        colour = material.part("color")
        found = None if colour is None else numbers(colour, "rgba", 3, 4)
    except InvalidURDF as problem:
        notes.lose(f"{problem} (the colour is left out)")
        return None
    if found is None:
        return None
    # Three numbers are opaque.
    r, g, b, a = (min(max(value, 0.0), 1.0) for value in (*found, 1.0)[:4])
    return r, g, b, a
