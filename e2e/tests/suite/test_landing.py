"""What has changed since the last landing is known whole, or the run ends and names the cure."""

import json
import subprocess
from pathlib import Path

import pytest

from suite import landing
from suite.landing import LandingError


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with one commit."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    run_git(tmp_path, "init", "--quiet")
    (tmp_path / "kept.py").touch()
    (tmp_path / "changed.py").touch()
    commit(tmp_path)
    return tmp_path


def run_git(root: Path, *arguments: str) -> str:
    settings = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    command = ["git", *settings, *arguments]
    return subprocess.run(command, cwd=root, check=True, capture_output=True, text=True).stdout.strip()


def commit(root: Path) -> str:
    """Commits everything and returns the commit."""
    run_git(root, "add", "--all")
    run_git(root, "commit", "--quiet", "--no-verify", "--allow-empty", "--message", "a state")
    return run_git(root, "rev-parse", "HEAD")


def write_landing(root: Path, text: str) -> None:
    (root / ".ci").mkdir(exist_ok=True)
    (root / ".ci/landing.json").write_text(text)


def test_changed_new_and_deleted_files_are_listed_under_their_own_names(root: Path) -> None:
    landed = run_git(root, "rev-parse", "HEAD")
    (root / "committed.py").touch()
    commit(root)
    (root / "changed.py").write_text("x = 1\n")
    (root / "nicht hinzugefügt.py").touch()
    (root / "kept.py").unlink()
    names = ["changed.py", "committed.py", "kept.py", "nicht hinzugefügt.py"]
    assert landing.list_changed_files(landed, root) == names


def test_a_commit_that_is_not_here_or_not_below_head_ends_the_run_with_the_cure(root: Path) -> None:
    with pytest.raises(
        LandingError, match=r"0{40} is not in this repository: git fetch --unshallow, or write a commit"
    ):
        landing.list_changed_files("0" * 40, root)
    first = run_git(root, "rev-parse", "HEAD")
    side = commit(root)
    run_git(root, "reset", "--quiet", "--hard", first)
    with pytest.raises(LandingError, match=rf"{side} is no ancestor of HEAD: "):
        landing.list_changed_files(side, root)


def test_an_unpacked_source_archive_has_no_changed_files_to_know_of(tmp_path: Path) -> None:
    assert landing.list_changed_files("0" * 40, tmp_path) is None


@pytest.mark.parametrize("landed", ["HEAD", "main", "abc123", "", "G" * 40, "0" * 41])
def test_only_the_digits_of_a_commit_are_accepted_as_landed(tmp_path: Path, landed: str) -> None:
    write_landing(tmp_path, json.dumps({"landed": landed, "waiting": []}))
    with pytest.raises(LandingError, match="must be the 40 hexadecimal digits of a commit"):
        landing.read_landing(tmp_path)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"landed": "HEAD"}', '{"waiting": []}'])
def test_a_file_that_cannot_be_read_is_named_with_the_cure(tmp_path: Path, text: str) -> None:
    write_landing(tmp_path, text)
    with pytest.raises(LandingError, match=r"\.ci/landing\.json cannot be read .*restore it with git"):
        landing.read_landing(tmp_path)


def test_a_landing_is_recorded_once(root: Path) -> None:
    landed = run_git(root, "rev-parse", "HEAD")
    write_landing(root, json.dumps({"landed": "0" * 40, "waiting": []}))
    assert landing.record_landing(["a", "b"], root) == landing.Landing(landed, ("a", "b"))
    assert landing.read_landing(root) == landing.Landing(landed, ("a", "b"))
    with pytest.raises(LandingError, match="is recorded already"):
        landing.record_landing([], root)
