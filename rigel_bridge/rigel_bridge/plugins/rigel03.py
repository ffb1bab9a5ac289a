"""A job of Rigel 0.3 and newer: `plugin: rigel_bridge.RobotAppPlugin`."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rigel_bridge.document.failures import BridgeError, printable
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.model import Options
from rigel_bridge.plugins import work
from rigel_bridge.plugins.decoded_settings import job_of, planted
from rigel_bridge.source import Objects, Source, from_root, read_root


class Job:
    """The work of one job, in the order in which Rigel calls it."""

    def __init__(self, raw: Mapping[str, Any], shared: Any) -> None:
        self._raw = raw
        self._shared = shared

    def setup(self) -> None:
        self._settings = work.settings(self._raw)
        self._objects = read(self._raw)

    def start(self) -> None:
        self._done = work.write(self._objects, self._settings)
        for note in self._objects.notes:
            work.tell(f"note: {note}")
        if self._settings.apply:
            work.bring(self._objects, kubectl=work.kubectl_of(self._settings), tell=work.tell)
        self._shared["robotapp_name"] = self._done.names[0]
        self._shared["robotapp_namespace"] = self._done.namespace
        self._shared["robotapp_file"] = str(self._done.file)

    def process(self) -> None:
        work.wait(self._done, self._settings, kubectl=work.kubectl_of(self._settings), tell=work.tell)


def plugin(base: type, rigel_error: type[Exception]) -> type:
    """The class for an installed Rigel 0.3: a subclass of its own Plugin, which Rigel insists on."""

    def guarded(step: Callable[[], None]) -> None:
        """Errors in Rigel's manner: one line, no traceback."""
        try:
            step()
        except BridgeError as error:
            raise rigel_error(printable(str(error))) from None
        except Exception as error:
            raise rigel_error(printable(f"rigel_bridge has a bug: {type(error).__name__}: {error}")) from error

    class RobotAppPlugin(base):  # type: ignore[misc]
        """setup reads and checks, start writes and applies, process waits. What was applied stays after stop."""

        def __init__(self, raw: Any, variables: Any, application: Any, providers: Any, shared_data: Any = None) -> None:
            # The very object that Rigel passes, even an empty one: what is written into it is meant for later jobs.
            shared = {} if shared_data is None else shared_data
            super().__init__(raw, variables, application, providers, shared_data=shared)
            self._job = Job(raw, shared)

        def setup(self) -> None:
            guarded(self._job.setup)

        def start(self) -> None:
            guarded(self._job.start)

        def process(self) -> None:
            guarded(self._job.process)

        def stop(self) -> None:
            """Nothing runs on: what was applied stays until `rigel-bridge delete`."""

    return RobotAppPlugin


def read(raw: Mapping[str, Any]) -> Objects:
    """What ./Rigelfile becomes with the settings that Rigel decoded: a sequence's overrides are in them."""
    root, data = read_root(Source(work.RIGELFILE))
    job = job_of(root, raw)
    return from_root(_with_settings(root, job, raw), data, Source(work.RIGELFILE, options=Options(job=job)))


def _with_settings(root: Node, job: str, raw: Mapping[str, Any]) -> Node:
    """The document with these settings at that job."""
    top = root.mapping()
    jobs = top["jobs"].mapping()
    own = jobs[job].mapping()
    settings = planted(dict(raw), own.get("with") or jobs[job])
    changed = replace(jobs[job], value={**own, "with": settings})
    return replace(root, value={**top, "jobs": replace(top["jobs"], value={**jobs, job: changed})})
