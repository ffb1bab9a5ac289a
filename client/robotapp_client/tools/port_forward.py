"""kubectl port-forward to a pod: a port of this machine that leads to one of the pod's."""

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

_LISTENING: Final = re.compile(r"127\.0\.0\.1:(\d+)")


class ForwardError(Exception):
    """kubectl does not forward the port. `refusal` is its own last line, "" without one."""

    def __init__(self, text: str, *, refusal: str = "") -> None:
        super().__init__(text)
        self.refusal = refusal


class NoKubectlError(ForwardError):
    """kubectl cannot be started."""


class PortForward:
    """An open way to the pod: `port` of this machine leads there until kubectl ends."""

    def __init__(self, process: asyncio.subprocess.Process, port: int) -> None:
        self._process = process
        self.port = port

    async def wait_closed(self) -> None:
        """Waits until kubectl has ended, which it does when the pod does."""
        await self._process.wait()


@contextlib.asynccontextmanager
async def forward_port(
    namespace: str, pod: str, port: int, *, kubeconfig: Path | None, context: str | None, patience_s: float
) -> AsyncIterator[PortForward]:
    """Gives the way to the pod's port, and ends kubectl afterwards. Raises ForwardError, also when kubectl is not there in time."""
    command = ["kubectl", "port-forward", "-n", namespace, f"pod/{pod}", f":{port}"]
    command += ["--context", context] if context else []
    command += ["--kubeconfig", str(kubeconfig)] if kubeconfig else []
    pipe = asyncio.subprocess.PIPE
    try:
        process = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe
        )
    except OSError as error:
        raise NoKubectlError(f"kubectl port-forward cannot be started: {error.strerror}") from error
    try:
        yield PortForward(process, await _read_port(process, pod, patience_s))
    finally:
        with contextlib.suppress(ProcessLookupError):  # it ends by itself when the pod does
            process.terminate()
        await process.wait()


async def _read_port(process: asyncio.subprocess.Process, pod: str, patience_s: float) -> int:
    """Returns the port on this machine. Raises ForwardError when kubectl names none in time."""
    assert process.stdout is not None  # noqa: S101 - asked for with a pipe
    try:
        line = (await asyncio.wait_for(process.stdout.readline(), patience_s)).decode()
    except TimeoutError:
        line = ""
    if match := _LISTENING.search(line):
        return int(match[1])
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    _, complaint = await process.communicate()
    refusal = complaint.decode(errors="replace").strip().rpartition("\n")[2]
    raise ForwardError(f"kubectl port-forward to {pod} failed: {refusal or 'no answer'}", refusal=refusal)
