"""The command ``view``."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Annotated, ClassVar

from tyro.conf import Positional, arg

from bodyimage_kin.cli.arguments import Command, MaybeEmbodiment, MaybeFile, MaybeFolder, MaybeName

__all__ = ["View"]


@dataclass(frozen=True)
class View(Command):
    """Look at a recording, a study or a body in the browser, at an address of this machine alone, until Ctrl-C.

    Sliders go through time and move the joints; shown are the robot, its camera and picture, the skin, the true hand
    and where an estimator thinks it is, the true and the learned Jacobian, and the map that grows. Needs the extra
    [view].
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin view infant",
        "bodyimage-kin view lab.nc --embodiment my.toml",
        "bodyimage-kin view touches.nc --learn-from seen.nc --export scene.html --estimator rational_trig",
    )

    target: Annotated[str, Positional, arg(metavar="[RECORDING|STUDY|EMBODIMENT]")] = "infant"
    """A recording's file, a study's folder, or an embodiment's name or TOML file."""
    embodiment: MaybeEmbodiment = None
    """Whose recording it is; by default what the recording says."""
    learn_from: MaybeFile = None
    """Another recording that estimators learn from; by default the one that is looked at."""
    mesh_folder: MaybeFolder = None
    """Where meshes may lie, subfolders included; by default beside the URDF."""
    next: Annotated[int, arg(metavar="N")] = 0
    """So many postures to go to next, as ghosts beside the robot."""
    port: Annotated[int, arg(metavar="PORT")] = 8080
    """Where the page is; the next free one where it is taken."""
    export: MaybeFile = None
    """Instead of a page that answers, write one that moves by itself into this file."""
    recording: MaybeName = None
    """Of an exported page: which recording; by default the first."""
    estimator: MaybeName = None
    """Of an exported page: whose estimate; by default nobody's."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin import view

        scene = view.open_scene(
            self.target,
            embodiment=self.embodiment,
            learn_from=self.learn_from,
            mesh_folder=self.mesh_folder,
            next_postures=self.next,
        )
        if self.export is not None:
            print(view.export(scene, self.export, self.recording or "", self.estimator or ""))
            return 0
        page = view.serve(scene, self.port)
        print(f"{page.address} (end with Ctrl-C)", flush=True)
        try:
            threading.Event().wait()
        finally:
            page.stop()
        return 0
