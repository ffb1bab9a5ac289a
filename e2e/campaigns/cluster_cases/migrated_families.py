"""Families about disks of the old in-tree kinds that CSI drivers have taken over: where they are, and how many fit."""

from campaigns.cluster_cases import storage_families as storage
from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import OLD_REGION, OLD_ZONE, REGION, ZONE, Json, Scene

_STORAGE = "storage.k8s.io/v1"
_MIGRATED = "storage.alpha.kubernetes.io/migrated-plugins"
_PLACES = ("eu-west1-a", "eu-west1-b")
_KINDS = {
    "kubernetes.io/aws-ebs": ("ebs.csi.aws.com", "topology.ebs.csi.aws.com/zone"),
    "kubernetes.io/gce-pd": ("pd.csi.storage.gke.io", "topology.gke.io/zone"),
    "kubernetes.io/azure-disk": ("disk.csi.azure.com", "topology.disk.csi.azure.com/zone"),
    "kubernetes.io/cinder": ("cinder.csi.openstack.org", "topology.cinder.csi.openstack.org/zone"),
    "kubernetes.io/portworx-volume": ("pxd.portworx.com", ""),
    "kubernetes.io/vsphere-volume": ("csi.vsphere.vmware.com", "topology.csi.vmware.com/zone"),
}


def _source(choices: Choices, plugin: str, name: str) -> Json:
    """What of a volume names the disk `name`."""
    match plugin:
        case "kubernetes.io/aws-ebs":
            return {"awsElasticBlockStore": {"volumeID": f"{choices.pick(('', 'aws://eu-west1-a/'))}vol-{name}"}}
        case "kubernetes.io/gce-pd":
            return {"gcePersistentDisk": {"pdName": name}}
        case "kubernetes.io/azure-disk":
            uri = f"/subscriptions/s/resourceGroups/g/providers/Microsoft.Compute/disks/{name}"
            return {"azureDisk": {"diskName": name, "diskURI": uri, "kind": "Managed"}}
        case "kubernetes.io/cinder":
            return {"cinder": {"volumeID": name}}
        case "kubernetes.io/portworx-volume":
            return {"portworxVolume": {"volumeID": name}}
    return {"vsphereVolume": {"volumePath": f"[store] {name}"}}


def _csi_nodes(choices: Choices, scene: Scene, plugin: str) -> None:
    driver, key = _KINDS[plugin]
    for node in scene.nodes:
        name, place = node["metadata"]["name"], choices.pick(_PLACES)
        labels = node["metadata"]["labels"]
        if choices.chance(80):
            labels[choices.pick((ZONE, OLD_ZONE))] = place
        if choices.chance(40):
            labels[choices.pick((REGION, OLD_REGION))] = "eu-west1"
        if key and choices.chance(70):
            labels[key] = place
        if choices.chance(85):
            room = choices.pick(({"count": 1}, {"count": 2}, {}, {"count": 0}))
            drivers = [{"name": driver, "nodeID": name, "topologyKeys": [], "allocatable": room}]
            meta = {"annotations": {_MIGRATED: choices.pick((plugin, plugin, "kubernetes.io/other", ""))}}
            spec = {"drivers": drivers if choices.chance(80) else []}
            scene.add("CSINode", name, api=_STORAGE, spec=spec, metadata=meta)


def _affinity(choices: Choices) -> Json:
    keys = choices.pick(((ZONE,), (OLD_ZONE,), (OLD_ZONE, OLD_REGION), (ZONE, REGION), ("disk",)))
    expressions = []
    for key in keys:
        if key == "disk":
            expressions.append({"key": key, "operator": "Exists"})
        else:
            values = choices.some(_PLACES, least=1) if "zone" in key else ["eu-west1"]
            expressions.append({"key": key, "operator": "In", "values": values})
    return {"required": {"nodeSelectorTerms": [{"matchExpressions": expressions}]}}


def migrated_volumes(choices: Choices, scene: Scene) -> None:
    """Bound, to be made, or named in the pod itself; on nodes that have migrated the kind, or not yet."""
    plugin = choices.pick(tuple(_KINDS))
    _csi_nodes(choices, scene, plugin)
    if choices.chance(30):
        body = {"attachRequired": True, "preventPodSchedulingIfMissing": choices.pick((True, False))}
        scene.add("CSIDriver", _KINDS[plugin][0], api=_STORAGE, spec=body)
    storage.storage_class(scene, "lazy", waits=True, provisioner=plugin)
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(50):
            _use(choices, scene, pod, plugin)


def _use(choices: Choices, scene: Scene, pod: Json, plugin: str) -> None:
    namespace = pod["metadata"]["namespace"]
    for name in choices.some(("a", "b"), least=1):
        made = storage.bound(scene, name, namespace=namespace)
        if "hostPath" in made["spec"]:
            del made["spec"]["hostPath"]
            made["spec"] |= _source(choices, plugin, made["metadata"]["name"])
            if choices.chance(50):
                made["spec"]["nodeAffinity"] = _affinity(choices)
            if choices.chance(50):
                key = choices.pick((ZONE, OLD_ZONE))
                made["metadata"]["labels"][key] = "__".join(choices.some(_PLACES, least=1))
        storage.mount(pod, name)
    if choices.chance(30):
        storage.claim(scene, "lazy", namespace=namespace, kind="lazy")
        storage.mount(pod, "lazy")
    inline = _source(choices, plugin, choices.pick(("x", "y")))
    if choices.chance(40) and all(each["name"] != "inline" for each in pod["spec"].get("volumes") or []):
        pod["spec"].setdefault("volumes", []).append({"name": "inline", **inline})
