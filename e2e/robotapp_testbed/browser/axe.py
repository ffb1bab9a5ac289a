"""axe-core looks for what keeps people from using a page; the pinned release from npm, kept in the cache."""

import hashlib
import io
import os
import tarfile
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from playwright.sync_api import Page

from robotapp_testbed.binaries.cache import cache_home, locked
from robotapp_testbed.failures import TestbedError

VERSION: Final = "4.14.1"
DIGEST: Final = "e6b0ce02b84d892e2e33e403485e7f3d6c29e2be6df65daf44d89ba564139745"
"""SHA-256 of the package."""
REGISTRY: Final = "https://registry.npmjs.org"
_MEMBER: Final = "package/axe.min.js"
_FETCH_S: Final = 30.0
_MOST_BYTES: Final = 8 << 20
SEVERE: Final = frozenset({"serious", "critical"})


@dataclass(frozen=True, slots=True)
class Finding:
    """One rule that a page breaks. `targets` are selectors of the elements."""

    rule: str
    impact: str
    help: str
    targets: tuple[str, ...]

    @property
    def is_severe(self) -> bool:
        return self.impact in SEVERE


def get_axe(env: Mapping[str, str] = os.environ) -> Path:
    """Returns the script, fetched once and checked against its digest. Raises TestbedError."""
    folder = cache_home(env) / "browser"
    script = folder / f"axe-{VERSION}.min.js"
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder / ".axe.lock"):
        if not script.is_file():
            partial = script.with_suffix(".partial")
            partial.write_bytes(unpack(_download(env)))
            partial.replace(script)
    return script


def unpack(package: bytes) -> bytes:
    """Returns the script of the package. Raises TestbedError for a package that is not the pinned one."""
    if hashlib.sha256(package).hexdigest() != DIGEST:
        raise TestbedError(f"axe-core {VERSION} is not what it was when it was pinned: nothing of it is used")
    with tarfile.open(fileobj=io.BytesIO(package), mode="r:gz") as archive:
        member = archive.extractfile(_MEMBER)
        if member is None:
            raise TestbedError(f"axe-core {VERSION} holds no {_MEMBER}")
        return member.read()


def _download(env: Mapping[str, str]) -> bytes:
    registry = (env.get("npm_config_registry") or REGISTRY).rstrip("/")
    url = f"{registry}/axe-core/-/axe-core-{VERSION}.tgz"
    if not url.startswith(("https://", "http://")):
        raise TestbedError(f"npm_config_registry={registry} is no http address: correct or unset it")
    try:
        with urllib.request.urlopen(url, timeout=_FETCH_S) as response:  # noqa: S310 - scheme checked above
            content: bytes = response.read(_MOST_BYTES)
    except OSError as error:
        raise TestbedError(
            f"axe-core cannot be had from {registry} ({error}): try again, or set npm_config_registry"
        ) from error
    return content


def find_barriers(page: Page, script: Path) -> list[Finding]:
    """Returns all rules that the page, as it is now, breaks."""
    page.evaluate(script.read_text())
    result: dict[str, Any] = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        Finding(
            item["id"],
            item["impact"] or "",
            item["help"],
            tuple(str(node["target"][0]) for node in item["nodes"]),
        )
        for item in result["violations"]
    ]
