"""A robot as a notebook shows it."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from bodyimage_kin.robot.tree import Joint, KinematicTree

_HEAD = ("q", "joint", "kind", "parent", "child", "lower", "upper")


def of(tree: KinematicTree, joints: Sequence[Joint], sha256: str, notes: Sequence[str]) -> str:
    """HTML: a line, a table of the joints that a posture has values for, and the notes."""
    head = f"<b>{escape(tree.name)}</b>: {len(tree.links)} links from <code>{escape(tree.root)}</code>"
    cells = [
        (str(index), joint.name, joint.kind, joint.parent, joint.child, f"{joint.lower:g}", f"{joint.upper:g}")
        for index, joint in enumerate(joints)
    ]
    rows = ["".join(f"<th>{name}</th>" for name in _HEAD)]
    rows += ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in cells]
    table = "".join(f"<tr>{row}</tr>" for row in rows)
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<p>{head}, sha256 {sha256[:12]}</p><table>{table}</table>" + (f"<ul>{items}</ul>" if items else "")
