"""Pages can be read and found: short lines, every page linked from the index, apps and commands in them that the product accepts."""

import re
import shlex
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import typer
import yaml

from campaigns.nodes import walkthrough
from robotapp_cli.lint.findings import Severity
from robotapp_cli.lint.linter import lint
from robotapp_cli.main import app
from robotapp_cli.verbs import move_options
from robotapp_scheduler.watch.routes import resources
from robotapp_testbed import cli as testbed

ROOT: Final = Path(__file__).resolve().parents[3]
INDEX: Final = ROOT / "docs/index.md"
PAGES: Final = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md")])
NOT_BUILT: Final = {"convert"}
"""Commands that a page promises for later."""
MOST_CHARACTERS: Final = 199
FLEET: Final = str(ROOT / "examples/fleet/factory.yaml")


def without_blocks(page: Path) -> str:
    return re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def linked(page: Path) -> Iterator[Path]:
    """The pages that a page links to; a folder stands for the pages in it."""
    for path in re.findall(r"\]\((?!https?:)([^)#\s]+)", without_blocks(page)):
        target = (page.parent / path).resolve()
        yield from target.glob("*.md") if target.is_dir() else [target]


def test_no_line_is_longer_than_a_screen_shows() -> None:
    """Rows of tables cannot be broken, so they are left out."""
    long = [
        f"{page.name}:{number}"
        for page in PAGES
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > MOST_CHARACTERS and not line.startswith("|")
    ]
    assert long == []


def test_every_page_is_linked_from_the_index() -> None:
    found = {INDEX, *linked(INDEX)}
    assert [str(page.relative_to(ROOT)) for page in ROOT.glob("docs/**/*.md") if page not in found] == []


def test_the_readme_leads_to_the_index_and_the_tutorial() -> None:
    assert {INDEX, ROOT / "docs/tutorial.md"} <= set(linked(ROOT / "README.md"))


def blocks(page: Path) -> list[str]:
    return walkthrough.blocks(page.read_text(encoding="utf-8"))


def commands(page: Path, program: str) -> Iterator[list[str]]:
    """The arguments of each call of a program, in blocks and between backquotes; `NAME` and the like are arguments, too."""
    inline = re.findall(r"`([^`\n]+)`", without_blocks(page))
    for line in [*(line for block in blocks(page) for line in block.splitlines()), *inline]:
        for call in re.split(r"[;|]|&&", line.removeprefix("$ ").partition("  #")[0]):
            if call.strip().startswith(program + " ") and not re.search(r"[…<>\[\]]", call):
                yield shlex.split(call)[len(program.split()) :]


def test_every_app_and_pool_that_a_page_shows_is_accepted() -> None:
    shown = [(page.name, block) for page in PAGES for block in blocks(page) if "apiVersion: robotics.io" in block]
    assert len(shown) >= 7
    reports = [(name, lint(block.encode())) for name, block in shown]
    assert [
        (name, each) for name, report in reports for each in report.findings if each.severity == Severity.ERROR
    ] == []


def test_every_command_of_ours_that_a_page_shows_has_these_options() -> None:
    group: Any = typer.main.get_command(app)
    shown = [move_options(call) for page in PAGES for call in commands(page, "kubectl robotapp")]
    calls = [call for call in shown if call[0] not in NOT_BUILT]
    assert len(calls) >= 30
    for verb, *rest in calls:
        assert verb in group.commands, f"kubectl robotapp {verb}"
        with suppress(typer.Exit, typer.BadParameter):  # `--help`; a page may name a command without its arguments
            group.commands[verb].make_context(verb, rest)


def test_every_command_of_the_testbed_that_a_page_shows_has_these_options() -> None:
    calls = [call for page in PAGES for call in commands(page, "python -m robotapp_testbed")]
    assert len(calls) >= 10
    for call in calls:
        testbed._parser().parse_args([FLEET if re.fullmatch(r"FILE|.*\.yaml", word) else word for word in call])


def test_the_page_of_the_command_line_lists_every_command() -> None:
    group: Any = typer.main.get_command(app)
    table = (ROOT / "docs/cli.md").read_text(encoding="utf-8").partition("\n\n- ")[0]
    assert set(group.commands) == set(
        re.findall(r"`([a-z-]+)(?: [^`]*)?`", "".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE)))
    )


def test_the_role_for_simulate_lists_what_simulate_reads_and_nothing_else() -> None:
    (block,) = [each for each in blocks(ROOT / "docs/simulate.md") if "kind: ClusterRole" in each]
    *rules, page = yaml.safe_load(block)["rules"]
    assert {verb for rule in rules for verb in rule["verbs"]} == {"list"}
    assert {(group, plural) for rule in rules for group in rule["apiGroups"] for plural in rule["resources"]} == {
        (resource.group, resource.plural) for resource in resources()
    }
    assert page == {"nonResourceURLs": ["/simulate"], "verbs": ["get", "post"]}
    assert f"reads {len(resources())} kinds" in (ROOT / "docs/simulate.md").read_text(encoding="utf-8")


def test_every_metric_to_watch_is_one_of_operator_or_scheduler() -> None:
    page = (ROOT / "docs/how-to/monitor.md").read_text(encoding="utf-8").partition("## What to watch")[2]
    named = set(re.findall(r"`((?:scheduler|controller_runtime|workqueue|robotapp_operator)_[a-z_]+)", page))
    sources = [path for folder in ("operator", "scheduler") for path in (ROOT / folder).rglob("*.py")]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert len(named) >= 15
    assert {
        name for name in named if f'"{name.removeprefix("scheduler_").removesuffix("_total")}"' not in text
    } == set()
