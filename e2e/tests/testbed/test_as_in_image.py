"""A module that runs as in its image finds none of the packages that only tests need."""

import subprocess
import sys
from pathlib import Path

from robotapp_testbed.processes import as_in_image

PROGRAM = """
import sys
try:
    import kubernetes
except ImportError:
    print("none")
print(__name__, sys.argv)
"""


def test_it_runs_as_main_with_its_arguments_and_without_the_client_of_kubernetes(tmp_path: Path) -> None:
    (tmp_path / "some_program.py").write_text(PROGRAM)
    command = [sys.executable, as_in_image.__file__, "some_program", "--flag", "1"]
    outcome = subprocess.run(command, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True)
    assert outcome.stdout == f"none\n__main__ ['{tmp_path / 'some_program.py'}', '--flag', '1']\n"
