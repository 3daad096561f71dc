"""The commands of studies: ``reproduce``, ``study`` and ``report``."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional, arg

from bodyimage_kin.cli.arguments import Command, Flag, Folder, MaybeCount, MaybeFolder, MaybeName
from bodyimage_kin.errors import InvalidConfig

__all__ = ["Report", "Reproduce", "Study"]


@dataclass(frozen=True)
class Reproduce(Command):
    """Reproduce the paper: learn Jacobians on the visible circle, map the unseen face, and hold both against the truth.

    Writes recordings, summary.json, figures (SVG and PNG) and report.html. An interrupted run goes on where it ended.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin reproduce --out reproduction",
        "bodyimage-kin reproduce --out look --quick --embodiment my.toml --mesh-folder meshes",
    )

    out: Folder
    """Folder for the results: new, empty, or of an earlier reproduction."""
    seeds: MaybeCount = None
    """Number of recordings of each motion; by default 10, or 3 when quick."""
    embodiment: Annotated[str, arg(metavar="NAME|TOML")] = "infant"
    """Name of an embodiment, or path of a TOML file."""
    mesh_folder: MaybeFolder = None
    """Where the robot's meshes lie, subfolders included; by default what the file says, or beside the URDF."""
    quick: Flag = False
    """A tenth of the touching time, for a first look."""
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """Address of a Dask scheduler, tcp://..., instead of a pool of processes."""
    workers: MaybeCount = None
    """Number of processes; by default one a core."""

    def __call__(self) -> int:
        """Runs it; what an interrupted run has computed is not computed again."""
        from bodyimage_kin._files import claim
        from bodyimage_kin.published import fuke2007
        from bodyimage_kin.report.fuke2007 import write_reproduction

        begin = time.monotonic()
        seeds = self.seeds if self.seeds is not None else (3 if self.quick else 10)
        study = fuke2007.grid(self.embodiment, seeds, quick=self.quick, mesh_folder=self.mesh_folder)
        # A wrong embodiment, or one unfit for the protocol, is told before any folder is touched.
        study.origin()
        fuke2007.check(self.embodiment, self.mesh_folder)
        folder = claim(self.out, "reproduction", {"embodiment": self.embodiment, "seeds": seeds, "quick": self.quick})
        store = folder / "study"
        results = study.run(store, self.scheduler, workers=self.workers, progress=True)
        summary = fuke2007.judge(results)
        page = write_reproduction(results, summary, store, folder, quick=self.quick)
        fuke2007.write_summary(summary, folder / "summary.json")
        print(f"{page} after {time.monotonic() - begin:.0f} s")
        return 0


@dataclass(frozen=True)
class Study(Command):
    """Work off a study of learned Jacobians; what is there already is not computed again.

    Exit status 1 when a cell failed; the others are kept.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin study mine.toml --out results",
        "bodyimage-kin study --status results --json",
    )

    file: Annotated[Path | None, Positional, arg(metavar="[FILE]", help_behavior_hint="")] = None
    """The study as TOML."""
    out: MaybeFolder = None
    """Folder for its cells and its page."""
    status: MaybeFolder = None
    """Only say how far the study in this folder is."""
    scheduler: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """Address of a Dask scheduler, tcp://..., instead of a pool of processes."""
    workers: MaybeCount = None
    """Number of processes; by default one a core."""
    retry: Flag = False
    """Try cells again that failed before."""
    twice: Flag = False
    """Compute each cell twice, and fail those that come out differently."""
    json: Flag = False
    """With --status: as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        if self.status is not None:
            from bodyimage_kin.cli.status import status_command

            return status_command(self.status, json=self.json)
        if self.file is None or self.out is None:
            raise InvalidConfig("give a study file and --out DIR, or --status DIR")
        from bodyimage_kin.cli import study as commands

        return commands.study_command(
            self.file,
            self.out,
            workers=self.workers,
            scheduler=self.scheduler,
            retry=self.retry,
            twice=self.twice,
        )


@dataclass(frozen=True)
class Report(Command):
    """Write the page of a study that has been worked off.

    Exit status 1 when a cell failed; the page says which.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin report results",
        "bodyimage-kin report results --baseline least_squares --publish paper",
    )

    folder: Annotated[Folder, Positional]
    """The study's folder."""
    baseline: MaybeName = None
    """Estimator that the others are compared with."""
    atlas: MaybeName = None
    """Estimator whose error is drawn taxel by taxel."""
    publish: MaybeFolder = None
    """Folder for results.json, the table (Markdown, LaTeX) and the figure (SVG, PNG, CSV), small enough to be kept."""
    into: MaybeFolder = None
    """Folder for results.nc and report.html; by default the study's."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.cli import study as commands

        return commands.report_command(self.folder, self.baseline, self.atlas, self.publish, self.into)
