"""Tables for a paper: LaTeX with booktabs, every name as text."""

from __future__ import annotations

import re
from collections.abc import Sequence

_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "_": r"\_", "%": r"\%",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$", "|": "$|$",
    "\N{MINUS SIGN}": "$-$", "\N{EN DASH}": "--", "\N{MULTIPLICATION SIGN}": r"$\times$",
}  # fmt: skip
_POWER = re.compile(r"(?<![\w.])(-?\d(?:\.\d+)?)e([+-]\d+)(?!\w)")


def latex_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], label: str) -> str:
    r"""A ``table`` of ``booktabs``: ``\usepackage{booktabs}`` is all it needs.

    Args:
        caption: Of the table.
        head: Of its columns, the first of names.
        rows: Cells; numbers as they are written elsewhere.
        label: Name that the text refers to it by.
    """
    lines = [" & ".join(map(latex, row)) + r" \\" for row in rows]
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{latex(caption)}}}",
            rf"\label{{{re.sub(r'[^A-Za-z0-9:-]+', '-', label)}}}",
            rf"\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
            r"\toprule",
            " & ".join(map(latex, head)) + r" \\",
            r"\midrule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
        ]
    )


def latex(text: str) -> str:
    """Text as LaTeX sets it, with powers of ten as such."""
    parts = []
    end = 0
    for found in _POWER.finditer(text):
        parts.append(_escaped(text[end : found.start()]))
        parts.append(rf"${found[1]} \cdot 10^{{{int(found[2])}}}$")
        end = found.end()
    return "".join([*parts, _escaped(text[end:])])


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in text)
