"""`rigel run job ID` and `rigel run sequence ID`, as far as plugins meet them."""

import copy
import importlib
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml
from rigel.exceptions import RigelError
from rigel.plugins import Plugin

_TOP = {"application", "jobs", "providers", "sequences", "vars"}
_MARK = re.compile(r"\{\{ *(vars|data)\.([A-Za-z0-9_]+) *\}\}")


class Orchestrator:
    """One run of the file; `shared` lives as long as it."""

    def __init__(self, document: dict[str, Any]) -> None:
        if extra := set(document) - _TOP:
            raise RigelError(f"extra fields not permitted: {', '.join(sorted(extra))}")
        self._document = document
        self._variables = document.get("vars", {})
        self._shared: dict[str, Any] = {}

    def job(self, entry: str | Mapping[str, Any]) -> Plugin:
        """The plugin of a job entry with its overrides laid over `with`, one level deep."""
        name, overrides = (entry, {}) if isinstance(entry, str) else (entry["name"], entry["with"])
        job = self._document["jobs"][name]
        raw = self._decoded({**copy.deepcopy(job["with"]), **overrides})
        module, _, attribute = str(job["plugin"]).rpartition(".")
        kind = getattr(importlib.import_module(module), attribute)
        if not issubclass(kind, Plugin):
            raise RigelError(f"{job['plugin']} is not compliant: it must inherit from Plugin")
        application = SimpleNamespace(**{"dir": ".", **self._decoded(self._document["application"])})
        return kind(raw, self._variables, application, {}, shared_data=self._shared)

    def sequence(self, name: str) -> None:
        for stage in self._document["sequences"][name]["stages"]:
            self.stage(stage)

    def stage(self, stage: Mapping[str, Any]) -> None:
        """Dependencies are set up and started before the jobs, and stopped after them."""
        others = [self.job(entry) for entry in stage.get("dependencies", ())]
        for other in others:
            other.setup()
            other.start()
        for entry in stage["jobs"]:
            plugin = self.job(entry)
            for step in (plugin.setup, plugin.start, plugin.process, plugin.stop):
                step()
        for other in others:
            other.process()
            other.stop()

    def _decoded(self, value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: self._decoded(child) for key, child in value.items()}
        if isinstance(value, list):
            return [self._decoded(child) for child in value]
        if not isinstance(value, str):
            return value
        if whole := _MARK.fullmatch(value):
            return self._known(whole)
        return _MARK.sub(lambda mark: str(self._known(mark)), value)

    def _known(self, mark: re.Match[str]) -> Any:
        known = self._variables if mark[1] == "vars" else self._shared
        if mark[2] not in known:
            raise RigelError(f"undeclared {mark[1]}.{mark[2]}")
        return self._decoded(known[mark[2]])


def main() -> int:
    kind, name = sys.argv[2:4]
    try:
        run = Orchestrator(yaml.safe_load(Path("Rigelfile").read_text()))
        run.stage({"jobs": [name]}) if kind == "job" else run.sequence(name)
    except RigelError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    sys.exit(main())
