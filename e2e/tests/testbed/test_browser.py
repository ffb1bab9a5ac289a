"""The browser of the tests: found or said to be missing, its tools checked, the console's addresses read."""

import io
import os
import shutil
import tarfile
from pathlib import Path

import pytest

from robotapp_testbed import Process, TestbedError
from robotapp_testbed.browser import LocalConsole, axe, chromium
from robotapp_testbed.browser.chromium import NoBrowserError


def pack(name: str, content: bytes) -> bytes:
    """Returns a package of npm with one file."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        member = tarfile.TarInfo(name)
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    return stream.getvalue()


def test_a_package_that_is_not_the_pinned_one_is_not_used() -> None:
    with pytest.raises(TestbedError, match="nothing of it is used"):
        axe.unpack(pack("package/axe.min.js", b"window.axe = 1"))


def test_the_script_of_the_pinned_package_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    package = pack("package/axe.min.js", b"window.axe = 1")
    monkeypatch.setattr(axe, "DIGEST", axe.hashlib.sha256(package).hexdigest())
    assert axe.unpack(package) == b"window.axe = 1"


def test_a_registry_that_is_no_http_address_is_refused(tmp_path: Path) -> None:
    environment = {"XDG_CACHE_HOME": str(tmp_path), "npm_config_registry": "file:///tmp"}
    with pytest.raises(TestbedError, match="npm_config_registry=file:///tmp is no http address"):
        axe.get_axe(environment)


def test_a_script_in_the_cache_is_not_fetched_again(tmp_path: Path) -> None:
    environment = {"XDG_CACHE_HOME": str(tmp_path), "npm_config_registry": "http://127.0.0.1:9"}
    script = tmp_path / "robotapp" / "browser" / f"axe-{axe.VERSION}.min.js"
    script.parent.mkdir(parents=True)
    script.write_text("window.axe = 1")
    assert axe.get_axe(environment) == script


def test_without_root_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(NoBrowserError, match=r"apt-get install --no-install-recommends chromium-headless-shell"):
        chromium.get_chromium(("no-such-browser",))


def test_without_apt_root_is_told_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(NoBrowserError, match="Chromium, which is not installed"):
        chromium.get_chromium()


def test_the_newest_address_of_a_console_counts(tmp_path: Path) -> None:
    log = tmp_path / "console.log"
    console = LocalConsole(Process("console", ["/bin/true"], run_dir=tmp_path, log_path=log), 8080)
    with pytest.raises(TestbedError, match="printed no address"):
        _ = console.address
    log.write_text(
        "The console of https://127.0.0.1:6443, as admin. Ctrl-C ends it.\n"
        "Open, once: http://127.0.0.1:8080/open?pass=one\nFor another browser, once: http://127.0.0.1:8080/open?pass=two\n"
    )
    assert console.address == "http://127.0.0.1:8080/open?pass=two"
