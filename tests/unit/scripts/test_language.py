"""The ratchet of language: what counts as a finding, and which changes it lets pass."""

import importlib
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import pytest

SCRIPTS = Path(__file__).parents[3] / "scripts"
PLAIN = '"""Reads files."""\nimport old_place\n\n\n'


class Repository:
    """A repository with one landed state, and the script that looks at it."""

    def __init__(self, root: Path, script: ModuleType) -> None:
        self.root = root
        self.script = script
        self.run_git("init", "--quiet")

    def run_git(self, *argv: str) -> str:
        settings = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
        return subprocess.run(
            ["git", *settings, *argv], cwd=self.root, check=True, capture_output=True, text=True
        ).stdout

    def write(self, path: str, text: str) -> None:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def land(self) -> None:
        self.run_git("add", "--all")
        self.run_git("commit", "--quiet", "--no-verify", "--message", "landed")
        self.write(".ci/landing.json", json.dumps({"landed": self.run_git("rev-parse", "HEAD").strip(), "waiting": []}))

    def check(self) -> int:
        return int(self.script.main())


@pytest.fixture
def language(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return importlib.import_module("language")


@pytest.fixture
def repository(language: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Repository:
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(language, "ROOT", tmp_path)
    monkeypatch.setattr("sys.argv", ["language.py"])
    return Repository(tmp_path, language)


def list_findings(language: ModuleType, measure: str, text: str) -> list[str]:
    tree = language.Tree({"cli/robotapp_cli/module.py": dedent(text)})
    places = tree.list_places(tree.places)
    return [place.item.name for place in places if place.item.is_finding and place.item.measure == measure]


def write_functions(*names: str) -> str:
    """Returns a module with functions that are long enough for git to follow them."""
    return "\n\n".join(
        f"def {name}(amount: int) -> int:\n    return amount + {len(name)}  # {name}\n" for name in names
    )


def iterate_docstrings(*texts: str) -> Iterator[str]:
    for number, text in enumerate(texts):
        yield f'def read_{number}() -> None:\n    """{text}"""\n'


def test_a_function_begins_with_a_verb_condition_conversion_or_handler(language: ModuleType) -> None:
    text = """
        def release_slot() -> Slot: ...
        def pre_bind() -> Status: ...
        def is_ready() -> bool: ...
        def holds_claim() -> bool: ...
        def to_json() -> str: ...
        def on_close() -> None: ...
        def queue_pod() -> None: ...
        def queue_key() -> str: ...
        def holds() -> list[Claim]: ...
        def _freed() -> None: ...
        def of_app() -> None: ...
        def on() -> None: ...
    """
    assert list_findings(language, "verbs", text) == ["queue_key", "holds", "_freed", "of_app", "on"]


def test_names_that_something_else_decides_are_left_out(language: ModuleType) -> None:
    text = """
        def main() -> int: ...
        class Protocol:
            def __len__(self) -> int: ...
            def connection_made(self) -> None: ...
            @property
            def size(self) -> int: ...
            @functools.cached_property
            def total(self) -> int: ...
        @app.command("apps")
        def apps_command() -> None: ...
        @pytest.fixture
        def cluster() -> Cluster: ...
    """
    tree = language.Tree({"cli/module.py": dedent(text)})
    assert all(place.item.measure != "verbs" for place in tree.list_places(tree.places))


def test_locals_named_by_participles_and_pronouns_are_findings(language: ModuleType) -> None:
    text = """
        listed = 1
        class Field:
            given: int
        def read(others):
            found = feed = feasible_nodes = found_nodes = 1
            for each in others: ...
            with others as (kept, _): ...
            return [made for made in others if (seen := made)]
        def compare(right):
            left = 1
        def look():
            left = 1
    """
    assert list_findings(language, "locals", text) == ["found", "each", "kept", "made", "seen", "left"]


def test_docstrings_that_open_with_a_fragment_are_findings(language: ModuleType) -> None:
    whole = [
        "Releases the slot of a pod.",
        "Upper bounds on what is left.",
        "`hint` that returns True when it fails.",
        "kubectl's view of a pod. Of all nodes.",
        "Placed pods by namespace.",
        "64-bit values of names.",
    ]
    fragments = [
        "Of all agents together.",
        "What the port sees.",
        "Whether it fits.",
        "True where it fits.",
        "0…100 per node.",
        "spec of a pod.",
        "Called by the queue.",
        "Nodes.",
        "Do pods fit?",
    ]
    assert list_findings(language, "docstrings", "\n".join(iterate_docstrings(*whole))) == []
    assert len(list_findings(language, "docstrings", "\n".join(iterate_docstrings(*fragments)))) == len(fragments)


def test_names_of_another_class_are_leftovers(language: ModuleType) -> None:
    text = """
        class Cache: ...
        class Held: ...
        class Topology:
            required: Cache
        def read(cluster: Cache, cache: Cache, found: "Cache | None", held: Held, given: int) -> None:
            self.cluster: Cache = cluster
    """
    assert list_findings(language, "leftovers", text) == ["cluster: Cache", "found: Cache", "cluster: Cache"]


def test_a_moved_file_with_other_imports_passes(repository: Repository) -> None:
    names = [f"row_{number}" for number in range(20)]
    repository.write("crds/robotapp_api/client/rows.py", PLAIN + write_functions(*names))
    repository.write("tests/bench/rows.py", PLAIN + write_functions(*names))
    repository.land()
    (repository.root / "client/robotapp_client").mkdir(parents=True)
    (repository.root / "e2e/campaigns").mkdir(parents=True)
    for before, now in (
        ("crds/robotapp_api/client/rows.py", "client/robotapp_client/rows.py"),
        ("tests/bench/rows.py", "e2e/campaigns/rows.py"),
    ):
        repository.run_git("mv", before, now)
        repository.write(now, (repository.root / now).read_text().replace("old_place", "new_place"))
    assert repository.check() == 0


def test_a_share_that_gets_worse_in_changed_files_is_an_error(
    repository: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row", "row_key"))
    repository.land()
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row", "row_key", "row_text"))
    assert repository.check() == 1
    output = capsys.readouterr().out
    assert (
        "verbs: 33.3 % in changed files, 50.0 % before; mend 1 of:\n  cli/robotapp_cli/rows.py:9: `row_text`: begin"
        in output
    )
    assert "row_key" not in output


def test_what_was_there_before_may_stay_and_good_code_may_go(repository: Repository) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row", "list_rows", "row_key", "row_text"))
    repository.land()
    repository.write(
        "cli/robotapp_cli/rows.py", write_functions("read_row", "print_row", "write_row", "row_key", "row_size")
    )
    assert repository.check() == 0
    repository.write("cli/robotapp_cli/rows.py", write_functions("row_key", "row_text"))
    assert repository.check() == 0


def test_what_is_new_in_new_files_must_reach_the_goals(
    repository: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row"))
    repository.land()
    repository.write(
        "cli/robotapp_cli/keys.py", write_functions("row_key", "app_key", "read_key", "sort_keys", "list_keys")
    )
    assert repository.check() == 0
    repository.write("cli/robotapp_cli/names.py", write_functions("row_name"))
    capsys.readouterr()
    assert repository.check() == 1
    output = capsys.readouterr().out
    assert "verbs: 50.0 % of what is new in new files, goal 60 % or more; mend 1 of:" in output
    assert "cli/robotapp_cli/names.py:1: `row_name`" in output


def test_a_function_that_moved_to_a_new_file_is_not_new(repository: Repository) -> None:
    names = ["row_key", "row_text", "row_size", "row_name"]
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row", "write_row", *names))
    repository.land()
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row", "write_row"))
    repository.write("cli/robotapp_cli/texts.py", write_functions(*names))
    assert repository.check() == 0


def test_tests_are_not_measured(repository: Repository) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row"))
    repository.write("tests/unit/test_rows.py", write_functions("test_row"))
    repository.land()
    names = ("row_key", "row_text", "row_size", "row_name")
    for path in ("tests/unit/test_rows.py", "e2e/tests/rows.py", "e2e/campaigns/conftest.py"):
        repository.write(path, write_functions(*names))
    assert repository.check() == 0


@pytest.mark.parametrize(
    ("landed", "problem"),
    [
        (
            "0" * 40,
            f"landed commit {'0' * 40} is not in this repository: git fetch --unshallow, or write a commit of main",
        ),
        ("HEAD", "\"landed\" is 'HEAD', but must be the 40 hexadecimal digits of a commit"),
    ],
)
def test_a_base_that_cannot_be_compared_with_is_a_finding(
    repository: Repository, capsys: pytest.CaptureFixture[str], landed: str, problem: str
) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("row_key", "row_text", "row_size", "row_name"))
    repository.land()
    repository.write(".ci/landing.json", json.dumps({"landed": landed, "waiting": []}))
    assert repository.check() == 1
    output = capsys.readouterr().out
    assert "robotapp_cli                  4       0.0 %" in output
    assert problem in output


def test_a_revision_that_does_not_exist_is_a_finding(
    repository: Repository, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    repository.write("cli/robotapp_cli/rows.py", write_functions("read_row"))
    repository.land()
    monkeypatch.setattr("sys.argv", ["language.py", "--base", "nonsense"])
    assert repository.check() == 1
    assert "--base nonsense: this repository has no such commit" in capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["language.py", "--base", "HEAD"])
    assert repository.check() == 0


def test_an_unpacked_source_archive_is_measured_and_nothing_is_compared(
    language: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(language, "ROOT", tmp_path)
    monkeypatch.setattr("sys.argv", ["language.py"])
    for folder in ("cli/robotapp_cli", ".venv/lib"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "rows.py").write_text(write_functions("row_key"))
    assert language.main() == 0
    output = capsys.readouterr().out
    assert "robotapp_cli                  1       0.0 %" in output
    assert "all                           1       0.0 %" in output
    assert "Nothing compared: this is no git repository" in output
