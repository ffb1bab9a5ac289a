"""A case that shows a difference, made small by leaving out objects and fields: for whoever has to find the cause.

    steps = reduction(case.objects, attempts=200)
    candidate = next(steps)                        # smaller
    candidate = steps.send(still_differs)          # … until StopIteration, whose value is the smallest that did

The comparison itself is the caller's, so that it may ask a live cluster or the reference.
"""

import json
from collections.abc import Callable, Generator, Iterator, Sequence
from copy import deepcopy
from typing import Any

Json = dict[str, Any]
Objects = tuple[Json, ...]
Path = tuple[str | int, ...]
KEPT = frozenset({("apiVersion",), ("kind",), ("metadata",), ("metadata", "name"), ("metadata", "namespace"),
                  ("metadata", "uid"), ("metadata", "labels"), ("spec",), ("status",)})  # fmt: skip
"""Paths no object can do without. Anything else that is needed shows when the API server refuses the candidate."""


def reduction(objects: Sequence[Json], *, attempts: int) -> Generator[Objects, bool, Objects]:
    """Candidates, each smaller than the best so far; is sent whether the candidate still differs."""
    best = tuple(objects)
    left = attempts
    progress = True
    while progress:
        progress = False
        for make in (_without_objects, _without_fields):
            start = 0
            while left > 0:
                found = next(((at, each) for at, each in enumerate(make(best)) if at >= start), None)
                if found is None:
                    break
                start, candidate = found
                left -= 1
                if (yield candidate):
                    # What follows has moved up to this place.
                    best, progress = candidate, True
                else:
                    start += 1
    return best


def shrunk(objects: Sequence[Json], differs: Callable[[Objects], bool], *, attempts: int = 500) -> Objects:
    """The smallest found for which `differs` still holds."""
    steps = reduction(objects, attempts=attempts)
    try:
        candidate = next(steps)
        while True:
            candidate = steps.send(differs(candidate))
    except StopIteration as stop:
        smallest: Objects = stop.value
        return smallest


def _without_objects(objects: Objects) -> Iterator[Objects]:
    """Runs of objects left out, from long to short; the last one, the pod to place, stays."""
    count = len(objects) - 1
    size = count
    while size >= 1:
        for start in range(0, count, size):
            yield objects[:start] + objects[min(start + size, count) :]
        size //= 2


def _without_fields(objects: Objects) -> Iterator[Objects]:
    """One field or list element of one object left out, the largest parts first."""
    for at, item in enumerate(objects):
        paths = sorted(_paths(item), key=lambda path: (len(path), str(path)))
        for path in paths:
            if path not in KEPT:
                yield (*objects[:at], _without(item, path), *objects[at + 1 :])


def _paths(value: Any, here: Path = ()) -> Iterator[Path]:
    keys: Sequence[str | int] = list(value) if isinstance(value, dict) else []
    if isinstance(value, list):
        keys = range(len(value) - 1, -1, -1)
    for key in keys:
        yield (*here, key)
        yield from _paths(value[key], (*here, key))


def _without(item: Json, path: Path) -> Json:
    made = deepcopy(item)
    holder: Any = made
    for key in path[:-1]:
        holder = holder[key]
    del holder[path[-1]]
    return made


def size(objects: Sequence[Json]) -> int:
    """For comparison: characters of JSON."""
    return len(json.dumps(objects))
