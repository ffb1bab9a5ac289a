"""Commands for iproute2, as one batch."""

import subprocess
from collections.abc import Sequence

from robotapp_testbed.failures import CommandError
from robotapp_testbed.real.prerequisites import required_program

_TIMEOUT_S = 20.0


def batch(lines: Sequence[str], *, inside_of: int | None = None) -> None:
    """Run `lines` on the host, or in the network namespace of process `inside_of`. Pids in them are the host's."""
    there = [str(required_program("nsenter")), "-t", str(inside_of), "-n", "--"] if inside_of else []
    argv = [*there, str(required_program("ip")), "-batch", "-"]
    done = subprocess.run(argv, input="\n".join(lines), capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    if done.returncode != 0:
        raise CommandError(argv, done.returncode, done.stdout, done.stderr)
