"""A run of groups succeeds only when every process ran all of its tests and none failed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from suite import durations
from suite.lanes import Lanes
from suite.plan import Group

INI = "[pytest]\njunit_family = xunit1\naddopts = -p no:randomly\n"


def run_group(folder: Path, text: str, **files: str) -> Lanes:
    """Runs one group with one module of tests and returns the lanes."""
    (folder / "pytest.ini").write_text(INI)
    (folder / "test_it.py").write_text(text)
    for name, content in files.items():
        (folder / f"{name}.py").write_text(content)
    reports = folder / "reports"
    reports.mkdir()
    lanes = Lanes(reports)
    lanes.run(
        [Group("it", (str(folder / "test_it.py"), f"--rootdir={folder}", "-c", str(folder / "pytest.ini")), 1.0)],
        os.environ,
    )
    return lanes


def test_a_group_that_passes_succeeds(tmp_path: Path) -> None:
    lanes = run_group(tmp_path, "def test_one(): pass\n")
    assert lanes.succeeded
    assert [result.counts["passed"] for result in lanes.results] == [1]


def test_two_groups_of_one_name_run_at_once(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text(INI)
    settings = (f"--rootdir={tmp_path}", "-c", str(tmp_path / "pytest.ini"))
    groups = []
    for own, other in (("a", "b"), ("b", "a")):
        module = tmp_path / f"test_{own}.py"
        module.write_text(
            f"from pathlib import Path\nimport time\nfolder = Path({str(tmp_path)!r})\n"
            f"def test_both_run():\n    (folder / {own!r}).touch()\n    deadline = time.monotonic() + 60\n"
            f"    while not (folder / {other!r}).exists():\n        assert time.monotonic() < deadline\n"
        )
        groups.append(Group("it", (str(module), *settings), 1.0))
    lanes = Lanes(tmp_path)
    lanes.run(groups, os.environ)
    assert [result.counts for result in lanes.results] == [{"passed": 1}] * 2


@pytest.mark.parametrize(("users", "value"), [({}, "all"), ({"ROBOTAPP_SAMPLES": "few"}, "few")])
def test_a_groups_variables_are_set_where_the_user_has_not_set_them(
    tmp_path: Path, users: dict[str, str], value: str
) -> None:
    (tmp_path / "pytest.ini").write_text(INI)
    module = tmp_path / "test_it.py"
    module.write_text(f"import os\ndef test_one(): assert os.environ['ROBOTAPP_SAMPLES'] == {value!r}\n")
    lanes = Lanes(tmp_path)
    environment = {name: text for name, text in os.environ.items() if name != "ROBOTAPP_SAMPLES"} | users
    lanes.run(
        [Group("it", (str(module), "-c", str(tmp_path / "pytest.ini")), 1.0, variables=(("ROBOTAPP_SAMPLES", "all"),))],
        environment,
    )
    assert lanes.succeeded


@pytest.mark.parametrize(
    ("text", "conftest"),
    [
        ("def test_one(): assert 0\n", ""),
        ("def test_one(): raise KeyboardInterrupt\ndef test_two(): pass\n", ""),
        ("import pytest\ndef test_one(): pytest.exit('enough', 3)\n", ""),
        ("import os\ndef test_one(): os._exit(0)\n", ""),
        ("def test_one(): pass\n", "def pytest_unconfigure(): raise RuntimeError\n"),
        ("def test_one(): pass\n", "import pytest\ndef pytest_sessionfinish(session): session.exitstatus = 1\n"),
        ("", ""),
    ],
    ids=["failure", "interrupted", "exit", "killed", "end of process", "end of session", "no tests"],
)
def test_a_group_that_fails_or_does_not_run_all_its_tests_is_no_success(
    tmp_path: Path, text: str, conftest: str
) -> None:
    assert not run_group(tmp_path, text, conftest=conftest).succeeded


def test_ctrl_c_leaves_the_tests_the_time_to_clean_up(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text(INI)
    (tmp_path / "test_it.py").write_text(
        "import pathlib, pytest, time\n"
        "@pytest.fixture(scope='session')\n"
        "def node():\n    yield\n    time.sleep(1)\n    pathlib.Path(__file__).with_name('clean').touch()\n"
        "def test_one(node):\n    pathlib.Path(__file__).with_name('begun').touch()\n    time.sleep(60)\n"
    )
    program = (
        "import os, sys; from pathlib import Path; from suite.lanes import Lanes; from suite.plan import Group; "
        f"folder = {str(tmp_path)!r}; "
        "group = Group('it', (folder + '/test_it.py', '-c', folder + '/pytest.ini'), 1.0, exclusive=True); "
        "Lanes(Path(folder)).run([group], os.environ)"
    )
    process = subprocess.Popen([sys.executable, "-c", program], process_group=0, stderr=subprocess.DEVNULL)
    while not (tmp_path / "begun").exists():
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(timeout=60) != 0
    assert (tmp_path / "clean").exists()


def test_a_report_that_was_never_written_is_passed_over(tmp_path: Path) -> None:
    assert durations.read_reports([tmp_path / "none.xml"], []) == {}
