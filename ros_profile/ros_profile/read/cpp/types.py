"""Type names of C++ in the form `package/msg/Name`, and what stands for them: aliases and callback parameters."""

import re

_KINDS = {"msg", "srv", "action"}
_SUFFIX = re.compile(
    r"(?:::|\b)(?:ConstPtr|Ptr|SharedPtr|ConstSharedPtr|UniquePtr|ConstWeakPtr|WeakPtr)$|(?<=[a-z0-9])(?:ConstPtr|Ptr)$"
)
_WRAPPED = re.compile(r"^(?:std::)?(?:shared_ptr|unique_ptr|boost::shared_ptr|SharedPtr|MessageEvent)<(.*)>$")
_NOISE = re.compile(r"\b(?:const|typename|volatile|struct|class)\b|[&*\s]")


def plain(text: str) -> str:
    """The type without const, references, pointers and pointer wrappers: `sensor_msgs::msg::Image`."""
    name = _NOISE.sub("", text).lstrip(":")
    for _ in range(3):
        inner = _WRAPPED.match(name)
        if inner is None:
            break
        name = inner.group(1).split(",", 1)[0].lstrip(":")
    return _SUFFIX.sub("", name).removesuffix("::Request").removesuffix("::Response")


def ros_name(text: str, *, kind: str) -> str:
    """`package/kind/Name` of a C++ type; the plain name when no package stands in it (an alias, resolved later).

    A ROS 1 name (`sensor_msgs::Image`) has no kind: `kind` is what the call implies.
    """
    parts = plain(text).split("<", 1)[0].split("::")
    for index, part in enumerate(parts):
        if part in _KINDS and 0 < index < len(parts) - 1:
            return f"{parts[index - 1]}/{part}/{parts[index + 1]}"
    if len(parts) == 2 and parts[0].islower() and parts[0] not in {"std", "ros", "tf", "tf2"}:
        name = parts[1].removesuffix("Action") if kind == "action" else parts[1]
        return f"{parts[0]}/{kind}/{name}"
    return "::".join(parts)


_ALIAS = re.compile(r"\busing\s+(\w+)\s*=\s*([^;{}]{2,300}+);")
_TYPEDEF = re.compile(r"\btypedef\s+([\w:<>,\s]{2,300}?)\s+(\w+)\s*;")
_NAMESPACE = re.compile(r"\bnamespace\s+(\w+)\s*=\s*([\w:]{1,100})\s*;")
_USING = re.compile(r"\busing\s+((?:\w+::)+)(\w+)\s*;")


def aliases(code: str) -> dict[str, str]:
    """What `using`, `typedef` and namespace aliases of a file make of short names."""
    found: dict[str, str] = {}
    if "using" in code:
        found.update(_ALIAS.findall(code))
        found.update((name, scope + name) for scope, name in _USING.findall(code))
    if "typedef" in code:
        found.update((name, value) for value, name in _TYPEDEF.findall(code))
    found.update(_NAMESPACE.findall(code))
    return {name: re.sub(r"\s+", " ", value).strip() for name, value in found.items()}


def resolved(text: str, names: dict[str, str]) -> str:
    """The type with aliases of its first part and of its whole replaced, at most four times."""
    for _ in range(4):
        bare = plain(text)
        first, _, rest = bare.partition("::")
        if bare in names:
            text = names[bare]
        elif rest and first in names:
            text = f"{names[first]}::{rest}"
        else:
            break
    return text


_CALLBACK = re.compile(
    r"\b(?:void|bool|auto)\s+(?:[\w<>]{1,80}::)?(\w{2,80})\s*\(\s*"
    r"((?:const\s+)?[\w:]{3,120}(?:<[^<>]{0,200}(?:<[^<>]{0,100}>)?[^<>]{0,50}>)?[\w:]{0,40}(?:\s+const)?\s*&?)"
)
_STORED = re.compile(
    r"\b(?:Lifecycle)?(?P<role>Publisher|Subscription|Service|Client|RealtimePublisher|Subscriber|SimpleActionServer)"
    r"\s*<\s*(?P<type>[\w:]{3,120})\s*(?:,[^<>]{0,80})?>(?:::\w{0,20})?\s*>?\s+(?P<name>\w{2,80})\s*[;{=]"
)


def callback_types(code: str) -> dict[str, str]:
    """Type of the first parameter of each function, for `subscribe("scan", 1, &Node::callback)`."""
    return {name: kind for name, kind in _CALLBACK.findall(code) if "::" in kind or kind[:1].isupper()}


def stored_types(code: str) -> dict[str, str]:
    """Message type of each member that keeps a publisher or the like, by the member's name."""
    return {match["name"]: match["type"] for match in _STORED.finditer(code)}
