"""Families about volumes: restrictions, limits, bound and unusable claims, binding on first use, zones."""

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import OLD_ZONE, REGION, ZONE, ZONES, Json, Scene, terminate

_DRIVER, _OTHER = "csi.example.com", "slow.example.com"
_STORAGE = "storage.k8s.io/v1"
_SELECTED = "volume.kubernetes.io/selected-node"
_OPEN = "/tmp"  # noqa: S108 - a path in an object, never opened


def mount(pod: Json, claim: str) -> None:
    volumes = pod["spec"].setdefault("volumes", [])
    if all(each["name"] != claim for each in volumes):
        volumes.append({"name": claim, "persistentVolumeClaim": {"claimName": claim}})


def storage_class(scene: Scene, name: str, *, waits: bool, provisioner: str, **body: object) -> Json:
    mode = "WaitForFirstConsumer" if waits else "Immediate"
    return scene.add("StorageClass", name, api=_STORAGE, provisioner=provisioner, volumeBindingMode=mode, **body)


def claim(scene: Scene, name: str, *, namespace: str, size: str = "5Gi", kind: str = "", mode: str = "ReadWriteOnce",
          volume: str = "") -> Json:  # fmt: skip
    """Pending, or bound to `volume`."""
    spec: Json = {
        "accessModes": [mode],
        "storageClassName": kind,
        "volumeMode": "Filesystem",
        "resources": {"requests": {"storage": size}},
    }
    made = scene.add("PersistentVolumeClaim", name, namespace=namespace, spec=spec, status={"phase": "Pending"})
    if volume:
        spec["volumeName"] = volume
        made["metadata"]["annotations"] = {"pv.kubernetes.io/bind-completed": "yes"}
        made["status"] = {"phase": "Bound"}
    return made


def volume(scene: Scene, name: str, *, size: str = "10Gi", kind: str = "", driver: str = "", of: Json | None = None,
           modes: tuple[str, ...] = ("ReadWriteOnce",), **labels: str) -> Json:  # fmt: skip
    """Available, or bound to the claim `of`; local unless a CSI driver is named."""
    source = {"csi": {"driver": driver, "volumeHandle": f"handle-{name}"}} if driver else {"hostPath": {"path": _OPEN}}
    spec: Json = {
        "capacity": {"storage": size},
        "accessModes": list(modes),
        "storageClassName": kind,
        "volumeMode": "Filesystem",
        "persistentVolumeReclaimPolicy": "Retain",
        **source,
    }
    made = scene.add("PersistentVolume", name, spec=spec, status={"phase": "Available"}, metadata={"labels": labels})
    if of is not None:
        meta = of["metadata"]
        spec["claimRef"] = {
            "apiVersion": "v1",
            "kind": "PersistentVolumeClaim",
            "namespace": meta["namespace"],
            "name": meta["name"],
            "uid": meta["uid"],
        }
        made["status"] = {"phase": "Bound"}
    return made


def bound(scene: Scene, name: str, *, namespace: str, mode: str = "ReadWriteOnce", driver: str = "") -> Json:
    """A claim with its volume; the volume."""
    made = claim(scene, name, namespace=namespace, mode=mode, volume=f"pv-{namespace}-{name}")
    return volume(scene, f"pv-{namespace}-{name}", of=made, modes=(mode,), driver=driver)


def exclusive_claims(choices: Choices, scene: Scene) -> None:
    """ReadWriteOncePod: one claim or two, each in use by nobody, by one other pod or by several.

    A pod of another namespace has a claim of that name only where there is no other user: in dry runs upstream counts
    names alone.
    """
    namespace = scene.pod["metadata"]["namespace"]
    modes = ("ReadWriteOncePod", "ReadWriteOncePod", "ReadWriteMany")
    names = ("once", "again")[: choices.pick((1, 1, 2))]
    for name in names:
        bound(scene, name, namespace=namespace, mode=choices.pick(modes))
        mount(scene.pod, name)
        neighbours = [pod for pod in scene.placed if pod["metadata"]["namespace"] == namespace]
        strangers = [pod for pod in scene.placed if pod["metadata"]["namespace"] != namespace]
        if strangers and len(names) == 1 and choices.chance(20):
            user = choices.pick(strangers)
            bound(scene, name, namespace=user["metadata"]["namespace"], mode="ReadWriteOncePod")
            mount(user, name)
        elif neighbours and choices.chance(70):
            for at in choices.some(range(len(neighbours)), least=1, most=choices.pick((1, 1, 2, 3))):
                mount(neighbours[at], name)


def inline_disks(choices: Choices, scene: Scene) -> None:
    """iSCSI and RBD, the two in-tree disks that were never migrated."""
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(50):
            source = choices.pick(
                (
                    {
                        "iscsi": {
                            "targetPortal": "10.0.0.1:3260",
                            "iqn": choices.pick(("iqn.2001-04.com.example:a", "iqn.2001-04.com.example:b")),
                            "lun": 0,
                        }
                    },
                    {
                        "rbd": {
                            "monitors": choices.some(("m1", "m2"), least=1),
                            "pool": choices.pick(("rbd", "p")),
                            "image": "map",
                        }
                    },
                )
            )
            if choices.chance(50):
                next(iter(source.values()))["readOnly"] = True
            pod["spec"].setdefault("volumes", []).append({"name": "disk", **source})


def volume_limits(choices: Choices, scene: Scene) -> None:
    """CSI drivers that take a few volumes per node; shared and merely attached volumes count once."""
    storage_class(scene, "lazy", waits=True, provisioner=_DRIVER)
    for node in scene.nodes:
        if choices.chance(85):
            name = node["metadata"]["name"]
            drivers: list[Json] = []
            for driver in (_DRIVER, _OTHER):
                if choices.chance(70):
                    room = choices.pick(({"count": 1}, {"count": 2}, {"count": 0}, {}))
                    drivers.append({"name": driver, "nodeID": name, "topologyKeys": [], "allocatable": room})
            scene.add("CSINode", name, api=_STORAGE, spec={"drivers": drivers})
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(60):
            for name in choices.some(("a", "b", "c"), least=1, most=2):
                driver = _OTHER if name == "c" else _DRIVER
                bound(scene, name, namespace=pod["metadata"]["namespace"], driver=driver)
                mount(pod, name)
    if choices.chance(40):
        claim(scene, "lazy", namespace=scene.pod["metadata"]["namespace"], kind="lazy")
        mount(scene.pod, "lazy")
    for node in scene.nodes:
        if choices.chance(25):
            attached = choices.pick(scene.of_kind("PersistentVolume"))["metadata"]["name"]
            driver = _OTHER if attached.endswith("-c") else _DRIVER
            spec = {
                "attacher": driver,
                "nodeName": node["metadata"]["name"],
                "source": {"persistentVolumeName": attached},
            }
            scene.add("VolumeAttachment", f"va-{node['metadata']['name']}", api=_STORAGE, spec=spec)


def missing_drivers(choices: Choices, scene: Scene) -> None:
    """1.37: a driver may insist on being installed where its volumes go."""
    body = {"attachRequired": True, "preventPodSchedulingIfMissing": choices.pick((True, False))}
    scene.add("CSIDriver", _DRIVER, api=_STORAGE, spec=body)
    for node in scene.nodes:
        name = node["metadata"]["name"]
        driver = {"name": choices.pick((_DRIVER, _OTHER)), "nodeID": name, "topologyKeys": []}
        scene.add("CSINode", name, api=_STORAGE, spec={"drivers": [driver]})
    bound(scene, "a", namespace=scene.pod["metadata"]["namespace"], driver=_DRIVER)
    mount(scene.pod, "a")


def bound_claims(choices: Choices, scene: Scene) -> None:
    """Bound volumes that are not everywhere."""
    for name in choices.some(("a", "b"), least=1):
        made = bound(scene, name, namespace=scene.pod["metadata"]["namespace"])
        if choices.chance(70):
            made["spec"]["nodeAffinity"] = node_affinity(choices, scene)
        mount(scene.pod, name)


def node_affinity(choices: Choices, scene: Scene) -> Json:
    """Of a volume: by zone, by disk, or on named hosts as local volumes are."""
    expression = choices.pick(
        (
            {"key": "kubernetes.io/hostname", "operator": "In", "values": choices.some(scene.names(), least=1)},
            {"key": ZONE, "operator": "In", "values": choices.some(ZONES, least=1)},
            {"key": "disk", "operator": "Exists"},
            {"key": "rack", "operator": "NotIn", "values": ["r0"]},
        )
    )
    return {"required": {"nodeSelectorTerms": [{"matchExpressions": [expression]}]}}


def unusable_claims(choices: Choices, scene: Scene) -> None:
    """What PreFilter refuses: missing, lost, deleted, not bound in time."""
    namespace = scene.pod["metadata"]["namespace"]
    trouble = choices.pick(
        ("missing", "unbound", "lost", "deleting", "prebound", "no class", "no ephemeral", "no volume")
    )
    name = "bad"
    if trouble == "no ephemeral":
        template = {"spec": {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "1Gi"}}}}
        scene.pod["spec"].setdefault("volumes", []).append(
            {"name": name, "ephemeral": {"volumeClaimTemplate": template}}
        )
        return
    mount(scene.pod, name)
    if trouble == "unbound":
        storage_class(scene, "eager", waits=False, provisioner=_DRIVER)
        claim(scene, name, namespace=namespace, kind="eager")
    elif trouble == "lost":
        claim(scene, name, namespace=namespace, volume="pv-lost")["status"] = {"phase": "Lost"}
    elif trouble == "deleting":
        bound(scene, name, namespace=namespace)
        terminate(next(each for each in scene.of_kind("PersistentVolumeClaim") if each["metadata"]["name"] == name))
    elif trouble == "prebound":
        storage_class(scene, "lazy", waits=True, provisioner=_DRIVER)
        claim(scene, name, namespace=namespace, kind="lazy")["spec"]["volumeName"] = "pv-wanted"
    elif trouble == "no class":
        claim(scene, name, namespace=namespace, kind=choices.pick(("", "unheard-of")))
    elif trouble == "no volume":
        claim(scene, name, namespace=namespace, volume="pv-gone")


def static_volumes(choices: Choices, scene: Scene) -> None:
    """WaitForFirstConsumer with volumes made by hand. No two are of one size: which of them wins would be random."""
    namespace = scene.pod["metadata"]["namespace"]
    provisioner = choices.pick(("kubernetes.io/no-provisioner", "kubernetes.io/no-provisioner", _DRIVER))
    storage_class(scene, "local", waits=True, provisioner=provisioner)
    for index in range(choices.pick((1, 2))):
        name = f"data{index}"
        made = claim(scene, name, namespace=namespace, kind="local", size=("5Gi", "8Gi")[index])
        if choices.chance(25):
            made["spec"]["selector"] = {"matchLabels": {"speed": "fast"}}
        if choices.chance(10):
            made["spec"]["accessModes"] = ["ReadWriteMany"]
        mount(scene.pod, name)
    for index in range(choices.pick((2, 0, 1, 4, 6))):
        _static(choices, scene, index)


def _static(choices: Choices, scene: Scene, index: int) -> None:
    size = f"{choices.pick((10, 4, 5, 20)) + index}Gi"
    sizes = {each["spec"]["capacity"]["storage"] for each in scene.of_kind("PersistentVolume")}
    if size in sizes:
        size = f"{100 + index}Gi"
    labels = {"speed": choices.pick(("fast", "slow"))}
    made = volume(scene, f"pv{index}", kind=choices.pick(("local", "local", "local", "else")), size=size, **labels)
    if choices.chance(80):
        made["spec"]["nodeAffinity"] = node_affinity(choices, scene)
    if choices.chance(15):
        made["status"]["phase"] = choices.pick(("Released", "Bound", "Pending"))
    reserved = {(each["spec"].get("claimRef") or {}).get("name") for each in scene.of_kind("PersistentVolume")}
    wanted = choices.pick(("data0", "data9"))
    if choices.chance(12) and wanted not in reserved:
        made["spec"]["claimRef"] = {"namespace": scene.pod["metadata"]["namespace"], "name": wanted}


def provisioning(choices: Choices, scene: Scene) -> None:
    """Volumes made on demand, where the class allows; a node may be selected already."""
    namespace = scene.pod["metadata"]["namespace"]
    made = storage_class(scene, "lazy", waits=True, provisioner=choices.pick((_DRIVER, "rancher.io/local-path")))
    if choices.chance(60):
        terms = [[{"key": ZONE, "values": choices.some(ZONES, least=1)}]]
        if choices.chance(30):
            terms.append([{"key": "disk", "values": ["ssd"]}, {"key": "rack", "values": ["r0", "r1"]}])
        made["allowedTopologies"] = [{"matchLabelExpressions": each} for each in terms]
    for index in range(choices.pick((1, 2))):
        one = claim(scene, f"data{index}", namespace=namespace, kind="lazy")
        if choices.chance(30):
            one["metadata"]["annotations"] = {_SELECTED: choices.pick((*scene.names(), "gone"))}
        mount(scene.pod, f"data{index}")


def storage_capacity(choices: Choices, scene: Scene) -> None:
    """Drivers that tell how much room there is; each node sees at most one object per class."""
    namespace = scene.pod["metadata"]["namespace"]
    opted = choices.pick((True, True, True, False))
    scene.add("CSIDriver", _DRIVER, api=_STORAGE, spec={"attachRequired": False, "storageCapacity": opted})
    for kind in choices.some(("lazy", "quick"), least=1):
        storage_class(scene, kind, waits=True, provisioner=_DRIVER)
        for zone in choices.some(ZONES):
            topology = {"matchLabels": {ZONE: zone}}
            body = {
                "storageClassName": kind,
                "nodeTopology": topology,
                "capacity": choices.pick(("10Gi", "20Gi", "4Gi", "0")),
            }
            if choices.chance(25):
                body["maximumVolumeSize"] = choices.pick(("5Gi", "1Gi"))
            scene.add("CSIStorageCapacity", f"{kind}-{zone}", namespace="default", api=_STORAGE, **body)
        for index in range(choices.pick((1, 2))):
            claim(scene, f"{kind}{index}", namespace=namespace, kind=kind, size=choices.pick(("5Gi", "2Gi", "12Gi")))
            mount(scene.pod, f"{kind}{index}")


def volume_zones(choices: Choices, scene: Scene) -> None:
    """Zone and region labels of bound volumes, new and old keys, several zones in one."""
    for name in choices.some(("a", "b"), least=1):
        made = bound(scene, name, namespace=scene.pod["metadata"]["namespace"])
        for key in choices.some((ZONE, REGION, OLD_ZONE), least=1):
            if key == REGION:
                made["metadata"]["labels"][key] = choices.pick(("r1", "r2"))
            else:
                made["metadata"]["labels"][key] = "__".join(choices.some(ZONES, least=1))
        mount(scene.pod, name)
    for node in scene.nodes:
        labels = node["metadata"]["labels"]
        if choices.chance(50):
            labels[REGION] = choices.pick(("r1", "r2"))
        if choices.chance(25):
            labels[OLD_ZONE] = labels.get(ZONE, "z0")
