"""The plugin in the documentation is run as printed."""

import ast
import io
import json
import re
from pathlib import Path
from typing import Any

import pytest
from tests.support.scheduling import Clock, make_cluster, make_info, make_node

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework import interface
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.framework.validation import HOOKS, KINDS
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation import bench_command

ATTRIBUTES = {"name", "Args", "sound"}
"""Class attributes whose type is not checked with the others."""
MANUAL = Path(__file__).parents[4] / "docs" / "how-to" / "write-a-plugin.md"


def examples() -> tuple[str, str]:
    first, second = re.findall(r"```python\n(.*?)```", MANUAL.read_text(), flags=re.DOTALL)
    return first, second


def test_the_plugin_of_the_manual_filters_and_decides() -> None:
    source, _ = examples()
    space: dict[str, Any] = {}
    exec(source, space)  # noqa: S102 - our own documentation
    lines = [line for line in source.split("class ", 1)[1].splitlines() if line.strip()]
    assert len(lines) <= 12
    clock = Clock()
    cluster = make_cluster(
        make_node("busy", cpu="1"), make_node("small", cpu="4"), make_node("large", cpu="16"), clock=clock
    )
    enabled = PluginSet(enabled=(PluginRef("QuietNodes", 100),))
    spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": enabled})
    core = SchedulerCore(cluster, build_profiles([spec], catalogue({"QuietNodes": space["QuietNodes"]})), clock=clock)
    assert core.schedule_one(make_info("p")).node == "large"
    cluster.remove_node("small")
    cluster.remove_node("large")
    assert core.schedule_one(make_info("q")).message.startswith("0/1 nodes are available: 1 node(s) were too busy.")


def test_the_interface_has_the_example_of_the_manual() -> None:
    source, _ = examples()
    assert [line.strip() for line in source.splitlines() if line.strip()] == [
        line.strip()
        for line in re.split(r"useful one:|Hooks, in", str(interface.__doc__))[1].splitlines()
        if line.strip()
    ]


def test_the_two_tables_of_the_manual_name_every_hook_and_attribute_once() -> None:
    _, _, tables = MANUAL.read_text().partition("## The plugin interface")
    tables, _, _ = tables.partition("## When a plugin fails")
    first_cells = re.findall(r"^\| (`.*?) \|", tables, flags=re.MULTILINE)
    named = [name for cell in first_cells for name in re.findall(r"`(\w+)", cell)]
    assert sorted(named) == sorted({*HOOKS, *KINDS, *ATTRIBUTES})


def test_what_an_author_imports_is_fifteen_names_at_most() -> None:
    tree = ast.parse(Path(interface.__file__).read_text())
    names = [
        node.name
        if isinstance(node, ast.ClassDef | ast.FunctionDef)
        else ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
        for node in tree.body
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.Assign | ast.AnnAssign)
    ]
    assert len(names) <= 15, names


def test_the_fact_of_the_manual_repairs_results_and_wakes_pods() -> None:
    space: dict[str, Any] = {}
    exec(examples()[1], space)  # noqa: S102 - our own documentation
    plugin, clock = space["LowNoise"], Clock()
    cluster = make_cluster(make_node("n0", annotations={"lab.example/noise-db": "80"}), clock=clock)
    spec = ProfileSpec(SCHEDULER_NAME, plugins={"multiPoint": PluginSet(enabled=(PluginRef("LowNoise"),))})
    core = SchedulerCore(cluster, build_profiles([spec], catalogue({"LowNoise": plugin})), clock=clock)
    assert core.schedule_one(make_info("p")).rejected_by == {"LowNoise"}
    for noise_db, placed in (("70", False), ("50", True)):
        node = make_node("n0", annotations={"lab.example/noise-db": noise_db})
        event = Event("nodes", cluster.apply_node(node), None, node)
        assert Change.FACTS in event.change
        assert plugin().hint(make_info("p"), event) == placed
        assert core.schedule_one(make_info("p"), assume=False).placed == placed
    cluster.apply_node(make_node("n1"))
    assert core.schedule_one(make_info("p"), assume=False).feasible == 2


def test_bench_plugin_reports_what_the_plugin_of_the_manual_costs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, _ = examples()
    (tmp_path / "plugin_of_the_manual.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    out = io.StringIO()
    argv = ["plugin_of_the_manual:QuietNodes", "--nodes", "50", "--pods", "20", "--json"]
    assert bench_command.main(argv, out=out) == 0
    reused, fresh = json.loads(out.getvalue())
    assert reused["plugin_us"] > 0
    assert fresh["plugin_us"] > 0
    assert 0 < fresh["share"] < 1
