"""The recorder hands a change over once both watches have passed its revision, so that the judge hears them in order."""

import json
from typing import Any, Self

from campaigns.storm.recorder import Recorder


class Lines:
    """What one watch of a scripted server says; the other says nothing."""

    status = 200

    def __init__(self, *lines: dict[str, Any]) -> None:
        self.lines = [json.dumps(line).encode() for line in lines] + [b""]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def getresponse(self) -> Self:
        return self

    def close(self) -> None: ...

    def readline(self) -> bytes:
        return self.lines.pop(0)


def line(kind: str, revision: int, *, name: str = "", what: str = "ADDED") -> dict[str, Any]:
    meta = {"name": name, "uid": f"uid-{name}", "resourceVersion": str(revision)}
    spec = {"holder": {"name": f"holder-of-{name}"}} if kind == "RobotClaim" else {"nodeName": "n"}
    return {"type": what, "object": {"metadata": meta, "spec": spec}}


def heard(recorder: Recorder, kind: str, *lines: dict[str, Any]) -> None:
    class Api:
        def stream(self, _path: str, **_: float) -> Lines:
            return Lines(*lines)

    recorder._versions.setdefault(kind, "0")
    recorder._cp = type("Plane", (), {"api": Api()})()  # type: ignore[assignment]
    recorder._watch(kind)


def test_a_change_is_handed_over_once_when_both_watches_have_passed_it() -> None:
    recorder = Recorder(None)  # type: ignore[arg-type]
    heard(recorder, "Pod", line("Pod", 3, name="p"), line("Pod", 9, name="q"))
    assert recorder.ripe() == []
    heard(recorder, "RobotClaim", line("RobotClaim", 5, name="c"))
    assert [event.revision for event in recorder.ripe()] == [3, 5]
    heard(recorder, "RobotClaim", line("RobotClaim", 12, what="BOOKMARK"))
    assert [event.revision for event in recorder.ripe()] == [9]
    assert recorder.ripe(all_of_them=True) == []
