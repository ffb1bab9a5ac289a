"""Run kubectl and helm against the control plane, isolated from the user's own configuration and caches."""

import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from robotapp_testbed.failures import CommandError

_TIMEOUT_S = 120.0
_PASSED_ON = ("PATH", "LANG", "LC_ALL", "TERM")


def as_input(stdin: object) -> str | None:
    """Text as it is; an object as JSON; several objects as one List, which kubectl takes as several."""
    if stdin is None or isinstance(stdin, str):
        return stdin
    if isinstance(stdin, Mapping):
        return json.dumps(stdin)
    if isinstance(stdin, Sequence):
        return json.dumps({"apiVersion": "v1", "kind": "List", "items": list(stdin)})
    raise TypeError(f"stdin is text, an object or a list of objects, not {type(stdin).__name__}")


class Commands:
    def __init__(self, binaries: Mapping[str, Path], run_dir: Path) -> None:
        self._binaries = binaries
        home = run_dir / "home"
        self._env = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
        self._env |= {
            "HOME": str(home),
            "HELM_CACHE_HOME": str(home / "helm-cache"),
            "HELM_CONFIG_HOME": str(home / "helm-config"),
            "HELM_DATA_HOME": str(home / "helm-data"),
        }

    def run(self, program: str, args: Sequence[str], *, kubeconfig: Path, stdin: object, check: bool) -> str:
        result = subprocess.run(
            [self._binaries[program], *args],
            input=as_input(stdin),
            env={**self._env, "KUBECONFIG": str(kubeconfig)},
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
        if check and result.returncode != 0:
            raise CommandError([program, *args], result.returncode, result.stdout, result.stderr)
        return result.stdout if check else result.stdout + result.stderr
