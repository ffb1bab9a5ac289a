"""Flags, and what stops the program with a sentence."""

import asyncio
import contextlib
import os
import re
import signal
import ssl
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from aiohttp import ClientSession, DummyCookieJar
from tests.support.clients import until
from tests.unit.console.guarded_api import ADMIN, GuardedApi

from robotapp_client import LoginError
from robotapp_client.serving.tls import self_signed
from robotapp_console import opening
from robotapp_console.main import find_config_place, main, open_scheduler
from robotapp_console.settings import DEFAULT_PORT, parse


def test_a_free_port_is_the_default_on_this_machine_alone() -> None:
    assert parse(["--local"]).port == 0
    assert parse([]).port == DEFAULT_PORT
    assert parse(["--host", "a", "--host", "b"]).hosts == ("a", "b")


def test_the_schedulers_loader_comes_with_its_screen_and_costs_no_memory_before() -> None:
    program = "import sys, robotapp_console.main; print(*(name.partition('.')[0] for name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not {"robotapp_scheduler", "numpy", "pydantic"} & set(result.stdout.split())


def test_half_a_certificate_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["--tls-cert-file", "x"])
    assert "belong together" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "text"),
    [
        (["--api-server", "http://insecure.example"], "https:// alone"),
        (["--api-server", "https://a.example", "--certificate-authority", "/none"], "/none cannot be loaded"),
        ([], "not running in a pod"),
        (["--local", "--kubeconfig", "/none"], "/none"),
    ],
)
def test_what_cannot_be_used_is_named(
    argv: list[str], text: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("KUBERNETES_SERVICE_HOST", raising=False)
    assert main(argv) == 2
    assert text in capsys.readouterr().err


def test_the_schedulers_configuration_is_that_of_the_chart_or_the_one_named() -> None:
    assert str(find_config_place(parse([]))) == "robotapp-system/robotapp-scheduler"
    assert str(find_config_place(parse(["--scheduler-config=other"]))) == "robotapp-system/other"
    place = find_config_place(parse(["--scheduler-config=ns/other"]))
    assert (place.namespace, place.history, place.last_good) == ("ns", "other-history", "other-last-good")
    for wrong in ("ns/", "/x", "a/b/c", "Name", "<b>"):
        with pytest.raises(LoginError, match="NAMESPACE"):
            find_config_place(parse([f"--scheduler-config={wrong}"]))


def test_tokens_go_to_a_scheduler_that_proves_its_name_or_is_on_this_machine() -> None:
    for url, mode in (("https://127.0.0.1:1", ssl.CERT_NONE), ("https://scheduler.example", ssl.CERT_REQUIRED)):
        tls = ssl.create_default_context()
        open_scheduler(parse([f"--scheduler-url={url}"]), tls)
        assert tls.verify_mode is mode
    tls = ssl.create_default_context()
    open_scheduler(parse(["--scheduler-url=https://scheduler.example", "--scheduler-unverified"]), tls)
    assert tls.verify_mode is ssl.CERT_NONE
    for wrong in ("http://scheduler.example", "scheduler.example", "https://"):
        with pytest.raises(LoginError, match="https://"):
            open_scheduler(parse([f"--scheduler-url={wrong}"]), None)
    with pytest.raises(LoginError, match="cannot be loaded"):
        open_scheduler(parse(["--scheduler-url=https://x.example", "--scheduler-ca=/nowhere"]), None)


def write_kubeconfig(folder: Path, server: str) -> Path:
    """Writes one for ADMIN and returns its path."""
    kubeconfig = folder / "config"
    content = {
        "current-context": "test",
        "contexts": [{"name": "test", "context": {"cluster": "test", "user": "me"}}],
        "clusters": [{"name": "test", "cluster": {"server": server}}],
        "users": [{"name": "me", "user": {"token": ADMIN}}],
    }
    kubeconfig.write_text(yaml.safe_dump(content))
    return kubeconfig


def read_page(home: Path) -> str:
    """Returns the text of the only page in this home, which its user alone may read."""
    (page,) = home.glob("*/open.html")
    assert (page.stat().st_mode & 0o777, page.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    return page.read_text()


def list_files(home: Path) -> list[Path]:
    """Returns what is in this home."""
    return list(home.iterdir())


async def test_the_browser_gets_the_one_time_address_from_a_file_of_the_user_alone(tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    browser = tmp_path / "browser.py"
    browser.write_text("import pathlib, sys\npathlib.Path(sys.argv[1]).write_text(sys.argv[2])\n")
    started = tmp_path / "started"
    environment = os.environ | {"HOME": str(home), "BROWSER": f"{sys.executable} {browser} {started} %s"}
    async with GuardedApi() as api:
        kubeconfig = write_kubeconfig(tmp_path, api.endpoint.server)
        command = [sys.executable, "-m", "robotapp_console", "--local", f"--kubeconfig={kubeconfig}"]
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE, env=environment)
        assert process.stdout is not None
        try:
            async with asyncio.timeout(30):
                printed = (await process.stdout.readline() + await process.stdout.readline()).decode()
                await until(lambda: started.exists() and started.read_text() != "", what="browser")
                assert started.read_text().startswith(f"file://{home}/")
                address = re.search(r'content="0; url=(http://127\.0\.0\.1:\d+/open\?pass=[\w-]+)"', read_page(home))
                assert address is not None
                assert address[1] in printed
                async with (
                    ClientSession(cookie_jar=DummyCookieJar()) as http,
                    http.get(address[1], allow_redirects=False) as answer,
                ):
                    assert answer.status == 303
                assert not list_files(home)
                process.send_signal(signal.SIGINT)
                assert await process.wait() == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)


def test_a_browser_that_never_comes_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(opening.webbrowser, "open", lambda _: False)
    page = opening.OpeningPage()
    page.show("http://127.0.0.1:1/open?pass=a&b")
    assert "pass=a&amp;b" in read_page(tmp_path)
    page.remove()
    page.remove()
    assert not list_files(tmp_path)


async def test_the_local_console_prints_its_address_serves_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    async with GuardedApi() as api:
        kubeconfig = write_kubeconfig(tmp_path, api.endpoint.server)
        command = [sys.executable, "-m", "robotapp_console", "--local", "--no-browser", f"--kubeconfig={kubeconfig}"]
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        assert process.stdout is not None
        try:
            async with asyncio.timeout(30):
                first, second = await process.stdout.readline(), await process.stdout.readline()
                assert b"as admin. Ctrl-C ends it." in first
                address = re.search(r"http://127\.0\.0\.1:\d+/open\?pass=\S+", second.decode())
                assert address is not None
                async with ClientSession(cookie_jar=DummyCookieJar()) as http:
                    async with http.get(address[0], allow_redirects=False) as answer:
                        assert answer.status == 303
                        cookie = answer.headers["Set-Cookie"].partition(";")[0]
                    base = address[0].partition("/open")[0]
                    async with http.get(base, headers={"Cookie": cookie, "Accept": "text/html"}) as answer:
                        assert "No robot yet" in await answer.text()
                    process.send_signal(signal.SIGINT)
                    assert await process.wait() == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)


async def test_the_console_of_a_cluster_serves_tls(tmp_path: Path) -> None:
    authority = tmp_path / "ca.crt"
    authority.write_bytes(self_signed(("localhost",))[0])
    flags = [
        "--api-server=https://127.0.0.1:1",
        f"--certificate-authority={authority}",
        "--listen=127.0.0.1",
        "--port=0",
    ]
    command = [sys.executable, "-m", "robotapp_console", *flags]
    process = await asyncio.create_subprocess_exec(*command, stderr=asyncio.subprocess.PIPE)
    assert process.stderr is not None
    try:
        async with asyncio.timeout(30):
            port = re.search(r"serving on 127\.0\.0\.1 port (\d+)", (await process.stderr.readline()).decode())
            assert port is not None
            async with ClientSession() as http, http.get(f"https://127.0.0.1:{port[1]}/login", ssl=False) as answer:
                assert answer.status == 200
                assert "Sign in" in await answer.text()
            process.send_signal(signal.SIGTERM)
            assert await process.wait() == 0
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)


async def test_a_cluster_that_cannot_be_used_is_told_at_once(tmp_path: Path) -> None:
    kubeconfig = tmp_path / "config"
    kubeconfig.write_text(
        yaml.safe_dump(
            {
                "current-context": "test",
                "contexts": [{"name": "test", "context": {"cluster": "test"}}],
                "clusters": [{"name": "test", "cluster": {"server": "http://127.0.0.1:1"}}],
            }
        )
    )
    command = [sys.executable, "-m", "robotapp_console", "--local", "--no-browser", f"--kubeconfig={kubeconfig}"]
    process = await asyncio.create_subprocess_exec(
        *command, stderr=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    async with asyncio.timeout(30):
        _, errors = await process.communicate()
    assert process.returncode == 2
    assert b"http://127.0.0.1:1 cannot be used" in errors
    assert b"Traceback" not in errors
