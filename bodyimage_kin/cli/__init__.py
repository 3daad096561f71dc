"""The command ``bodyimage-kin``: parse, call the library, print.

Nothing heavy is imported before a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from bodyimage_kin.errors import BodyImageKinError, InvalidConfig

__all__ = ["main"]


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper: learn Jacobians on the visible circle, map the unseen face, and hold both against the truth.

    Writes recordings, summary.json, figures (SVG and PNG) and report.html.
    """

    out: Path
    """Folder for the results: new, empty, or of an earlier reproduction."""
    seeds: int | None = None
    """Number of recordings of each motion; by default 10, or 3 when quick."""
    embodiment: str = "infant"
    """Name of an embodiment, or path of a TOML file."""
    quick: bool = False
    """A tenth of the touching time, for a first look."""
    scheduler: str | None = None
    """Address of a Dask scheduler, tcp://..., instead of a pool of processes."""
    workers: int | None = None
    """Number of processes; by default one a core."""

    def __call__(self) -> int:
        """Runs it; what an interrupted run has computed is not computed again."""
        from bodyimage_kin._files import claim
        from bodyimage_kin.published import fuke2007
        from bodyimage_kin.report.fuke2007 import write_reproduction

        begin = time.monotonic()
        seeds = self.seeds if self.seeds is not None else (3 if self.quick else 10)
        study = fuke2007.grid(self.embodiment, seeds, quick=self.quick)
        # A wrong embodiment, or one unfit for the protocol, is told before any folder is touched.
        study.origin()
        fuke2007.check(self.embodiment)
        folder = claim(self.out, "reproduction", {"embodiment": self.embodiment, "seeds": seeds, "quick": self.quick})
        store = folder / "study"
        results = study.run(store, self.scheduler, workers=self.workers, progress=True)
        summary = fuke2007.judge(results)
        page = write_reproduction(results, summary, store, folder, quick=self.quick)
        fuke2007.write_summary(summary, folder / "summary.json")
        print(f"{page} after {time.monotonic() - begin:.0f} s")
        return 0


@dataclass(frozen=True)
class Conform:
    """Hold kinematics libraries against an analytic oracle, law by law, on random robots or given ones.

    Exit status 0 only if every file, library and law named was asked and passed; every failure is reduced to the
    smallest robot that shows it.
    """

    target: Annotated[str | None, tyro.conf.Positional] = None
    """A URDF, a folder of them, or an installed package that has some; nothing: random robots."""
    backend: tuple[str, ...] = ()
    """Names of backends, or package.module:Class, installed or in the current folder; nothing: all of ours."""
    law: tuple[str, ...] = ()
    """Names of laws; nothing: all that a library offers and a robot knows."""
    examples: int = 100
    """Cases for each library and law."""
    tolerance: float = 0.0
    """Relative error of a library whose values are not exact: 1e-5 for float32, 1e-7 for Jacobians by differences."""
    out: Path | None = None
    """Folder for report.html, report.json and the smallest failing robots."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.testing.conform import conform

        report = conform(
            self.target,
            list(self.backend) or None,
            self.examples,
            self.out,
            laws=self.law or None,
            tolerance=self.tolerance,
            tell=lambda verdict: print(".", end="", flush=True, file=sys.stderr),
        )
        print(file=sys.stderr)
        print(report)
        return report.exit_status


@dataclass(frozen=True)
class Study:
    """Work off a study of learned Jacobians; what is there already is not computed again.

    Exit status 1 when a cell failed; the others are kept.
    """

    file: Annotated[Path | None, tyro.conf.Positional] = None
    """The study as TOML."""
    out: Path | None = None
    """Folder for its cells and its page."""
    status: Path | None = None
    """Only say how far the study in this folder is."""
    scheduler: str | None = None
    """Address of a Dask scheduler, tcp://..., instead of a pool of processes."""
    workers: int | None = None
    """Number of processes; by default one a core."""
    retry: bool = False
    """Try cells again that failed before."""

    def __call__(self) -> int:
        """Runs it."""
        if self.status is not None:
            from bodyimage_kin.cli.status import status_command

            return status_command(self.status)
        if self.file is None or self.out is None:
            raise InvalidConfig("give a study file and --out DIR, or --status DIR")
        from bodyimage_kin.cli import study as commands

        return commands.study_command(
            self.file, self.out, workers=self.workers, scheduler=self.scheduler, retry=self.retry
        )


@dataclass(frozen=True)
class Report:
    """Write the page of a study that has been worked off."""

    folder: Annotated[Path, tyro.conf.Positional]
    """The study's folder."""
    baseline: str | None = None
    """Estimator that the others are compared with."""
    atlas: str | None = None
    """Estimator whose error is drawn taxel by taxel."""
    publish: Path | None = None
    """Folder for results.json, table.md and a figure, small enough to be kept."""
    into: Path | None = None
    """Folder for results.nc and report.html; by default the study's."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.cli import study as commands

        return commands.report_command(self.folder, self.baseline, self.atlas, self.publish, self.into)


@dataclass(frozen=True)
class Fit:
    """Learn a Jacobian from a recording and save it."""

    estimator: Annotated[str, tyro.conf.Positional]
    """Name of an estimator, or package.module:Class."""
    recording: Annotated[Path, tyro.conf.Positional]
    """The recording, NetCDF."""
    out: Path
    """Folder for the learned Jacobian."""
    embodiment: str | None = None
    """For estimators that know the body."""
    seed: int = 0
    """Of whatever is drawn at random."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.cli import study as commands

        return commands.fit_command(
            self.estimator, self.recording, self.out, embodiment=self.embodiment, seed=self.seed
        )


@dataclass(frozen=True)
class Embodiment:
    """Say in seconds what cannot work with an embodiment, before anything is computed.

    Exit status 1 when there is an error; notes are no errors.
    """

    action: Annotated[Literal["check"], tyro.conf.Positional]
    """check: its file, what its eye sees, what its hand reaches, which meshes are missing."""
    file: Annotated[str, tyro.conf.Positional]
    """Name of an embodiment, or path of a TOML file."""
    paper: bool = False
    """Hold it to the paper's protocol: the whole circle is seen, and never the hand while it touches."""
    mesh_folder: Path | None = None
    """Where meshes may lie, subfolders included; by default beside the URDF."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.body.check import check_embodiment
        from bodyimage_kin.body.file import load_embodiment

        body = load_embodiment(self.file)
        found = check_embodiment(body, paper=self.paper, mesh_folder=self.mesh_folder)
        print(body)
        for finding in found:
            print(finding)
        if not found:
            print("nothing to tell: fit for all")
        return int(any(finding.level == "error" for finding in found))


_COMMANDS: dict[str, Callable[..., Any]] = {
    "reproduce": Reproduce,
    "study": Study,
    "report": Report,
    "fit": Fit,
    "conform": Conform,
    "embodiment": Embodiment,
}


def main(arguments: list[str] | None = None) -> int:
    """Entry point; a user's error is one line on standard error and exit status 2."""
    command = tyro.extras.subcommand_cli_from_dict(
        _COMMANDS,
        prog="bodyimage-kin",
        description="Learned kinematics held against the analytic truth.",
        args=arguments,
    )
    try:
        with _ended_by(signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            return int(command())
    except BodyImageKinError as problem:
        print(f"bodyimage-kin: {problem}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as end:
        print("bodyimage-kin: interrupted; what is finished is kept", file=sys.stderr)
        return 128 + (end.number if isinstance(end, _Ended) else signal.SIGINT)


class _Ended(KeyboardInterrupt):
    """A signal asks for the end, as Ctrl-C does."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def _ended_by(*numbers: int) -> Iterator[None]:
    """Lets signals end what runs as Ctrl-C does: what it began is ended too; those that are ignored (nohup) stay so."""

    def end(number: int, frame: object) -> None:
        raise _Ended(number)

    before = {number: signal.getsignal(number) for number in numbers}
    caught = [number for number, how in before.items() if how is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        caught = []
    for number in caught:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in caught:
            signal.signal(number, before[number])
