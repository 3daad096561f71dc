"""What conformance found: as text, as a page and as JSON."""

from __future__ import annotations

import html
import importlib.metadata
import json
import math
import platform
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from bodyimage_kin._files import write_text
from bodyimage_kin.testing._spec import Case

Status = Literal["passed", "failed", "not offered", "not asked"]

_PACKAGES = ("bodyimage-kin", "hypothesis", "numpy", "torch", "pin", "pytorch-kinematics", "mujoco")
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Conformance: {target}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; }} th, td {{ padding: .3rem .7rem; text-align: left; vertical-align: top; }}
thead th {{ border-bottom: 2px solid #222; }} tbody tr {{ border-bottom: 1px solid #ddd; }}
.passed {{ background: #e3f2e6; }} .failed {{ background: #f9dcd8; font-weight: 600; }}
.not-offered, .not-asked {{ color: #666; font-style: italic; }}
pre {{ background: #f5f5f5; padding: .7rem; overflow-x: auto; }}
</style></head><body>
<h1>Conformance</h1>
<p>{summary}</p>
<p>Errors are relative to max(1, |q|, reach), times the multipliers of followers for every derivative.</p>
<table><thead><tr><th>law</th>{heads}</tr></thead><tbody>{rows}</tbody></table>
{failures}{refused}
<h2>Versions</h2><p>{versions}</p>
</body></html>
"""


@dataclass(frozen=True)
class Failure:
    """One way in which a library breaks a law.

    Attributes:
        detail: What differs, or what is raised.
        count: Number of cases that fail so.
        asked: Number of cases asked.
        case: The smallest one that fails so.
        file: Where it was written, relative to the report.
    """

    detail: str
    count: int
    asked: int
    case: Case
    file: Path | None = None

    def __str__(self) -> str:
        place = f" -> {self.file.as_posix()}" if self.file else ""
        return f"{self.detail} ({self.count} of {self.asked}){place}"


@dataclass(frozen=True)
class Verdict:
    """What one law says of one library.

    Attributes:
        backend: The library's name.
        law: The law's name.
        status: ``"passed"``, ``"failed"``, ``"not offered"`` (by the library), or ``"not asked"``: there was no case in
            which the law has anything to say.
        error: The largest error relative to scale; None when there is none to measure.
        bound: The largest error allowed.
        asked: Number of cases asked.
        detail: What is not offered.
        failures: The ways in which it is broken: wrong numbers, then what is raised.
    """

    backend: str
    law: str
    status: Status
    error: float | None
    bound: float
    asked: int = 0
    detail: str = ""
    failures: tuple[Failure, ...] = ()

    @property
    def cell(self) -> str:
        """The verdict in a table's cell."""
        size = "" if self.error is None else f" {self.error:.1e}"
        raises = "" if (self.error is not None and self.error > self.bound) or not self.failures else " raises"
        return f"{self.status}{size}{raises}"


@dataclass(frozen=True)
class Report:
    """All verdicts; ``str(report)`` is a table of backend x law.

    Attributes:
        target: What was tested on.
        examples: Cases for each library and law (and file).
        verdicts: Library by library.
        refused: Why a file was not read, by name.
        robots: Number of files that were; 0 for random robots.
        named: The laws that were asked for by name; without one, every law is asked that a library and a robot know.
        tolerance: What was allowed beyond rounding (:meth:`Law.within`); 0 for nothing.
    """

    target: str
    examples: int
    verdicts: tuple[Verdict, ...]
    refused: dict[str, str]
    robots: int
    named: tuple[str, ...] = ()
    tolerance: float = 0.0

    @property
    def failures(self) -> tuple[Verdict, ...]:
        """The laws that are broken."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "failed")

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """Why the exit status is 1: all that was named and not asked, or asked and not passed, a line for each."""
        lines = [f"refused {name}: {reason}" for name, reason in self.refused.items()]
        for backend in dict.fromkeys(verdict.backend for verdict in self.verdicts):
            verdicts = [verdict for verdict in self.verdicts if verdict.backend == backend]
            lines += [
                f"{backend}: {verdict.law}: {failure}"
                for verdict in verdicts
                if verdict.status == "failed"
                for failure in verdict.failures
            ]
            if all(verdict.status not in ("passed", "failed") for verdict in verdicts):
                lines.append(f"{backend}: nothing was asked")
            else:
                silent = [verdict for verdict in verdicts if verdict.status.startswith("not ")]
                lines += [f"{backend}: {one.law}: {one.status}" for one in silent if one.law in self.named]
        return tuple(lines)

    @property
    def exit_status(self) -> int:
        """0 only if all that was named (files, libraries, laws) was asked and passed, else 1."""
        return int(bool(self.shortcomings) or not self.verdicts)

    @property
    def summary(self) -> str:
        """What was done and found, in one line."""
        robots = f"{self.robots} robots, {len(self.refused)} refused, " if self.robots or self.refused else ""
        within = f", tolerance {self.tolerance:g}" if self.tolerance else ""
        found = Counter(verdict.status for verdict in self.verdicts)
        said = ", ".join(f"{found[status]} {status}" for status in get_args(Status) if found[status])
        return f"{self.target}: {robots}{self.examples} examples a library and law{within}: {said or 'nothing asked'}"

    def __str__(self) -> str:
        backends = list(dict.fromkeys(verdict.backend for verdict in self.verdicts))
        table = [["law", *backends]] + [[law, *(row[name].cell for name in backends)] for law, row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table
        ]
        lines.insert(1, "  ".join("-" * width for width in widths))
        return "\n".join([*lines, *self.shortcomings, self.summary])

    def to_json(self) -> dict[str, Any]:
        """Everything, as plain data; an error that is infinite is the string ``"inf"``, as JSON has no such number."""
        return {
            "target": self.target,
            "examples": self.examples,
            "tolerance": self.tolerance,
            "laws_named": list(self.named),
            "robots": self.robots,
            "refused": self.refused,
            "exit_status": self.exit_status,
            "shortcomings": list(self.shortcomings),
            "versions": _versions(),
            "verdicts": [
                {
                    "backend": verdict.backend,
                    "law": verdict.law,
                    "status": verdict.status,
                    "error": "inf" if verdict.error is not None and math.isinf(verdict.error) else verdict.error,
                    "bound": verdict.bound,
                    "asked": verdict.asked,
                    "detail": verdict.detail,
                    "failures": [
                        {
                            "detail": failure.detail,
                            "count": failure.count,
                            "asked": failure.asked,
                            "file": failure.file.as_posix() if failure.file else None,
                            "link": failure.case.link,
                            "q": list(failure.case.q),
                        }
                        for failure in verdict.failures
                    ],
                }
                for verdict in self.verdicts
            ],
        }

    def to_html(self) -> str:
        """A page that needs nothing beside it."""
        rows = "".join(
            f"<tr><th>{html.escape(law.replace('_', ' '))}</th>"
            + "".join(
                f'<td class="{verdict.status.replace(" ", "-")}">{html.escape(verdict.cell)}</td>'
                for verdict in row.values()
            )
            + "</tr>"
            for law, row in self._rows()
        )
        failures = "".join(
            f"<h3>{html.escape(verdict.backend)}: {html.escape(verdict.law.replace('_', ' '))}</h3>"
            f"<p>{html.escape(str(failure))}</p><pre>{html.escape(failure.case.to_urdf())}</pre>"
            for verdict in self.failures
            for failure in verdict.failures
        )
        refused = "".join(f"<li>{html.escape(f'{name}: {why}')}</li>" for name, why in self.refused.items())
        return _PAGE.format(
            target=html.escape(self.target),
            summary=html.escape(self.summary),
            heads="".join(f"<th>{html.escape(name)}</th>" for name in dict.fromkeys(v.backend for v in self.verdicts)),
            rows=rows,
            failures=f"<h2>The smallest robots that break a law</h2>{failures}" if failures else "",
            refused=f"<h2>Refused</h2><ul>{refused}</ul>" if refused else "",
            versions=html.escape(", ".join(f"{name} {version}" for name, version in _versions().items())),
        )

    def write(self, folder: Path) -> None:
        """Writes ``report.html`` and ``report.json``."""
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "report.html", self.to_html())
        write_text(folder / "report.json", json.dumps(self.to_json(), indent=1, ensure_ascii=False) + "\n")

    def _rows(self) -> list[tuple[str, dict[str, Verdict]]]:
        """Each law with its verdicts by library."""
        rows: dict[str, dict[str, Verdict]] = {}
        for verdict in self.verdicts:
            rows.setdefault(verdict.law, {})[verdict.backend] = verdict
        return list(rows.items())


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return versions
