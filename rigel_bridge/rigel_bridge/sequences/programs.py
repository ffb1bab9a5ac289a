"""Rigel's own commands, run in the Rigelfile's folder with their output on the screen."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from rigel_bridge.document.failures import BridgeError, Exit, Place


def run_rigel(arguments: Sequence[str], *, folder: Path, timeout_s: float, program: str = "rigel") -> None:
    """Run `rigel ARGUMENTS` to its end; BridgeError (STEP_FAILED) when it is missing, fails or takes too long.

    Rigel 0.3 ends a parallel stage with 0 whatever failed in it; its single jobs end with 1, and only these are run here.
    """
    found = shutil.which(program)
    shown = f"{program} {' '.join(arguments)}"
    if found is None:
        raise _failed(
            f"{program} is not an installed program, and the sequence needs `{shown}`: install Rigel (docs/rigel-bridge.md), or "
            "add --no-build when the image is in the registry already"
        )
    try:
        done = subprocess.run([found, *arguments], cwd=folder, timeout=timeout_s, check=False, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired:
        raise _failed(f"`{shown}` did not end within {timeout_s:g} s; --build-timeout allows more") from None
    except OSError as error:
        raise _failed(f"`{shown}` cannot be started: {error.strerror}") from error
    if done.returncode:
        raise _failed(f"`{shown}` ended with {done.returncode}; what it wrote stands above")


def _failed(message: str) -> BridgeError:
    return BridgeError(Place("rigel"), message, code=Exit.STEP_FAILED)
