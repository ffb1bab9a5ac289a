"""Run kubectl: an argument list without a shell, with limits on time and output, and its refusals as errors with a reason."""

import json
import os
import re
import selectors
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from typing import IO, Any, Final

from rigel_bridge.document.failures import BridgeError, Exit, Place

MAX_OUTPUT_BYTES: Final = 16 * 1024 * 1024
"""Ten past specs of the largest size that the API server stores, with room to spare."""
CALL_S: Final = 60.0
_REQUEST_S: Final = 30
_SHOWN: Final = 2000
"""Characters of kubectl's words in one message."""
_SERVER: Final = re.compile(r"Error from server \((\w+)\): ")
_LOG_LINE: Final = re.compile(r"[IWE][0-9]{4} [0-9:.]+ +[0-9]+ |Warning: ")
"""What kubectl logs before its error message: the same sentence several times."""
_NO_KIND: Final = ('no matches for kind "RobotApp"', 'have a resource type "robotapp')
_HINT: Final = " - did you specify the right host or port?"
_UNREACHABLE: Final = (
    "Unable to connect to the server",
    "The connection to the server",
    "was refused - did you specify",
)


class Refusal(StrEnum):
    """Why kubectl failed: the API server's own reasons, as far as the bridge acts on them."""

    NOT_FOUND = "NotFound"
    FORBIDDEN = "Forbidden"
    CONFLICT = "Conflict"
    EXISTS = "AlreadyExists"
    INVALID = "Invalid"
    UNREACHABLE = "Unreachable"
    OTHER = "Other"


_SIGNS: Final = {"Operation cannot be fulfilled on": Refusal.CONFLICT, " is invalid: ": Refusal.INVALID}
"""Refusals that kubectl writes without the server's reason."""


class ClusterError(BridgeError):
    """kubectl is missing, did not end in time, or the cluster refused."""

    def __init__(self, message: str, *, reason: Refusal = Refusal.OTHER, code: Exit = Exit.CLUSTER) -> None:
        super().__init__(Place("kubectl"), message, code=code)
        self.reason = reason


class Kubectl:
    """One cluster and namespace. `flags` (context, namespace, kubeconfig) stand in front of every command."""

    def __init__(self, program: str = "kubectl", *, flags: Sequence[str] = ()) -> None:
        self._program = program
        self._flags = tuple(flags)

    def run(self, *arguments: str, stdin: str = "", timeout_s: float = CALL_S) -> str:
        """Standard output of `kubectl ARGUMENTS`. ClusterError when it fails, writes too much or takes too long."""
        out, err, code = self._finished(arguments, stdin=stdin.encode(), timeout_s=timeout_s, limit=MAX_OUTPUT_BYTES)
        if code:
            raise failure(err.decode(errors="replace"), arguments)
        return out.decode(errors="replace")

    def binary(self, *arguments: str, limit: int, timeout_s: float = CALL_S) -> bytes:
        """The same for content that is not text, of at most `limit` bytes."""
        out, err, code = self._finished(arguments, stdin=b"", timeout_s=timeout_s, limit=limit)
        if code:
            raise failure(err.decode(errors="replace"), arguments)
        return out

    def json(self, *arguments: str, stdin: str = "") -> dict[str, Any]:
        """The object that `kubectl ARGUMENTS -o json` writes."""
        text = self.run(*arguments, "-o", "json", stdin=stdin)
        try:
            found = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ClusterError(f"{_shown(arguments)} wrote no JSON: {text[:200]!r}") from error
        if not isinstance(found, dict):
            raise ClusterError(f"{_shown(arguments)} wrote no object: {text[:200]!r}")
        return found

    def items(self, *arguments: str) -> list[dict[str, Any]]:
        """The objects of the list that `kubectl ARGUMENTS -o json` writes; each has a name."""
        found = self.json(*arguments).get("items")
        if not isinstance(found, list) or not all(_is_named(each) for each in found):
            raise ClusterError(f"{_shown(arguments)} wrote no list of objects with names: is --kubectl a kubectl?")
        return found

    def _finished(
        self, arguments: Sequence[str], *, stdin: bytes, timeout_s: float, limit: int
    ) -> tuple[bytes, bytes, int]:
        command = [self._found(), *self._flags, f"--request-timeout={_REQUEST_S}s", *arguments]
        with tempfile.TemporaryFile() as given:  # a pipe could fill up while kubectl fills the other ones
            given.write(stdin)
            given.seek(0)
            with _started(command, given) as process:
                try:
                    out, err = _read(process, timeout_s=timeout_s, limit=limit)
                except _LimitError as error:
                    raise ClusterError(f"{_shown(arguments)} {error}") from None
                return out, err, process.wait()

    def _found(self) -> str:
        found = shutil.which(self._program)
        if found is None:
            raise ClusterError(
                f"{self._program} is not an installed program: install kubectl, or name it with --kubectl PATH "
                "(`rigel-bridge render` needs neither kubectl nor a cluster)"
            )
        return found


def _is_named(value: Any) -> bool:
    metadata = value.get("metadata") if isinstance(value, dict) else None
    return isinstance(metadata, dict) and isinstance(metadata.get("name"), str)


class _LimitError(Exception):
    """What limit was met."""


@contextmanager
def _started(command: Sequence[str], stdin: IO[bytes]) -> Iterator["subprocess.Popen[bytes]"]:
    """A running program that does not outlive the block. Ctrl-C reaches the bridge alone, so that it can still clean up."""
    try:
        process = subprocess.Popen(
            command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, process_group=0
        )
    except OSError as error:
        raise ClusterError(f"{command[0]} cannot be started: {error.strerror}") from error
    with process:
        try:
            yield process
        finally:
            if (
                process.poll() is None
            ):  # the whole group: `kubectl` may be a script, whose kubectl would go on and write
                os.killpg(process.pid, signal.SIGKILL)


def _read(process: "subprocess.Popen[bytes]", *, timeout_s: float, limit: int) -> tuple[bytes, bytes]:
    """Both outputs to their end, read side by side."""
    deadline_s = time.monotonic() + timeout_s
    parts: dict[int, list[bytes]] = {}
    left = limit
    with selectors.DefaultSelector() as selector:
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                selector.register(pipe, selectors.EVENT_READ)
                parts[pipe.fileno()] = []
        while selector.get_map():
            ready = selector.select(max(0.0, deadline_s - time.monotonic()))
            if not ready:
                raise _LimitError(f"did not end within {timeout_s:g} s")
            for key, _ in ready:
                data = os.read(key.fd, 65536)
                if not data:
                    selector.unregister(key.fileobj)
                left -= len(data)
                if left < 0:
                    raise _LimitError(f"wrote more than {limit} bytes")
                parts[key.fd].append(data)
    out, err = parts.values()
    return b"".join(out), b"".join(err)


def failure(words: str, arguments: Sequence[str]) -> ClusterError:
    """The error for what kubectl wrote to standard error."""
    told = [line for line in words.splitlines() if not _LOG_LINE.match(line)]
    text = " ".join(" ".join(told or words.splitlines()).split())
    if any(sign in text for sign in _NO_KIND):
        return ClusterError(
            "this cluster has no RobotApps: install the chart of this project first (docs/installation.md)"
        )
    if any(sign in text for sign in _UNREACHABLE):
        text = text.removesuffix(_HINT)
        return ClusterError(
            f"the cluster cannot be reached: {text[:_SHOWN]}; look at `kubectl config current-context`, or name "
            "another with --context",
            reason=Refusal.UNREACHABLE,
        )
    if found := _SERVER.search(text):
        reason = next((known for known in Refusal if known == found[1]), Refusal.OTHER)
        return ClusterError(text.replace(found[0], "", 1)[:_SHOWN], reason=reason)
    reason = next((known for sign, known in _SIGNS.items() if sign in text), Refusal.OTHER)
    return ClusterError(text[:_SHOWN] or f"{_shown(arguments)} failed without a word", reason=reason)


def _shown(arguments: Sequence[str]) -> str:
    return " ".join(["kubectl", *arguments])[:120]
