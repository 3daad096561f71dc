"""Text of any origin as bytes, and bytes in any encoding as text."""

from __future__ import annotations

import codecs
import re
from typing import Final

from bodyimage_kin.errors import InvalidURDF
from bodyimage_kin.robot._wording import Notes, quote

SPACE: Final = " \t\r\n"
_CODECS: Final = {
    **dict.fromkeys(("utf-8", "utf8"), "utf-8"),
    **dict.fromkeys(("us-ascii", "ascii"), "ascii"),
    **dict.fromkeys(("iso-8859-1", "iso8859-1", "latin-1", "latin1"), "iso-8859-1"),
    **dict.fromkeys(("windows-1252", "cp1252"), "cp1252"),
    **{name: name for name in ("utf-16", "utf-16le", "utf-16be")},
}
"""Declared encodings that are read. Python knows more, some of which are no character sets at all."""
_MARKS: Final = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16le"), (codecs.BOM_UTF16_BE, "utf-16be"))
_DECLARATION: Final = re.compile(r"<\?xml\s[^>]*?\bencoding\s*=\s*[\"']([^\"'>]*)[\"']")


def is_xml(data: bytes) -> bool:
    """Whether bytes begin as XML does, blanks and a byte order mark aside; else they may be a path."""
    codec, mark = _codec(data)
    return data[len(mark) : 4096].decode(codec, errors="ignore").lstrip(SPACE).startswith("<")


def encode(text: str) -> bytes:
    """A text as the bytes that are read back as the same text, those of its file if it declares its encoding.

    Raises:
        InvalidURDF: It has lone surrogates, which no encoding has.
    """
    declared = _CODECS.get(_declared(text).lower(), "utf-8")
    try:
        return text.encode(declared)
    except UnicodeEncodeError:
        pass
    try:
        return codecs.BOM_UTF8 + text.lstrip("\ufeff").encode()
    except UnicodeEncodeError as problem:
        line = text.count("\n", 0, problem.start) + 1
        raise InvalidURDF("the text has half a character (a lone surrogate)", line=line, remedy="mend it") from None


def decode(data: bytes, notes: Notes) -> tuple[str, int]:
    """The text of a file without byte order mark and leading blanks, and how many lines those blanks were.

    Raises:
        InvalidURDF: An encoding that is not read, or bytes that are not in it.
    """
    codec, mark = _codec(data)
    declared = _declared(data[len(mark) : 1024].decode(codec, errors="ignore"))
    wide = codec.startswith("utf-16")
    if declared:
        known = _CODECS.get(declared.lower())
        if known is None and not mark:
            remedy = "save the file as UTF-8 and declare that"
            raise InvalidURDF(f"the declared encoding {quote(declared)} is not read here", line=1, remedy=remedy)
        if known is not None and known.startswith("utf-16") and not wide and not mark:
            problem = f"the declared encoding {quote(declared)} is not that of the file"
            raise InvalidURDF(problem, line=1, remedy="declare the encoding that the file has")
        if wide or mark:
            if known is None or known[:6] != codec[:6]:
                problem = f"the declared encoding {quote(declared)} is not that of the file"
                notes.allow(problem, f"read as {codec}", line=1, remedy="declare the encoding that the file has")
        elif known is not None:
            codec = known
    try:
        text = data[len(mark) :].decode(codec)
    except UnicodeDecodeError as problem:
        line = data.count(b"\n", 0, problem.start) + 1
        remedy = "save the file as UTF-8, or declare its encoding"
        raise InvalidURDF(f"not text in {codec}: {problem.reason}", line=line, remedy=remedy) from None
    stripped = text.lstrip(SPACE + "\ufeff")
    blank = text[: len(text) - len(stripped)]
    if blank.strip("\ufeff") and stripped.startswith("<?xml"):
        notes.allow("blanks before <?xml", "read without them", line=1, remedy="let the file begin with <?xml")
    return stripped, blank.count("\n")


def _codec(data: bytes) -> tuple[str, bytes]:
    """The encoding that the first bytes show, and the byte order mark; of all one-byte encodings UTF-8."""
    for mark, codec in _MARKS:
        if data.startswith(mark):
            return codec, mark
    # XML begins with a character of ASCII: in UTF-16 one of its bytes is zero.
    if data[:1] == b"\0" and data[1:2].strip(b"\0"):
        return "utf-16be", b""
    if data[1:2] == b"\0" and data[:1].strip(b"\0"):
        return "utf-16le", b""
    return "utf-8", b""


def _declared(text: str) -> str:
    found = _DECLARATION.match(text.lstrip(SPACE + "\ufeff"))
    return found[1] if found else ""
