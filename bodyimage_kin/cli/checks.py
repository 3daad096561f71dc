"""The command that holds kinematics libraries against what is known: ``conform``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, ClassVar

from tyro.conf import Positional, arg

from bodyimage_kin.cli.arguments import Command, Flag, MaybeFolder, Names, print_json

__all__ = ["Conform"]


@dataclass(frozen=True)
class Conform(Command):
    """Hold kinematics libraries against an analytic oracle, law by law, on random robots or given ones.

    Exit status 0 only if every file, library and law named was asked and passed, else 1; every failure is reduced to
    the smallest robot that shows it.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin conform",
        "bodyimage-kin conform robots/ --backend my_library:MyKinematics --out verdict",
    )

    target: Annotated[str | None, Positional, arg(metavar="[TARGET]", help_behavior_hint="")] = None
    """A URDF, a folder of them, or an installed package that has some; nothing: random robots."""
    backend: Names = ()
    """Names of backends, or package.module:Class, installed or in the current folder; nothing: all of ours."""
    law: Names = ()
    """Names of laws; nothing: all that a library offers and a robot knows."""
    examples: Annotated[int, arg(metavar="N")] = 100
    """Cases for each library and law."""
    tolerance: Annotated[float, arg(metavar="X")] = 0.0
    """Relative error of a library whose values are not exact: 1e-5 for float32, 1e-7 for Jacobians by differences."""
    out: MaybeFolder = None
    """Folder for report.html, report.json and the smallest failing robots."""
    json: Flag = False
    """The verdicts as JSON, for a machine."""

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
        if self.json:
            print_json(report.to_json())
        else:
            print(report)
        return report.exit_status
