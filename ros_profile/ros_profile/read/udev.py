"""udev rules: which devices a package expects, by vendor and product or by subsystem."""

import re
from collections.abc import Iterator

from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import SourceFile
from ros_profile.read.text import decode

MAX_LINES = 5000
# \b: a word is looked at from its beginning alone, not from each of its letters.
_PAIR = re.compile(r'\b(\w+)(?:\{([\w./]+)\})?\s*(==|\+=|=|:=)\s*"([^"]{0,200})"')
_HEX = re.compile(r"^[0-9a-fA-F]{4}$")
_KERNEL = (
    (re.compile(r"^tty"), "tty"),
    (re.compile(r"^video"), "video4linux"),
    (re.compile(r"^js|^event"), "input"),
    (re.compile(r"^v?can"), "net"),
)


def read_udev(data: bytes, file: str) -> SourceFile:
    facts = [
        fact
        for number, line in enumerate(decode(data).split("\n")[:MAX_LINES], start=1)
        if line.strip() and not line.lstrip().startswith("#")
        for fact in _rule(line[:2000], file, number)
    ]
    return SourceFile(file, "udev", tuple(facts))


def _rule(line: str, file: str, number: int) -> Iterator[Fact]:
    """`vid:pid` and the subsystem; the value is the symbolic link or the mode the rule gives."""
    keys: dict[str, str] = {}
    for key, attribute, _, value in _PAIR.findall(line):
        keys.setdefault((attribute or key).lower(), value)
    given = keys.get("symlink") or keys.get("mode", "")
    vendor, product = keys.get("idvendor", ""), keys.get("idproduct", "")
    if _HEX.match(vendor):
        identity = f"{vendor}:{product}" if _HEX.match(product) else f"{vendor}:"
        yield Fact(Kind.UDEV, identity.lower(), given, file, number)
    subsystem = keys.get("subsystem") or keys.get("subsystems", "")
    kernel = keys.get("kernel") or keys.get("kernels", "")
    subsystem = next((name for pattern, name in _KERNEL if pattern.match(kernel)), subsystem)
    if subsystem:
        yield Fact(Kind.UDEV, subsystem, given, file, number)
