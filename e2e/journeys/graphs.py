"""`scripts/screenshots --graphs`: the console's graph of each reference application, as it runs on a simulated fleet."""

import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import yaml

from journeys.demo import set_up
from journeys.demo_cluster import NAMESPACE, ROOT, DemoCluster
from journeys.stage import Stage
from robotapp_testbed import ControlPlane, TestbedError
from robotapp_testbed.machines import fleet_file
from robotapp_testbed.processes.process import wait_until

APPS: Final = ROOT / "examples" / "reference"
PICTURE: Final = "console.svg"
"""Name of the picture in the folder of its application."""
_POINTER: Final = " The tables below have the same names and figures."
_HEARD_S: Final = 60.0
_FLEET: Final = ROOT / "examples" / "fleet"
_STYLES: Final = ROOT / "console" / "robotapp_console" / "static" / "console.css"
_GRAPH: Final = re.compile(r'<svg role="img".*?</svg>', re.DOTALL)
_RULE: Final = re.compile(r"^\.(?:graph text|lane|box|part|edge)\b[^{}]*\{[^{}]*\}", re.MULTILINE)
_VARIABLES: Final = re.compile(r"^  --([\w-]+): (.*);$", re.MULTILINE)


def draw_graphs(stage: Stage) -> Iterator[str]:
    """Runs one application after the other, writes its picture and yields a sentence about it. Raises TestbedError."""
    with ExitStack() as stack:
        cluster = stack.enter_context(ControlPlane())
        demo = set_up(stage, cluster, stack, fleet_file.read(_FLEET / "reference.yaml"))
        demo.apply_file("examples/fleet/volumes.yaml")
        session = demo.console.open_session()
        for app in list_apps():
            _run(demo, app)
            graph = _read_graph(demo, app, session)
            (app / PICTURE).write_text(make_picture(graph, app))
            demo.kubectl("delete", "robotapp", app.name, "--timeout=60s")
            yield f"{(app / PICTURE).relative_to(ROOT)} is drawn"


def list_apps() -> list[Path]:
    return sorted(path.parent for path in APPS.glob("*/robotapp.yaml"))


def make_picture(graph: str, app: Path) -> str:
    """Returns a graph of the console's page as a file of its own, with a digest of the spec that it shows."""
    opening, _, rest = graph.partition(">")
    words = f"The console's graph of {app.name} on the simulated fleet examples/fleet/reference.yaml"
    facts = json.dumps({"made by": "scripts/screenshots --graphs", "shows": words, "spec": hash_spec(app)})
    head = f'{opening} xmlns="http://www.w3.org/2000/svg">\n<metadata>{facts}</metadata>\n<style>\n{read_styles()}\n</style>'
    body = rest.removesuffix("</svg>").replace(_POINTER, "")
    text = f'{head}\n<rect width="100%" height="100%" fill="#ffffff"/>\n<g class="graph">{body}</g>\n</svg>\n'
    return re.sub(r"\n\s*\n", "\n", text)


def hash_spec(app: Path) -> str:
    """Returns what differs as soon as the RobotApp asks for something else; the annotations of the bridge do not count."""
    spec = yaml.safe_load((app / "robotapp.yaml").read_text())["spec"]
    return hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()


def read_styles() -> str:
    """Returns the rules of the console's style sheet for graphs, with the colours of its light theme."""
    sheet = _STYLES.read_text()
    light = dict(_VARIABLES.findall(sheet.partition("@media")[0]))
    rules = [rule for rule in _RULE.findall(sheet) if ":hover" not in rule]
    return "\n".join(re.sub(r"var\(--([\w-]+)\)", lambda use: light[use[1]], rule) for rule in rules)


def _read_graph(demo: DemoCluster, app: Path, session: str) -> str:
    """Returns the graph as soon as the console has heard of all nodes and round trips. Raises TestbedError."""
    path = f"/apps/{NAMESPACE}/{app.name}"

    def read() -> str:
        graph = _GRAPH.search(demo.console.read_page(path, session)[1])
        is_whole = graph and 'class="edge' in graph[0] and not re.search(r"without a node| unknown\b", graph[0])
        return graph[0] if graph and is_whole else ""

    if not wait_until(lambda: bool(read()), timeout_s=_HEARD_S):
        raise TestbedError(f"the console's page of {app.name} has no graph whose round trips are all known")
    return read()


def _run(demo: DemoCluster, app: Path) -> None:
    """Applies the files of an application as its README does, and waits until it is Ready and within its budgets."""
    for name in ("claim.yaml", "robotapp.yaml"):
        if (app / name).exists():
            demo.apply_file(str((app / name).relative_to(ROOT)))
    for condition in ("Ready", "BudgetMet"):
        demo.kubectl("wait", "robotapp", app.name, f"--for=condition={condition}", "--timeout=90s")
