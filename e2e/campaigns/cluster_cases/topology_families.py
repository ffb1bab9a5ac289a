"""Families about pods beside pods: topology spread and pod affinity."""

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.node_families import affinity
from campaigns.cluster_cases.scene import HOSTNAME, NAMESPACES, TIERS, ZONE, Json, Scene, draw_key, draw_selector

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
_HARD, _SOFT = "DoNotSchedule", "ScheduleAnyway"


def hard_spread(choices: Choices, scene: Scene) -> None:
    _spread(choices, scene, _HARD)


def soft_spread(choices: Choices, scene: Scene) -> None:
    _spread(choices, scene, _SOFT)


def _spread(choices: Choices, scene: Scene, action: str) -> list[Json]:
    """One to three constraints; a topology key comes once per action."""
    made = []
    constraints = scene.pod["spec"].setdefault("topologySpreadConstraints", [])
    for _ in range(choices.pick((1, 2, 3))):
        one: Json = {
            "topologyKey": draw_key(choices),
            "maxSkew": choices.pick((1, 2, 5)),
            "whenUnsatisfiable": action,
        }
        if (selector := draw_selector(choices)) is not None:
            one["labelSelector"] = selector
        if all(
            (each["topologyKey"], each["whenUnsatisfiable"]) != (one["topologyKey"], action) for each in constraints
        ):
            constraints.append(one)
            made.append(one)
    return made


def spread_policies(choices: Choices, scene: Scene) -> None:
    """minDomains, inclusion policies, label keys; with a node selector and taints for the policies to see."""
    for one in _spread(choices, scene, choices.pick((_HARD, _SOFT))):
        if one["whenUnsatisfiable"] == _HARD and choices.chance(50):
            one["minDomains"] = choices.pick((1, 2, 3, 5))
        if choices.chance(50):
            one["nodeAffinityPolicy"] = choices.pick(("Honor", "Ignore"))
        if choices.chance(50):
            one["nodeTaintsPolicy"] = choices.pick(("Ignore", "Honor"))
        if "labelSelector" in one and choices.chance(40):
            one["matchLabelKeys"] = ["rev"]
    if choices.chance(50):
        scene.pod["spec"]["nodeSelector"] = {"disk": "ssd"}
    for node in scene.nodes:
        if choices.chance(30):
            effect = choices.pick(("NoSchedule", "PreferNoSchedule", "NoExecute"))
            node["spec"]["taints"] = [{"key": "dedicated", "effect": effect}]
    if choices.chance(30):
        scene.pod["spec"]["tolerations"] = [{"key": "dedicated", "operator": "Exists"}]


def default_spread(choices: Choices, scene: Scene) -> None:
    """No constraints, but Services or an owner to derive them from."""
    for index in range(choices.pick((1, 0, 2))):
        wanted: Json = choices.pick(({"app": "a"}, {"app": "b"}, {"tier": "x"}, {"app": "a", "tier": "y"}))
        namespace = choices.pick(("default", "default", "other"))
        ports = [{"port": 80, "protocol": "TCP"}]
        scene.add("Service", f"svc{index}", namespace=namespace, spec={"selector": wanted, "ports": ports})
    kind = choices.pick((None, "ReplicaSet", "StatefulSet", "ReplicationController"))
    if kind is not None and scene.pod["metadata"]["labels"]:
        _own(choices, scene, kind)


def _own(choices: Choices, scene: Scene, kind: str) -> None:
    """The owner's selector takes the pod's own labels, as a real controller's does; it may have gone since."""
    labels = scene.pod["metadata"]["labels"]
    selector: Json = {"matchLabels": {"app": labels["app"]}}
    if "tier" in labels and choices.chance(50):
        selector["matchExpressions"] = [{"key": "tier", "operator": "In", "values": list(TIERS)}]
    api = "v1" if kind == "ReplicationController" else "apps/v1"
    owner = {"apiVersion": api, "kind": kind, "name": "owner", "uid": "uid-owner", "controller": True}
    scene.pod["metadata"]["ownerReferences"] = [owner]
    if choices.chance(15):
        return
    template = {"metadata": {"labels": dict(labels)}, "spec": {"containers": [{"name": "c", "image": "x"}]}}
    body: Json = {"selector": selector, "template": template, "replicas": 0}
    if kind == "ReplicationController":
        body["selector"] = {"app": labels["app"]}
    if kind == "StatefulSet":
        body["serviceName"] = "none"
    scene.add(kind, "owner", namespace=scene.pod["metadata"]["namespace"], api=api, spec=body)["metadata"]["uid"] = (
        "uid-owner"
    )


def required_pod_affinity(choices: Choices, scene: Scene) -> None:
    terms = [_term(choices) for _ in range(choices.pick((1, 1, 2)))]
    affinity(scene.pod, "podAffinity")[_REQUIRED] = terms


def required_anti_affinity(choices: Choices, scene: Scene) -> None:
    terms = [_term(choices) for _ in range(choices.pick((1, 1, 2)))]
    affinity(scene.pod, "podAntiAffinity")[_REQUIRED] = terms


def anti_affinity_of_others(choices: Choices, scene: Scene) -> None:
    for pod in scene.placed:
        if choices.chance(50):
            affinity(pod, "podAntiAffinity")[_REQUIRED] = [_term(choices) for _ in range(choices.pick((1, 1, 2)))]


def preferred_pod_affinity(choices: Choices, scene: Scene) -> None:
    """Both signs, of the pod and of the pods already there, and required terms of theirs, which score too."""
    for pod in scene.pods():
        for kind in ("podAffinity", "podAntiAffinity"):
            if choices.chance(60 if pod is scene.pod else 30):
                affinity(pod, kind)[_PREFERRED] = [
                    {"weight": choices.pick((1, 10, 50, 100)), "podAffinityTerm": _term(choices)}
                    for _ in range(choices.pick((1, 1, 2)))
                ]
        if pod is not scene.pod and choices.chance(25):
            affinity(pod, "podAffinity")[_REQUIRED] = [_term(choices)]


def affinity_namespaces(choices: Choices, scene: Scene) -> None:
    """Terms that look into other namespaces, in both directions and all kinds."""
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(40):
            kind = choices.pick(("podAffinity", "podAntiAffinity"))
            if choices.chance(50):
                affinity(pod, kind)[_REQUIRED] = [_anywhere(choices, _term(choices))]
            else:
                weighted = {"weight": choices.pick((1, 7, 100)), "podAffinityTerm": _anywhere(choices, _term(choices))}
                affinity(pod, kind)[_PREFERRED] = [weighted]


def _anywhere(choices: Choices, term: Json) -> Json:
    if choices.chance(40):
        term["namespaces"] = choices.some(list(NAMESPACES), least=1)
    if choices.chance(60):
        term["namespaceSelector"] = choices.pick(
            (
                {},
                {"matchLabels": {"team": "blue"}},
                {"matchExpressions": [{"key": "env", "operator": "DoesNotExist"}]},
                {"matchLabels": {"team": "nobody"}},
            )
        )
    return term


def affinity_label_keys(choices: Choices, scene: Scene) -> None:
    """matchLabelKeys and mismatchLabelKeys, which the API server turns into requirements."""
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(30):
            term = _term(choices)
            if term.get("labelSelector") is None:
                term["labelSelector"] = {}
            field = choices.pick(("matchLabelKeys", "mismatchLabelKeys"))
            term[field] = [choices.pick(("rev", "rev", "unknown"))]
            kind = choices.pick(("podAffinity", "podAntiAffinity"))
            if choices.chance(50):
                affinity(pod, kind)[_REQUIRED] = [term]
            else:
                affinity(pod, kind)[_PREFERRED] = [{"weight": 5, "podAffinityTerm": term}]


def _term(choices: Choices) -> Json:
    """Some topology keys are on few nodes; the most common are there to make pods meet."""
    key = choices.pick((ZONE, HOSTNAME, "rack", "disk", "unheard-of", ZONE, HOSTNAME))
    term: Json = {"topologyKey": key}
    if (selector := draw_selector(choices)) is not None:
        term["labelSelector"] = selector
    return term
