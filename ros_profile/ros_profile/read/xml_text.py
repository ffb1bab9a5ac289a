"""XML within bounds: no DOCTYPE, no entities, no network, limited depth. For package.xml, launch files, URDF, plug-ins."""

from dataclasses import dataclass
from typing import Any, Final
from xml.etree.ElementTree import ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser
from lxml import etree

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 100
MAX_ELEMENTS: Final = 50_000


class _RefusedError(Exception):
    """The document is deeper or larger than we read."""


class _Bounds:
    """Target of the first pass: counts instead of building a tree."""

    def __init__(self) -> None:
        self.depth = self.elements = 0

    def start(self, _tag: str, _attributes: dict[str, str]) -> None:
        self.depth += 1
        self.elements += 1
        if self.depth > MAX_DEPTH or self.elements > MAX_ELEMENTS:
            raise _RefusedError(f"more than {MAX_DEPTH} levels or {MAX_ELEMENTS} elements")

    def end(self, _tag: str) -> None:
        self.depth -= 1

    def data(self, _text: str) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Why a document was not read."""

    message: str
    line: int = 0


def refusal(data: bytes, *, most: int = MAX_BYTES) -> Unreadable | None:
    """Why these bytes must not be handed to any XML parser with features; None when they may. Plain syntax errors pass:
    the second parser judges them.
    """
    if len(data) > most:
        return Unreadable(f"has {len(data)} bytes; at most {most} are read")
    parser = DefusedXMLParser(target=_Bounds(), forbid_dtd=True)
    try:
        parser.feed(data)
        parser.close()
    except DefusedXmlException:
        return Unreadable("has a DOCTYPE or entities; remove them, ROS files need none")
    except _RefusedError as error:
        return Unreadable(str(error))
    except (ParseError, ValueError, LookupError):
        return None
    return None


def parse(data: bytes, *, most: int = MAX_BYTES) -> Any | Unreadable:
    """The root element (lxml), or why there is none. Slips of syntax are mended as far as lxml can."""
    if refused := refusal(data, most=most):
        return refused
    try:
        root = etree.fromstring(_move_leading_lines(data), _make_parser(recover=True))
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        return Unreadable(f"is not XML: {str(error)[:200]}", getattr(error, "lineno", 0) or 0)
    if root is None:
        return Unreadable("is not XML")
    if root.getroottree().docinfo.doctype:
        return Unreadable("has a DOCTYPE or entities; remove them, ROS files need none")
    return root


def find_slip(data: bytes) -> Unreadable | None:
    """Returns the first slip of syntax of a document that parse() reads as far as it goes; None for one without."""
    try:
        etree.fromstring(_move_leading_lines(data), _make_parser(recover=False))
    except etree.XMLSyntaxError as error:
        text = f"is not well-formed XML and is read as far as it goes ({error.msg[:200]}); correct it, and import again"
        return Unreadable(text, error.lineno or 0)
    return None


def _make_parser(*, recover: bool) -> etree.XMLParser:
    return etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        recover=recover,
        remove_comments=True,
        remove_pis=True,
    )


def _move_leading_lines(data: bytes) -> bytes:
    """Returns the text with the empty lines before its XML declaration behind it: none may precede it, and the lines still count."""
    text = data.lstrip()
    end = text.find(b"?>") + len(b"?>")
    if not text.startswith(b"<?xml") or end < len(b"?>"):
        return data
    lines = data[: len(data) - len(text)].count(b"\n")
    return text[:end] + b"\n" * lines + text[end:]


def tag_of(element: Any) -> str:
    """The name of an element without its namespace; empty for what is no element."""
    return str(element.tag).rpartition("}")[2] if isinstance(element.tag, str) else ""


def attribute(element: Any, *names: str) -> str:
    """The first of these attributes that is there, stripped; empty when none is."""
    for name in names:
        value = element.get(name)
        if value is not None:
            return str(value).strip()
    return ""


def line_of(element: Any) -> int:
    return int(element.sourceline or 0)
