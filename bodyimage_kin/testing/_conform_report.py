"""What conformance found: as text, as a page and as JSON."""

from __future__ import annotations

import html
import importlib.metadata
import json
import math
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from bodyimage_kin._files import write_text
from bodyimage_kin.testing._spec import Case

Status = Literal["passed", "failed", "not offered"]

_PACKAGES = ("bodyimage-kin", "hypothesis", "numpy", "torch", "pin", "pytorch-kinematics", "mujoco", "yourdfpy")
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Conformance: {target}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; }} th, td {{ padding: .3rem .7rem; text-align: left; vertical-align: top; }}
thead th {{ border-bottom: 2px solid #222; }} tbody tr {{ border-bottom: 1px solid #ddd; }}
.passed {{ background: #e3f2e6; }} .failed {{ background: #f9dcd8; font-weight: 600; }}
.not-offered {{ color: #666; font-style: italic; }} pre {{ background: #f5f5f5; padding: .7rem; overflow-x: auto; }}
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
        status: ``"passed"``, ``"failed"`` or ``"not offered"``.
        error: The largest error relative to scale; None when there is none to measure.
        bound: The largest error allowed.
        detail: What is not offered.
        failures: The ways in which it is broken: wrong numbers, then what is raised.
    """

    backend: str
    law: str
    status: Status
    error: float | None
    bound: float
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
    """

    target: str
    examples: int
    verdicts: tuple[Verdict, ...]
    refused: dict[str, str]
    robots: int

    @property
    def failures(self) -> tuple[Verdict, ...]:
        """The laws that are broken."""
        return tuple(verdict for verdict in self.verdicts if verdict.status == "failed")

    @property
    def exit_status(self) -> int:
        """0 when no law is broken and something was tested, else 1."""
        nothing = not any(verdict.status == "passed" for verdict in self.verdicts)
        return int(bool(self.failures) or nothing or (bool(self.refused) and not self.robots))

    @property
    def summary(self) -> str:
        """What was done and found, in one line."""
        robots = f"{self.robots} robots, {len(self.refused)} refused, " if self.robots or self.refused else ""
        return (
            f"{self.target}: {robots}{self.examples} examples a library and law, "
            f"{len(self.failures)} of {len(self.verdicts)} broken"
        )

    def __str__(self) -> str:
        backends = list(dict.fromkeys(verdict.backend for verdict in self.verdicts))
        table = [["law", *backends]] + [[law, *(row[name].cell for name in backends)] for law, row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table
        ]
        lines.insert(1, "  ".join("-" * width for width in widths))
        for verdict in self.failures:
            lines += [f"{verdict.backend}: {verdict.law}: {failure}" for failure in verdict.failures]
        lines += [f"refused {name}: {reason}" for name, reason in self.refused.items()]
        return "\n".join([*lines, self.summary])

    def to_json(self) -> dict[str, Any]:
        """Everything, as plain data; an error that is infinite is the string ``"inf"``, as JSON has no such number."""
        return {
            "target": self.target,
            "examples": self.examples,
            "robots": self.robots,
            "refused": self.refused,
            "exit_status": self.exit_status,
            "versions": _versions(),
            "verdicts": [
                {
                    "backend": verdict.backend,
                    "law": verdict.law,
                    "status": verdict.status,
                    "error": "inf" if verdict.error is not None and math.isinf(verdict.error) else verdict.error,
                    "bound": verdict.bound,
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
