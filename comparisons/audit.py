"""Holds every number that a page gives as a result against the committed results: ``make audit``.

Behind a number, or several, stands where they are from::

    an error of 0.63 [0.55, 0.68]<!-- result: bodies/results.json#summary.rows.least_squares.{median,lower,upper} -->

The path begins in ``comparisons/``. A key is of an object, the place in a list, or there the entry of that ``name``;
one that holds dots stands in quotes. Braces name several at once: as many numbers before the mark are meant, in order.
``*1000`` behind it changes the unit; of a number followed by ``%`` a hundredth is meant. What is compared is the result
rounded as it is printed. Between ``<!-- begin results -->`` and ``<!-- end results -->`` every number with a decimal
point, and every percentage, must be marked.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_MARK = re.compile(r"<!--\s*result:\s*([^#\s]+)#(.*?)\s*-->", re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.#/-])[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?(?:\s?%)?|(?<![\w.])[-+]?\.\d+(?:\s?%)?")
_MUST = re.compile(r"\.\d|e[-+]?\d|%")
_BETWEEN = re.compile(r"<!-- begin results -->(.*?)<!-- end results -->", re.DOTALL)


@dataclass(frozen=True)
class Mistake:
    """A number that is not what it is said to be.

    Attributes:
        page: Where it stands.
        line: Its line.
        text: What is wrong.
    """

    page: Path
    line: int
    text: str

    def __str__(self) -> str:
        place = self.page.relative_to(ROOT) if self.page.is_relative_to(ROOT) else self.page
        return f"{place}:{self.line}: {self.text}"


def pages() -> list[Path]:
    """The pages that give results."""
    return [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "comparisons").glob("*/README.md")),
    ]


def audited(page: Path) -> tuple[int, list[Mistake]]:
    """How many numbers of a page are marked, and which are wrong, or unmarked where they must not be."""
    text = page.read_text(encoding="utf-8")
    # Code is no claim; as long as it was, so that lines keep their numbers.
    text = re.sub(r"^```.*?^```$", lambda code: re.sub(r"[^\n]", " ", code[0]), text, flags=re.DOTALL | re.MULTILINE)
    found, mistakes, marked = 0, [], set[int]()
    for mark in _MARK.finditer(text):
        line = text.count("\n", 0, mark.start()) + 1
        begin = max((one.end() for one in _MARK.finditer(text, 0, mark.start())), default=0)
        try:
            values = list(results(*mark.groups()))
        except (OSError, LookupError, ValueError, TypeError) as problem:
            mistakes.append(Mistake(page, line, f"no result {mark[1]}#{mark[2]} ({problem})"))
            continue
        numbers = list(_NUMBER.finditer(text, begin, mark.start()))[-len(values) :]
        if len(numbers) < len(values):
            mistakes.append(Mistake(page, line, f"{len(values)} results and {len(numbers)} numbers before {mark[2]}"))
            continue
        for number, value in zip(numbers, values, strict=True):
            found += 1
            marked.add(number.start())
            if (wanted := as_printed(value, number[0])) != number[0]:
                mistakes.append(
                    Mistake(page, line, f"{number[0]} should be {wanted} ({mark[1]}#{mark[2]}: {value:.6g})")
                )
    for block in _BETWEEN.finditer(text):
        bare = re.sub(r"<!--.*?-->|\]\([^)]*\)|`[^`]*`", lambda one: " " * len(one[0]), block[0], flags=re.DOTALL)
        for number in _NUMBER.finditer(bare):
            if _MUST.search(number[0]) and block.start() + number.start() not in marked:
                line = text.count("\n", 0, block.start() + number.start()) + 1
                mistakes.append(
                    Mistake(page, line, f"{number[0]} is not marked: say <!-- result: FILE#KEY --> behind it")
                )
    return found, mistakes


def results(path: str, keys: str) -> Iterator[float]:
    """The numbers that a mark names, in their order."""
    key, _, factor = keys.strip().partition("*")
    before, braces, rest = key.strip().partition("{")
    names = rest.partition("}")[0].split(",") if braces else [""]
    after = rest.partition("}")[2] if braces else ""
    for name in names:
        value: Any = _read(ROOT / "comparisons" / path)
        for part in re.findall(r'"[^"]*"|[^."]+', before + name.strip() + after):
            value = _entry(value, part.strip('"'))
        yield float(value) * float(factor or 1)


def as_printed(value: float, printed: str) -> str:
    """A result, rounded as a number is printed."""
    bare = printed.rstrip("% ")
    value = 100 * value if printed.endswith("%") else value
    if "e" in bare:
        digits = len(bare.partition("e")[0].partition(".")[2])
        mantissa, _, power = f"{value:.{digits}e}".partition("e")
        said = f"{mantissa}e{int(power)}"
    else:
        said = (
            f"{value:,.{len(bare.partition('.')[2])}f}" if "," in bare else f"{value:.{len(bare.partition('.')[2])}f}"
        )
    # Nothing rounds to less than nothing.
    said = said.lstrip("-") if float(said.replace(",", "")) == 0 else said
    said = f"+{said}" if bare.startswith("+") and not said.startswith("-") else said
    said = re.sub(r"^(-?)0\.", r"\1.", said) if re.match(r"-?\.", bare) else said
    return said + printed[len(bare) :]


@lru_cache(maxsize=32)
def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _entry(value: Any, key: str) -> Any:
    if isinstance(value, list) and not key.isdigit():
        return {one["name"]: one for one in value}[key]
    return value[int(key) if isinstance(value, list) else key]


def main() -> None:
    """Audits every page; exit status 1 when a number is wrong."""
    count, mistakes = 0, []
    for page in pages():
        found, wrong = audited(page)
        count += found
        mistakes += wrong
    for mistake in mistakes:
        print(mistake)
    print(f"{count} numbers of {len(pages())} pages held against the committed results: {len(mistakes)} wrong")
    raise SystemExit(bool(mistakes))


if __name__ == "__main__":
    main()
