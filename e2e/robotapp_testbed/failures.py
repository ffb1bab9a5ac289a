"""What the testbed raises: messages are one sentence for a person, with the command that fixes it where there is one."""

from collections.abc import Sequence


class TestbedError(Exception):
    """Something the caller can act on; the CLI prints it without a traceback."""

    __test__ = False  # the name looks like a test class to pytest


class CommandError(TestbedError):
    """kubectl or helm failed."""

    def __init__(self, argv: Sequence[str], returncode: int, stdout: str, stderr: str) -> None:
        super().__init__(f"{' '.join(argv)} ended with {returncode}: {stderr.strip() or stdout.strip()}")
        self.returncode = returncode
        self.stdout = stdout
        self.stderr = stderr


def last_words(stderr: str) -> str:
    """The line in which most programs say why they failed."""
    return (stderr.strip().splitlines() or ["no reason given"])[-1]


class ApiStatusError(TestbedError):
    """The API server answered with an error status."""

    def __init__(self, method: str, path: str, status: int, message: str) -> None:
        super().__init__(f"{method} {path}: {status} {message}")
        self.status = status
        self.message = message
