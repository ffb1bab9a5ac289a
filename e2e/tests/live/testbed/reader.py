"""Somebody who types the lines of a page, and the clusters that these lines start."""

import http.cookiejar
import os
import re
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from campaigns.nodes.walkthrough import Command, File, not_seen, steps
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.processes.detached import Cluster

EXAMPLES = Path(__file__).parents[4] / "examples"
DOWN = "python -m robotapp_testbed down"
CONSOLE = "kubectl robotapp console"


class Shell:
    """The command line with a cache of its own for the state of clusters; the binaries are those of this machine."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "robotapp" / "clusters"
        binaries = folder / "binaries"
        binaries.mkdir()
        for name, path in ControlPlane().get_binaries().items():
            (binaries / name).symlink_to(path)
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        own = {"XDG_CACHE_HOME": str(folder), "ROBOTAPP_ASSETS": str(binaries), "TMPDIR": str(self.temporary)}
        self.env = {**os.environ, **own}

    def run(self, *args: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "robotapp_testbed", *args]
        return subprocess.run(command, env=self.env, capture_output=True, text=True, check=False, timeout=240)

    def cluster(self, name: str = "default") -> Cluster:
        return Cluster(name, root=self.root)


ENTERED = ("bash scripts/environment", ". .venv/bin/activate", 'eval "$(python -m robotapp_testbed env)"')
"""What these tests have done already, or do before every line."""


class Reader:
    """Somebody who types the lines of a page in a folder of their own, beside the examples."""

    def __init__(self, shell: Shell, folder: Path) -> None:
        self.folder = folder
        self.env = {**shell.env, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "LC_ALL": "C.UTF-8"}
        folder.mkdir()
        (folder / "examples").symlink_to(EXAMPLES)

    def types(self, line: str) -> str:
        script = ["/bin/sh", "-c", f'eval "$(python -m robotapp_testbed env 2>/dev/null)"; {line}']
        done = subprocess.run(script, env=self.env, cwd=self.folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
        return done.stdout

    def follows(self, page: str) -> None:
        """Every line but `down`, each with what the page shows below it."""
        for step in steps(page):
            if isinstance(step, File):
                (self.folder / step.name).write_text(step.text)
            elif step.line not in (*ENTERED, DOWN):
                self.sees(step)

    def sees(self, step: Command) -> None:
        """Looks again for a while: what a status shows comes a moment after the condition that was waited for."""
        output = self.types(step.line)
        looks = re.match(r"kubectl (get|robotapp) ", step.line)
        assert not not_seen(step.shown, output) or (
            looks and wait_until(lambda: not not_seen(step.shown, self.types(step.line)), timeout_s=30)
        ), (step.line, output)

    @contextmanager
    def console(self, line: str) -> Iterator[str]:
        """Runs the console as the page does and yields the address that it prints, until it is ended."""
        script = f'eval "$(python -m robotapp_testbed env 2>/dev/null)"; exec {line} --no-browser'
        with subprocess.Popen(
            ["/bin/sh", "-c", script], env=self.env, cwd=self.folder, stdout=subprocess.PIPE, text=True
        ) as process:
            try:
                assert process.stdout is not None
                addresses = (re.search(r"http://127\S+", printed) for printed in process.stdout)
                yield next(address[0] for address in addresses if address)
            finally:
                process.terminate()

    def open_browser(self, address: str) -> Callable[[str], str]:
        """Opens the address that the console has printed, and returns what reads its pages with the cookie from there."""
        cookies = urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar())
        browser = urllib.request.build_opener(urllib.request.ProxyHandler({}), cookies)
        browser.open(address).close()

        def read(path: str) -> str:
            with browser.open(urllib.parse.urljoin(address, path)) as answer:
                return str(answer.read().decode())

        return read
