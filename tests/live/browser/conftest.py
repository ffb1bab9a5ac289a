"""A real browser that looks at the demo's fleet through a console of this machine."""

import secrets
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect

from journeys.demo import build_topology
from robotapp_testbed import ControlPlane, TestbedError
from robotapp_testbed.browser import LocalConsole, start_console
from robotapp_testbed.browser.axe import get_axe
from robotapp_testbed.browser.chromium import NoBrowserError, open_browser
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines import topology
from robotapp_testbed.processes.process import Process

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
expect.set_options(timeout=30_000)  # the machine may have other work
COUNT_SHIFTS = """
window.shifts = [];
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) {
    const moved = entry.sources.map((source) => source.node).filter((node) => !node?.parentElement?.closest?.('.chips'));
    if (!entry.hadRecentInput) window.shifts.push(...moved.map((node) => `${entry.value} ${node?.outerHTML ?? node?.textContent}`));
  }
}).observe({ type: 'layout-shift', buffered: true });
"""
"""Keeps what moved on a page without the user's doing. Apps of one robot close up when one of them ends."""


@dataclass
class Fleet:
    """Two robots, two edge servers, a cloud machine; operator and scheduler; teleop runs, can-rival waits for can-holder's bus."""

    plane: ControlPlane
    namespace: str
    """That of the apps."""
    telemetry: topology.SimulatedTelemetry
    operator: Process
    scheduler: Process
    console: LocalConsole
    session: str
    """The cookie of an open session of the console."""

    def apply(self, name: str) -> None:
        """Applies one of the examples."""
        self.plane.kubectl("apply", "-n", self.namespace, "-f", str(EXAMPLES / f"{name}.yaml"))

    def wait_for(self, name: str, condition: str, status: str = "True") -> None:
        """Waits until the app has this condition."""
        waits = ("wait", "robotapp", name, f"--for=condition={condition}={status}", "--timeout=90s")
        self.plane.kubectl("-n", self.namespace, *waits)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium; without it the tests are skipped with the sentence that says what to install."""
    with ExitStack() as stack:
        try:
            chromium = stack.enter_context(open_browser())
        except NoBrowserError as error:
            pytest.skip(str(error))
        yield chromium


@pytest.fixture(scope="session")
def axe() -> Path:
    """The script of axe-core."""
    try:
        return get_axe()
    except TestbedError as error:
        pytest.fail(str(error))


@pytest.fixture(scope="module")
def fleet(browser: Browser, installed_plane: ControlPlane) -> Iterator[Fleet]:
    """The demo's fleet, until the module ends. The browser comes first: without it nothing is started."""
    del browser
    nodes = build_topology()
    with ExitStack() as stack:
        stack.callback(topology.remove, installed_plane, nodes)
        topology.apply(installed_plane, nodes)
        telemetry = stack.enter_context(topology.SimulatedTelemetry(installed_plane, nodes))
        operator = product.start_operator(installed_plane, wait=False, sweep_seconds=1, no_leader_election=True)
        stack.callback(operator.stop)
        scheduler = product.start_scheduler(
            installed_plane,
            wait=False,
            sweep_seconds=1,
            insecure_explain=True,
            config_map=product.SCHEDULER_CONFIG,
            last_good_config_map=product.LAST_GOOD_CONFIG,
        )
        stack.callback(scheduler.stop)
        console = start_console(installed_plane, scheduler_url=scheduler.health_url)
        stack.callback(console.process.stop)
        namespace = stack.enter_context(created(installed_plane, f"demo-{secrets.token_hex(2)}"))
        operator.wait_ready()
        scheduler.wait_ready()
        demo = Fleet(installed_plane, namespace, telemetry, operator, scheduler, console, console.open_session())
        demo.apply("teleop")
        demo.apply("can-holder")
        demo.wait_for("can-holder", "Ready")
        demo.apply("can-rival")
        demo.wait_for("teleop", "Ready")
        demo.wait_for("can-rival", "Allocated", "False")
        yield demo


def open_context(browser: Browser, fleet: Fleet, *, width: int = 1280, scheme: str = "light") -> BrowserContext:
    """Returns a browser window of its own with an open session."""
    context = browser.new_context(
        viewport={"width": width, "height": 900},
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="reduce",
        base_url=fleet.console.origin,
    )
    name, _, value = fleet.session.partition("=")
    context.add_cookies([{"name": name, "value": value, "url": fleet.console.origin}])
    context.add_init_script(COUNT_SHIFTS)
    context.set_default_timeout(30_000)
    return context


@pytest.fixture
def page(browser: Browser, fleet: Fleet) -> Iterator[Page]:
    """A page with an open session. What the browser refuses for the policy's sake, and errors of scripts, fail the test."""
    context = open_context(browser, fleet)
    problems: list[str] = []
    tab = context.new_page()
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on("console", lambda message: problems.extend(_read_refusal(message)))
    yield tab
    context.close()
    assert not problems


def _read_refusal(message: ConsoleMessage) -> list[str]:
    return [message.text] if "Content Security Policy" in message.text else []
