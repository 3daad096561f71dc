"""The command ``bodyimage-kin``: parse, call the library, print.

Nothing heavy is imported before a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from bodyimage_kin.errors import BodyImageKinError


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

    def __call__(self) -> int:
        """Runs it."""
        from dataclasses import asdict

        from bodyimage_kin import _output
        from bodyimage_kin._progress import progress
        from bodyimage_kin.report.fuke2007 import write_reproduction
        from bodyimage_kin.study import fuke2007

        begin = time.monotonic()
        seeds = self.seeds if self.seeds is not None else (3 if self.quick else 10)
        settings = fuke2007.Settings(self.embodiment, seeds, self.quick)
        # A wrong embodiment is told before any folder is touched.
        fuke2007.check(settings)
        folder = _output.claim(self.out, "reproduction", asdict(settings))
        with progress("motions and seeds") as report:
            cells = fuke2007.run(settings, folder / "recordings", progress=report)
        summary = fuke2007.summarise(settings, cells)
        page = write_reproduction(settings, cells, summary, folder)
        fuke2007.write_summary(summary, folder / "summary.json")
        print(f"{page} after {time.monotonic() - begin:.0f} s")
        return 0


Command = Annotated[Reproduce, tyro.conf.subcommand("reproduce")]


def main(arguments: list[str] | None = None) -> int:
    """Entry point; a user's error is one line on standard error and exit status 2."""
    command = tyro.extras.subcommand_cli_from_dict(
        {"reproduce": Reproduce},
        prog="bodyimage-kin",
        description="Learned kinematics held against the analytic truth.",
        args=arguments,
    )
    try:
        return int(command())
    except BodyImageKinError as problem:
        print(f"bodyimage-kin: {problem}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("bodyimage-kin: interrupted; what is finished is kept", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
