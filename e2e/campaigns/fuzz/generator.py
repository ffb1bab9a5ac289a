"""Random objects of our kinds that fit the structural schema, as far out as it allows. Rules (CEL) may still refuse them."""

import random
from typing import Any, Final

Schema = dict[str, Any]

NAMES: Final = ("a", "b", "c", "d")
"""Few, so that what names another component often finds one."""
_ODD: Final = (
    "",
    " ",
    "x",
    "0",
    "null",
    "$(ROS_DOMAIN_ID)",
    "é\u202e",
    "a\nb",
    "{{x}}",
    "'\"\\",
    "🤖" * 40,
    "-" * 63,
    "9" * 40,
)
_BY_PATTERN: Final[dict[str, tuple[str, ...]]] = {
    "^[a-z0-9]([-a-z0-9]*[a-z0-9])?$": (*NAMES, "0", "a-b", "z" * 30),
    "^[a-z0-9]([-a-z0-9]*[a-z0-9])?(\\.[a-z0-9]([-a-z0-9]*[a-z0-9])?)*$": (*NAMES, "a.b", "0.0"),
    "^[A-Za-z][A-Za-z0-9./-]*$": ("Ready", "X/y"),
    "^[A-Za-z]([A-Za-z0-9_,:]*[A-Za-z0-9_])?$": ("Odd", "A,b:c_"),
    "^([0-9]{1,3}(-[0-9]{1,3})?(,[0-9]{1,3}(-[0-9]{1,3})?){0,31})?$": ("", "1-5", "7", "0-232", "1,3,5-9"),
    "^([-._a-zA-Z0-9]|\\$\\((ROBOTAPP_ROBOT|ROBOTAPP_INSTANCE|ROBOTAPP_ORDINAL)\\))+$": (
        "k",
        "$(ROBOTAPP_ROBOT).yaml",
        "..",
        "-",
    ),
    "^(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$": ("/cmd_vel", "odom", "~/x", "/a/b/c"),
    "^(@robot|[a-z0-9]([-a-z0-9]*[a-z0-9])?)$": ("@robot", *NAMES),
    "^[a-z]+$": ("humble", "jazzy", "noetic", "rolling", "zzz"),
    "^([a-z0-9]([-a-z0-9.]*[a-z0-9])?/)?[A-Za-z0-9]([-A-Za-z0-9_.]*[A-Za-z0-9])?$": ("robotics.io/robot", "x/y", "A"),
    "^(([A-Za-z0-9][-A-Za-z0-9_.]*)?[A-Za-z0-9])?$": ("", "v", "A-b_c.d"),
    "^[0-9a-fA-F]{4}:[0-9a-fA-F]{4}(:.+)?$": ("8086:0b3a", "0000:ffff:é"),
    "^[a-zA-Z][a-zA-Z0-9_]*/((msg|srv|action)/)?[A-Z][A-Za-z0-9_]*$": ("std_msgs/msg/String", "A/B"),
    "^rmw_[a-z0-9_]+$": ("rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "rmw_zenoh_cpp", "rmw_0"),
}
_DURATIONS: Final = ("1us", "30ms", "1s", "999999h", "1h1m1s", "100ms")
_QUANTITIES: Final = ("1", "0", "500m", "1e10", "999999999999999E", "1n", 20, 0)
_DEPTH: Final = 14


class Generator:
    """The same seed makes the same objects."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def value(self, schema: Schema, *, name: str = "", depth: int = 0) -> Any:
        """A random value of this schema; `name` is the field it is for."""
        if "enum" in schema:
            return self._random.choice(schema["enum"])
        if schema.get("x-kubernetes-int-or-string"):
            return self._random.choice(_QUANTITIES)
        match schema.get("type"):
            case "object":
                return self._object(schema, depth)
            case "array":
                return self._list(schema, name, depth)
            case "string":
                return self._text(schema, name)
            case "integer":
                return self._whole(schema)
            case "boolean":
                return self._random.random() < 0.5
        return self._random.choice(("x", 1, True, {"a": "b"}))

    def _object(self, schema: Schema, depth: int) -> dict[str, Any]:
        fields, required = schema.get("properties", {}), set(schema.get("required", ()))
        if not fields:
            return {
                self._random.choice(("k", "robotics.io/robot", "x")): self._entry(schema, depth)
                for _ in range(self._random.randrange(3))
            }
        share = self._random.choice((0.1, 0.4, 0.9)) if depth < _DEPTH else 0.0
        chosen = [name for name in fields if name in required or self._random.random() < share]
        return {name: self.value(fields[name], name=name, depth=depth + 1) for name in chosen}

    def _entry(self, schema: Schema, depth: int) -> Any:
        inner = schema.get("additionalProperties")
        return self.value(inner, depth=depth + 1) if isinstance(inner, dict) else "v"

    def _list(self, schema: Schema, name: str, depth: int) -> list[Any]:
        most = min(schema.get("maxItems", 4), self._random.choice((1, 2, 4)))
        count = self._random.randint(min(schema.get("minItems", 0), most), most)
        found = [self.value(schema["items"], name=name, depth=depth + 1) for _ in range(count)]
        keys = schema.get("x-kubernetes-list-map-keys")
        if keys:
            by_key = {tuple(str(each.get(key)) for key in keys): each for each in found if isinstance(each, dict)}
            return list(by_key.values())
        if schema.get("x-kubernetes-list-type") == "set":
            return list(dict.fromkeys(map(str, found)))
        return found

    def _text(self, schema: Schema, name: str) -> str:
        pattern = schema.get("pattern", "")
        if "(us|ms|s|m|h)" in pattern:
            found: str = self._random.choice(_DURATIONS)
        elif pattern in _BY_PATTERN:
            found = self._random.choice(_BY_PATTERN[pattern])
        elif schema.get("format") == "date-time":
            found = self._random.choice(("2026-01-01T00:00:00Z", "1970-01-01T00:00:00Z", "9999-12-31T23:59:59Z"))
        elif name in ("name", "image", "inline"):
            found = self._random.choice((*NAMES, "reg.example/x:1", "a: [1", "x:\n  ros__parameters:\n    y: 1\n"))
        else:
            found = self._random.choice(_ODD)
        longest = schema.get("maxLength", 253)
        return found[:longest] or ("x" if schema.get("minLength") else "")

    def _whole(self, schema: Schema) -> int:
        low, high = schema.get("minimum", 0), schema.get("maximum", 2**31 - 1)
        return int(self._random.choice((low, high, self._random.randint(low, high))))

    def app(self, schema: Schema, name: str) -> dict[str, Any]:
        """A RobotApp. Most are mended so far that the API server's rules mostly take them; the others show that it refuses."""
        spec = self._object({**schema["properties"]["spec"], "required": ["ros", "components"]}, 1)
        if self._random.random() < 0.85:
            _mend(spec, distro=self._random.choice(("humble", "jazzy", "noetic")))
        return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


def _mend(spec: dict[str, Any], *, distro: str) -> None:
    """Keep what is odd and drop what contradicts itself by chance."""
    spec["ros"] = {"distro": distro}
    components = spec["components"] = spec.get("components", [])[: len(NAMES)] or [{}]
    names = NAMES[: len(components)]
    for component, own in zip(components, names, strict=True):
        _mend_component(component, own, names)
    ends = {"@robot", *names} if spec.get("robots") else set(names)
    spec["edges"] = [edge for edge in spec.get("edges", ()) if {edge.get("from"), edge.get("to")} <= ends]
    if "robots" in spec:
        spec["robots"]["nodeSelector"] = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
    spec.pop("ros2" if distro == "noetic" else "ros1", None)
    for settings in ("ros1", "ros2"):
        for field in ("uri", "master", "shareWith", "domain"):
            spec.get(settings, {}).pop(field, None)


def _mend_component(component: dict[str, Any], own: str, names: tuple[str, ...]) -> None:
    component |= {"name": own, "image": component.get("image", "").strip() or "reg.example/x:1"}
    others = [name for name in names if name != own]
    component["colocateWith"] = [name for name in component.get("colocateWith", ()) if name in others]
    component["separateFrom"] = [
        name for name in component.get("separateFrom", ()) if name in others and name not in component["colocateWith"]
    ]
    component["runsOn"] = list(dict.fromkeys(component.get("runsOn", ())))
    component["parameters"] = [
        {"inline": each["inline"]} for each in component.get("parameters", ()) if "inline" in each
    ]
    if component["parameters"]:
        component["args"] = ["run"]
    for field in ("ready", "sharedData", "template"):
        component.pop(field, None)
    for device in component.get("devices", ()):
        device.pop("count", None)
    if component.get("devices"):
        component["replicas"] = 1
