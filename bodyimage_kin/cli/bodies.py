"""The command of bodies: ``embodiment check`` and ``embodiment new``."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro
from tyro.conf import Positional, arg

from bodyimage_kin.cli.arguments import Command, File, Flag, MaybeFolder, MaybeName, free, print_json

if TYPE_CHECKING:
    from bodyimage_kin.body import Embodiment as Body
    from bodyimage_kin.body import Finding

__all__ = ["Embodiment"]


@dataclass(frozen=True)
class Check(Command):
    """Say in seconds what cannot work with an embodiment, before anything is computed.

    Exit status 1 when there is an error; notes are no errors.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin embodiment check my.toml --paper",
        "bodyimage-kin embodiment check my.toml --mesh-folder meshes --json",
    )

    file: Annotated[str, Positional, arg(metavar="NAME|TOML")]
    """Name of an embodiment, or path of a TOML file."""
    paper: Flag = False
    """Hold it to the paper's protocol: the whole circle is seen, and never the hand while it touches."""
    mesh_folder: MaybeFolder = None
    """Where meshes may lie, subfolders included; by default what the file says, or beside the URDF."""
    json: Flag = False
    """The findings as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.body import check_embodiment
        from bodyimage_kin.body.file import load_embodiment

        body = load_embodiment(self.file)
        file = Path(self.file) if self.file.endswith(".toml") else None
        found = check_embodiment(body, paper=self.paper, mesh_folder=self.mesh_folder, file=file)
        return _told(body, found, self.json)


@dataclass(frozen=True)
class New(Command):
    """Propose an embodiment of a robot: joints, hand, eye, skin and home, and why each; with a picture beside it.

    What is proposed is the paper's experiment: a hand that is seen in front of the face, and never while it touches.
    The file is a beginning, to be changed by hand. Exit status 1 when something keeps the experiment from working.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin embodiment new robot.urdf --hand left_hand -o my.toml",
        "bodyimage-kin embodiment new robot.urdf --hand tool0 --camera wrist_camera --mesh-folder meshes -o my.toml",
    )

    robot: Annotated[Path, Positional, arg(metavar="URDF")]
    """The robot."""
    hand: Annotated[str, arg(metavar="LINK")]
    """The link that touches."""
    out: Annotated[File, arg(aliases=["-o"])]
    """The TOML file to write; a PNG of the same name is written beside it."""
    camera: Annotated[MaybeName, arg(metavar="LINK")] = None
    """The link that carries the eye; by default the first named after an eye, a camera or a head."""
    skin: Annotated[MaybeName, arg(metavar="LINK")] = None
    """The link that bears the skin; by default the nearest to the eye that is as large as a face."""
    forward: Annotated[tuple[float, float, float] | None, arg(metavar="X Y Z", help_behavior_hint="")] = None
    """Where the robot looks, in its root; by default along x, to the side where the hand moves."""
    mesh_folder: MaybeFolder = None
    """Where meshes may lie, subfolders included; by default beside the URDF."""
    overwrite: Flag = False
    """Replace files that are there."""
    json: Flag = False
    """The findings as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.body import propose
        from bodyimage_kin.errors import BodyImageKinError, InvalidConfig
        from bodyimage_kin.robot import Robot

        if self.out.suffix != ".toml":
            raise InvalidConfig(f"'{self.out}' is no name of an embodiment's file; let it end in .toml")
        free(self.out, self.overwrite)
        try:
            found = propose(
                Robot.from_urdf(self.robot, mesh_folder=self.mesh_folder),
                self.hand,
                camera=self.camera,
                skin=self.skin,
                forward=self.forward,
                name=self.out.stem,
            )
        except BodyImageKinError as problem:
            for remark in getattr(problem, "__notes__", ()):
                print(remark)
            raise
        found.body.save(self.out)
        self._draw(found.body)
        if not self.json:
            for remark in found.remarks:
                print(remark)
            print(f"written to {self.out}; a picture of it to {self.out.with_suffix('.png')}")
        return _told(found.body, found.findings, self.json)

    def _draw(self, body: Body) -> None:
        """A picture ends nothing: a robot whose meshes are not there is proposed all the same."""
        import matplotlib

        from bodyimage_kin import figures
        from bodyimage_kin._files import atomic_path
        from bodyimage_kin.errors import BodyImageKinError

        matplotlib.use("agg")
        try:
            figure = figures.row(
                lambda ax: figures.robot(body, ax=ax),
                lambda ax: figures.robot(body, ax=ax, close=True),
                pictures=True,
            )
        except BodyImageKinError as problem:
            print(f"no picture: {problem}", file=sys.stderr if self.json else sys.stdout)
            return
        with atomic_path(self.out.with_suffix(".png")) as temporary:
            figure.savefig(temporary, dpi=150, format="png")


@dataclass(frozen=True)
class Embodiment(Command):
    """Propose an embodiment of a robot (new), or say what cannot work with one (check)."""

    EXAMPLES: ClassVar[tuple[str, ...]] = (New.EXAMPLES[0], *Check.EXAMPLES)
    ACTIONS: ClassVar[Mapping[str, type[Command]]] = {"new": New, "check": Check}

    action: (
        Annotated[Check, tyro.conf.subcommand("check", prefix_name=False)]
        | Annotated[New, tyro.conf.subcommand("new", prefix_name=False)]
    )

    def __call__(self) -> int:
        """Runs it."""
        return self.action()


def _told(body: Body, found: Sequence[Finding], as_json: bool) -> int:
    wrong = any(finding.level == "error" for finding in found)
    if as_json:
        findings = [dataclasses.asdict(finding) for finding in found]
        print_json({"embodiment": body.name, "fit": not wrong, "findings": findings})
        return int(wrong)
    print(body)
    for finding in found:
        print(finding)
    if not found:
        print("nothing to tell: fit for all")
    return int(wrong)
