"""Files that browsers keep: pinned where they are of others, small and strict where they are ours."""

import hashlib
import re
from pathlib import Path

import robotapp_console

STATIC = Path(robotapp_console.__file__).parent / "static"
VENDORED = {
    # npm htmx.org 4.0.1, dist/htmx.min.js and dist/ext/hx-sse.min.js, 0BSD
    "htmx.min.js": "a0abb04f2f45a1f89d1d4844023245537e5e6014c87b144553e0607b4cc32130",
    "hx-sse.min.js": "18ef2761356ec1fe0bb6d92612315b37517a7c1e9856b661c5ae81fef239d103",
}


def test_files_of_others_are_those_that_were_published() -> None:
    folder = STATIC / "vendor"
    assert {path.name for path in folder.iterdir()} == {*VENDORED, "LICENSE"}
    for name, checksum in VENDORED.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == checksum
    assert (folder / "LICENSE").read_text().startswith("Zero-Clause BSD")


def test_the_one_style_sheet_is_short_and_takes_nothing_from_elsewhere() -> None:
    (sheet,) = STATIC.rglob("*.css")
    text = sheet.read_text()
    assert text.count("\n") <= 400
    assert "url(" not in text
    assert "@import" not in text
    assert "prefers-color-scheme: dark" in text
    assert ":focus-visible" in text


def test_every_colour_of_the_style_sheet_is_a_property_of_both_schemes() -> None:
    text = (STATIC / "console.css").read_text()
    head, _, rest = text.partition("* { box-sizing")
    light, _, dark = head.partition("@media")
    names = set(re.findall(r"(--[a-z0-9-]+):\s*#", light))
    assert names == set(re.findall(r"(--[a-z0-9-]+):\s*#", dark))
    assert not re.findall(r"#[0-9a-f]{3,8}\b", rest)
    assert set(re.findall(r"var\((--[a-z0-9-]+)\)", text)) <= set(re.findall(r"(--[a-z0-9-]+):", light))
    assert names <= set(re.findall(r"var\((--[a-z0-9-]+)\)", text))


def test_our_script_reaches_no_other_site_and_makes_no_code() -> None:
    text = (STATIC / "console.js").read_text()
    for word in ("http:", "https:", "eval(", "Function(", "innerHTML", "insertAdjacentHTML", "document.write"):
        assert word not in text


def test_the_extension_of_htmx_is_there_before_htmx_begins() -> None:
    """A deferred htmx begins in a timer, which may be before a script that arrives later: the page would not follow anything."""
    page = (STATIC.parent / "templates" / "base.html").read_text()
    scripts = re.findall(r"<script src=[^>]*vendor/[^>]*>", page)
    assert [re.sub(r".*vendor/([\w.-]+)'.*", r"\1", script) for script in scripts] == ["htmx.min.js", "hx-sse.min.js"]
    assert not [script for script in scripts if "defer" in script or "async" in script or "module" in script]
