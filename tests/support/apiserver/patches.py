"""What each kind of patch makes of an object."""

from typing import Any

from tests.support.apiserver.store import Json, Refused, clone, merge
from tests.support.apiserver.trees import merged, plain, tree

from robotapp_client.api.bodies import JSON_PATCH, STRATEGIC


def patched(obj: Json, patch: Any, content_type: str) -> Json:
    if content_type == JSON_PATCH:
        result = clone(obj)
        for step in patch:
            _step(result, step)
        return result
    if content_type == STRATEGIC:
        strategic: Json = plain(merged(tree(obj), tree(patch)))
        return strategic
    merge_patched: Json = merge(obj, patch)
    return merge_patched


def _step(obj: Any, step: Json) -> None:
    """RFC 6902, as far as our clients write it. Raises Refused as the server does, which does not say what was wrong."""
    failed = False
    *way, last = [part.replace("~1", "/").replace("~0", "~") for part in step["path"].split("/")[1:]]
    try:
        for part in way:
            obj = obj[int(part)] if isinstance(obj, list) else obj[part]
        at: Any = last if isinstance(obj, dict) else len(obj) if last == "-" else int(last)
        match step["op"]:
            case "test":
                failed = obj[at] != step["value"]
            case "remove":
                del obj[at]
            case "replace":
                obj[at] = step["value"]
            case "add" if isinstance(obj, list):
                obj.insert(at, step["value"])
            case "add":
                obj[at] = step["value"]
    except (KeyError, IndexError):
        failed = True
    if failed:
        raise Refused(422, "Invalid", "the server rejected our request due to an error in our request")
