"""Privilege escalation: a writer of RobotApps, a tenant or a stolen token wants more than it was given."""

from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Kind, Stop
from tests.live.attacks.table.kinds import app, templated
from tests.support.apiobjects import AMR_07

_C: Final = "spec.components[0]"
_POD: Final = f"{_C}.template.spec"
_KEY: Final = {"name": "deploy-key", "key": "id_rsa"}
_FROM_SECRET: Final = [{"name": "KEY", "valueFrom": {"secretKeyRef": _KEY}}]
_OPENS: Final = "chmod +r /root"


def _reference(key: str, text: str, changes: Json, good: Json | None = None) -> Attack:
    return Attack(key, text, "clerk", kinds.ROBOTAPP, good or app(), changes, Stop.REFERENCES)


def _init(**fields: Any) -> list[Json]:
    return [{"name": "first", "image": "ros:humble", **fields}]


def _override(**fields: Any) -> list[Json]:
    """Values for some robots, of the component that every app of this table has."""
    name = app()["spec"]["components"][0]["name"]
    return [{"name": "some", **AMR_07, "components": [{"name": name, **fields}]}]


def _projected(key: str, text: str, *sources: Json) -> Attack:
    """Sources of one projected volume."""
    return _reference(key, text, {f"{_POD}.volumes": [{"name": "v", "projected": {"sources": list(sources)}}]})


_OTHER: Final = {"name": "other", "image": "ros:humble"}
_TOKEN: Final = {"serviceAccountToken": {"path": "token"}}
_CERTIFICATE: Final = {"podCertificate": {"signerName": "example.com/s", "keyType": "ED25519", "keyPath": "key"}}
_GMSA: Final = {"windowsOptions": {"gmsaCredentialSpecName": "deployer"}}
_PORTS: Final = [{"name": "http", "port": 80}]
_WITH_SECRET: Final = app(env=_FROM_SECRET)
_WITH_ACCOUNT: Final = templated(serviceAccountName="deployer")


def _exposure(key: str, text: str, service: Json) -> Attack:
    """A component's Service that others than pods of the cluster obey or reach."""
    return Attack(key, text, "clerk", kinds.ROBOTAPP, app(), {f"{_C}.service": service}, Stop.SERVICES)


SERVICES: Final = (
    _exposure("node-port", "open a port on all nodes", {"spec": {"type": "NodePort", "ports": _PORTS}}),
    _exposure("load-balancer", "open a port at the load balancer", {"spec": {"type": "LoadBalancer", "ports": _PORTS}}),
    _exposure(
        "annotated-service",
        "have another program give the component a public name",
        {"metadata": {"annotations": {"example.com/hostname": "bank.example.com"}}, "spec": {"ports": _PORTS}},
    ),
    Attack(
        "external",
        "open discovery servers to the outside",
        "clerk",
        kinds.ROBOTAPP,
        app(),
        {"spec.ros2": {"external": {"expose": "NodePort"}}},
        Stop.SERVICES,
    ),
)
REFERENCES: Final = (
    _reference("account", "name a ServiceAccount", {f"{_POD}.serviceAccountName": "deployer"}),
    _reference("secret-env", "take an environment variable from a Secret", {f"{_C}.env": _FROM_SECRET}),
    _reference(
        "secret-env-from", "take all of a Secret as environment", {f"{_C}.envFrom": [{"secretRef": {"name": "s"}}]}
    ),
    _reference(
        "secret-optional",
        "the same, marked optional behind a ConfigMap",
        {f"{_C}.envFrom": [{"configMapRef": {"name": "c"}}, {"secretRef": {"name": "s", "optional": True}}]},
    ),
    _reference(
        "secret-volume", "mount a Secret", {f"{_POD}.volumes": [{"name": "v", "secret": {"secretName": "deploy-key"}}]}
    ),
    _reference(
        "secret-projected",
        "mount a Secret inside a projected volume",
        {f"{_POD}.volumes": [{"name": "v", "projected": {"sources": [{"secret": {"name": "deploy-key"}}]}}]},
    ),
    _projected("token", "the token of `default` in a projected volume", _TOKEN),
    _projected(
        "token-audience",
        "the same for an audience of one's choice",
        {"serviceAccountToken": {"path": "t", "audience": "vault", "expirationSeconds": 600}},
    ),
    _projected(
        "token-behind",
        "the same behind a ConfigMap",
        {"configMap": {"name": "c", "items": [{"key": "k", "path": "k"}]}},
        _TOKEN,
    ),
    _reference(
        "token-later",
        "the same in a later component",
        {
            "spec.components[1]": _OTHER
            | {"template": {"spec": {"volumes": [{"name": "v", "projected": {"sources": [_TOKEN]}}]}}}
        },
    ),
    _projected("certificate", "a certificate of `default` in a projected volume", _CERTIFICATE),
    _projected("certificate-behind", "the same beside a token", _TOKEN, _CERTIFICATE),
    _reference(
        "priority-node", "the priority of the node's own pods", {f"{_POD}.priorityClassName": "system-node-critical"}
    ),
    _reference(
        "priority-cluster",
        "the priority of the cluster's own pods",
        {f"{_POD}.priorityClassName": "system-cluster-critical"},
    ),
    _reference("priority-named", "a PriorityClass of the cluster", {f"{_POD}.priorityClassName": "robots-first"}),
    _reference("windows-pod", "a group account of Windows", {f"{_POD}.securityContext": _GMSA}),
    _reference("windows-container", "the same for the container", {f"{_C}.securityContext": _GMSA}),
    _reference(
        "windows-init",
        "the same for an init container",
        {f"{_POD}.initContainers": _init(securityContext=_GMSA)},
    ),
    _reference(
        "windows-beside",
        "the same for a further container",
        {f"{_POD}.containers": _init(securityContext=_GMSA)},
    ),
    _reference(
        "csi-volume",
        "mount a volume of a CSI driver with its Secret",
        {
            f"{_POD}.volumes": [
                {"name": "v", "csi": {"driver": "d", "nodePublishSecretRef": {"name": "s"}}},
            ]
        },
    ),
    _reference(
        "nfs-volume",
        "have the node mount files of another host",
        {f"{_POD}.volumes": [{"name": "v", "nfs": {"server": "10.0.0.1", "path": "/"}}]},
    ),
    _reference("secret-pull", "use a pull secret", {f"{_POD}.imagePullSecrets": [{"name": "registry"}]}),
    _reference(
        "priority-helper",
        "name a PriorityClass of discovery servers",
        {"spec.ros2": {"discovery": {"template": {"spec": {"priorityClassName": "critical"}}}}},
    ),
    _reference(
        "windows-pod-helper",
        "take an identity of Windows for the pod of discovery servers",
        {
            "spec.ros2": {
                "discovery": {
                    "template": {"spec": {"securityContext": {"windowsOptions": {"gmsaCredentialSpecName": "g"}}}}
                }
            }
        },
    ),
    _reference(
        "windows-helper",
        "take an identity of Windows of discovery servers",
        {"spec.ros2": {"discovery": {"securityContext": {"windowsOptions": {"gmsaCredentialSpecName": "g"}}}}},
    ),
    _reference(
        "priority-master",
        "name a PriorityClass of a master",
        {"spec.ros1": {"template": {"spec": {"priorityClassName": "critical"}}}},
    ),
    _reference(
        "windows-pod-master",
        "take an identity of Windows for the pod of a master",
        {"spec.ros1": {"template": {"spec": {"securityContext": {"windowsOptions": {"gmsaCredentialSpecName": "g"}}}}}},
    ),
    _reference(
        "windows-master",
        "take an identity of Windows of a master",
        {"spec.ros1": {"securityContext": {"windowsOptions": {"gmsaCredentialSpecName": "g"}}}},
    ),
    _reference(
        "account-helper",
        "name a ServiceAccount for discovery servers",
        {"spec.ros2": {"discovery": {"template": {"spec": {"serviceAccountName": "deployer"}}}}},
    ),
    _reference(
        "secret-pull-helper",
        "use a pull secret for discovery servers",
        {"spec.ros2": {"discovery": {"template": {"spec": {"imagePullSecrets": [{"name": "registry"}]}}}}},
    ),
    _reference(
        "account-master",
        "name a ServiceAccount for a master",
        {"spec.ros1": {"template": {"spec": {"serviceAccountName": "deployer"}}}},
    ),
    _reference(
        "secret-pull-master",
        "use a pull secret for a master",
        {"spec.ros1": {"template": {"spec": {"imagePullSecrets": [{"name": "registry"}]}}}},
    ),
    _reference(
        "secret-parameters", "read a parameter file from a Secret", {f"{_C}.parameters": [{"secretKeyRef": _KEY}]}
    ),
    _reference(
        "secret-override-env",
        "a Secret's key for some of the robots",
        {"spec.robots": AMR_07, "spec.overrides": _override(env=_FROM_SECRET)},
    ),
    _reference(
        "secret-override-file",
        "a parameter file from a Secret for some of the robots",
        {"spec.robots": AMR_07, "spec.overrides": _override(parameters=[{"secretKeyRef": _KEY}])},
    ),
    _reference(
        "secret-init-env", "an init container with a Secret's key", {f"{_POD}.initContainers": _init(env=_FROM_SECRET)}
    ),
    _reference(
        "secret-init-env-from",
        "an init container with all of a Secret",
        {f"{_POD}.initContainers": _init(envFrom=[{"secretRef": {"name": "s"}}])},
    ),
    _reference(
        "secret-beside-env", "a further container with a Secret's key", {f"{_POD}.containers": _init(env=_FROM_SECRET)}
    ),
    _reference(
        "secret-beside-env-from",
        "a further container with all of a Secret",
        {f"{_POD}.containers": _init(envFrom=[{"secretRef": {"name": "s"}}])},
    ),
    _reference(
        "account-later",
        "name the ServiceAccount in a later component",
        {"spec.components[1]": _OTHER | {"template": {"spec": {"serviceAccountName": "deployer"}}}},
    ),
    _reference(
        "image-under-secret", "another image in an app that has a Secret", {f"{_C}.image": "mine"}, _WITH_SECRET
    ),
    _reference(
        "command-under-account",
        "another command in an app that has an account",
        {f"{_C}.command": ["sh"]},
        _WITH_ACCOUNT,
    ),
    _reference(
        "beside-secret",
        "a component of one's own in an app that has a Secret",
        {"spec.components[1]": _OTHER},
        _WITH_SECRET,
    ),
    _reference(
        "hook-under-account",
        "a postStart hook in an app that has an account",
        {f"{_C}.lifecycle": {"postStart": {"exec": {"command": ["sh", "-c", _OPENS]}}}},
        _WITH_ACCOUNT,
    ),
    _reference(
        "behind-suspend",
        "another image in the same write as suspend",
        {f"{_C}.image": "mine", "spec.suspend": True},
        _WITH_ACCOUNT,
    ),
)


def _field(key: str, text: str, changes: Json, good: Json | None = None, stop: Stop = Stop.SCHEMA) -> Attack:
    return Attack(key, text, "tenant", kinds.ROBOTAPP, good or app(), changes, stop)


def _volume(key: str, text: str, **source: Any) -> Attack:
    good = templated(volumes=[{"name": "v", "emptyDir": {}}])
    ((kind, value),) = source.items()
    return _field(key, text, {f"{_POD}.volumes[0].{kind}": value}, good)


FIELDS: Final = (
    _field("node-name", "place the pod past the scheduler", {f"{_POD}.nodeName": "robot-1"}, stop=Stop.TEMPLATE),
    _field(
        "pod-scheduler", "give a component another scheduler", {f"{_POD}.schedulerName": "mine"}, stop=Stop.TEMPLATE
    ),
    _field(
        "foreign-device",
        "use a ResourceClaim past our devices",
        {f"{_POD}.resourceClaims": [{"name": "gpu"}]},
        stop=Stop.TEMPLATE,
    ),
    _field(
        "own-gate",
        "hold the pod with a gate that nobody removes",
        {f"{_POD}.schedulingGates": [{"name": "a/b"}]},
        stop=Stop.TEMPLATE,
    ),
    _field(
        "debug-container",
        "bring an ephemeral container",
        {f"{_POD}.ephemeralContainers": [{"name": "e"}]},
        stop=Stop.TEMPLATE,
    ),
    _field("host-users", "the node's users", {f"{_POD}.hostUsers": True}),
    _field("account-alias", "a ServiceAccount by its old name", {f"{_POD}.serviceAccount": "deployer"}),
    _field("mounted-token", "a mounted token", {f"{_POD}.automountServiceAccountToken": True}),
    _field("priority", "a priority without its class", {f"{_POD}.priority": 2000000000}),
    _field("affinity", "placement by pods of other namespaces", {f"{_POD}.affinity": {"podAffinity": {}}}),
    _volume("iscsi-volume", "a disk of another host", iscsi={"targetPortal": "10.0.0.1", "iqn": "i", "lun": 0}),
    _volume("flex-volume", "a volume of a FlexVolume driver", flexVolume={"driver": "d/e"}),
    _volume("ephemeral-volume", "a claim of storage made for the pod", ephemeral={"volumeClaimTemplate": {}}),
    _volume("git-volume", "a clone made by the kubelet", gitRepo={"repository": "r"}),
    _field(
        "host-ip",
        "an address of the node",
        {f"{_C}.ports[0].hostIP": "10.0.0.1"},
        app(ports=[{"containerPort": 80, "protocol": "TCP"}]),
    ),
    _field("block-device", "a block device", {f"{_C}.volumeDevices": [{"name": "d", "devicePath": "/dev/sda"}]}),
    _field(
        "foreign-configmap",
        "a ConfigMap of another namespace",
        {f"{_C}.parameters[0].configMapKeyRef.namespace": "victim"},
        app(parameters=[{"configMapKeyRef": {"name": "c", "key": "k"}}]),
    ),
    _field(
        "foreign-secret",
        "a Secret of another namespace",
        {f"{_C}.parameters[0].secretKeyRef.namespace": "victim"},
        app(parameters=[{"secretKeyRef": {"name": "s", "key": "k"}}]),
    ),
    _field(
        "foreign-storage",
        "a claim of storage of another namespace",
        {f"{_C}.sharedData": {"claimNames": ["victim/data"]}},
        stop=Stop.RULE,
    ),
    _field(
        "foreign-peer",
        "a place beside a pod of another namespace",
        {f"{_C}.sharedData": {"peerPods": ["victim/db"]}},
        stop=Stop.RULE,
    ),
)


def _denied(
    key: str,
    text: str,
    kind: Kind,
    changes: Json,
    *,
    who: str = "tenant",
    where: str = "system",
    name: str = "x",
    sub: str = "",
) -> Attack:
    """Refused by RBAC before the API server looks at the object, so an honest one is not needed."""
    return Attack(key, text, who, kind, {}, changes, Stop.RBAC, where=where, name=name, subresource=sub)


_TO_TENANT: Final = {"subjects": [{"kind": "User", "name": "tenant", "apiGroup": "rbac.authorization.k8s.io"}]}
_ROBOT: Final = 'metadata.labels."robotics.io/robot"'
_ADMITS: Final = 'metadata.annotations."robotics.io/allowed-namespaces"'


def _bound(key: str, text: str, role: str) -> Attack:
    """The honest binding has the same role and nobody in it."""
    good = {"roleRef": {"apiGroup": "rbac.authorization.k8s.io", "kind": "ClusterRole", "name": role}}
    return Attack(key, text, "tenant", kinds.ROLE_BINDING, good, _TO_TENANT, Stop.ESCALATION)


def _role(key: str, text: str, group: str, resource: str, verb: str) -> Attack:
    rule = {"apiGroups": [group], "resources": [resource], "verbs": [verb]}
    changes = {"rules": [rule]}
    return Attack(key, text, "tenant", kinds.ROLE, {"rules": []}, changes, Stop.ESCALATION)


RIGHTS: Final = (
    _bound("bind-operator", "bind the operator's role in one's namespace", "robotapp-operator"),
    _bound("bind-scheduler", "bind the scheduler's role in one's namespace", "robotapp-scheduler"),
    _bound("bind-host-path", "bind the role that may use files of the node", "robotapp-use-hostpath"),
    _bound("bind-admin", "bind cluster-admin in one's namespace", "cluster-admin"),
    _role("role-binding-pods", "a role that may bind pods", "", "pods/binding", "create"),
    _role("role-host-path", "a role that may use files of the node", "robotics.io", "robotapps/hostpath", "use"),
    _role("role-privileged", "a role that may run privileged", "robotics.io", "robotapps/privileged", "use"),
    _role("role-claims", "a role that may make claims", "robotics.io", "robotclaims", "create"),
    _role("role-instances", "a role that may write instances", "robotics.io", "robotappinstances/status", "patch"),
    _role("role-pod-status", "a role that may write the status of pods", "", "pods/status", "patch"),
    _role("role-jobs", "a role that counts as the Job controller", "batch", "jobs/status", "update"),
    _role(
        "role-replicasets", "a role that counts as the ReplicaSet controller", "apps", "replicasets/status", "update"
    ),
    _denied("operator-role", "widen the operator's role", kinds.CLUSTER_ROLE, {"rules": []}, name="robotapp-operator"),
    _denied(
        "editor-role", "widen the role that `edit` takes in", kinds.CLUSTER_ROLE, {"rules": []}, name="robotapp-editor"
    ),
    _denied(
        "operator-binding", "join the operator's binding", kinds.CLUSTER_BINDING, _TO_TENANT, name="robotapp-operator"
    ),
    _denied(
        "authentication-reader", "join a binding in kube-system", kinds.ROLE_BINDING, _TO_TENANT, where="kube-system"
    ),
    _denied("policy-off", "empty a policy", kinds.POLICY, {"spec": {}}, name="robotapp-grants-pods"),
    _denied("policy-warns", "make a policy warn only", kinds.POLICY_BINDING, {"spec": {}}, name="robotapp-references"),
    _denied("crd", "take the rules out of a CRD", kinds.CRD, {"spec": {}}, name="robotapps.robotics.io"),
    _denied("operator-image", "change the operator's image", kinds.DEPLOYMENT, {"spec": {}}, name="robotapp-operator"),
    _denied(
        "scheduler-config",
        "change the scheduler's configuration",
        kinds.CONFIGMAP,
        {"data": {}},
        name="robotapp-scheduler",
    ),
    _denied("fleet-view", "change the fleet view", kinds.CONFIGMAP, {"data": {}}, name="robot-fleet-assignments"),
    _denied("lease", "take the operator's Lease", kinds.LEASE, {"spec": {}}, name="robotapp-operator"),
    _denied(
        "system-pod",
        "a pod as the operator's account",
        kinds.POD,
        {"spec": {"serviceAccountName": "robotapp-operator"}},
    ),
    _denied("account-token", "a Secret that is given the operator's token", kinds.SECRET, {"type": "x"}),
    _denied("priority-class", "a priority above all", kinds.PRIORITY, {"value": 1000000000}),
    _denied("foreign-app", "a RobotApp in another namespace", kinds.ROBOTAPP, {"spec": {}}, where="victim"),
    _denied("foreign-deployment", "a Deployment in another namespace", kinds.DEPLOYMENT, {"spec": {}}, where="victim"),
    _denied("robot-label", "make another node a robot", kinds.NODE, {_ROBOT: "amr-07"}, name="robot-1"),
    _denied("allowed-namespaces", "admit oneself to a robot", kinds.NODE, {_ADMITS: "own"}, name="robot-1"),
    _denied("taint", "take the taint off a robot", kinds.NODE, {"spec.taints": []}, name="robot-1"),
    _denied("telemetry", "report round trips and devices", kinds.TELEMETRY, {"status": {}}, name="robot-1"),
    _denied(
        "quota", "raise one's quota of domains", kinds.POOL, {"spec.quota": {"namespaces": {"own": 99}}}, name="default"
    ),
    _denied("quota-default", "everybody's quota of domains lifted", kinds.POOL, {"spec.quota": {}}, name="default"),
    _denied(
        "quota-deputy",
        "one's quota of domains, by somebody with every right on our kinds in his namespace",
        kinds.POOL,
        {"spec.quota": {"namespaces": {"own": 99}}},
        who="deputy",
        name="default",
    ),
    _denied("clerk-pod", "a pod, by a writer of RobotApps only", kinds.POD, {"spec": {}}, who="clerk", where="own"),
    _denied(
        "clerk-deployment",
        "a Deployment, by a writer of RobotApps only",
        kinds.DEPLOYMENT,
        {"spec": {}},
        who="clerk",
        where="own",
    ),
    _denied(
        "stolen-operator-daemonset", "stolen operator token: a DaemonSet", kinds.DAEMONSET, {"spec": {}}, who="operator"
    ),
    _denied("stolen-operator-secret", "stolen operator token: a Secret", kinds.SECRET, {"data": {}}, who="operator"),
    _denied("stolen-operator-role", "stolen operator token: a role", kinds.CLUSTER_ROLE, {"rules": []}, who="operator"),
    _denied("stolen-operator-app", "stolen operator token: a RobotApp", kinds.ROBOTAPP, {"spec": {}}, who="operator"),
    _denied(
        "stolen-operator-pool",
        "stolen operator token: the pool",
        kinds.POOL,
        {"spec": {}},
        who="operator",
        name="default",
    ),
    _denied("stolen-operator-node", "stolen operator token: a node", kinds.NODE, {_ROBOT: "x"}, who="operator"),
    _denied("stolen-operator-policy", "stolen operator token: a policy", kinds.POLICY, {"spec": {}}, who="operator"),
    _denied("stolen-scheduler-pod", "stolen scheduler token: another pod", kinds.POD, {"spec": {}}, who="scheduler"),
    _denied("stolen-scheduler-secret", "stolen scheduler token: a Secret", kinds.SECRET, {"data": {}}, who="scheduler"),
    _denied(
        "stolen-scheduler-deployment",
        "stolen scheduler token: a Deployment",
        kinds.DEPLOYMENT,
        {"spec": {}},
        who="scheduler",
    ),
    _denied("stolen-scheduler-node", "stolen scheduler token: a node", kinds.NODE, {_ROBOT: "x"}, who="scheduler"),
    _denied(
        "stolen-scheduler-app", "stolen scheduler token: a RobotApp", kinds.ROBOTAPP, {"spec": {}}, who="scheduler"
    ),
    _denied(
        "stolen-scheduler-role", "stolen scheduler token: a role", kinds.CLUSTER_ROLE, {"rules": []}, who="scheduler"
    ),
)

_OWNER: Final = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "x", "uid": "u", "controller": True}
_PAST_SPEC: Final = {"metadata": {"ownerReferences": [_OWNER]}, "revision": 1, "data": {"spec": {}}}
_STATEFUL: Final = _OWNER | {"apiVersion": "apps/v1", "kind": "StatefulSet"}


def _revision(key: str, text: str, changes: Json) -> Attack:
    return Attack(key, text, "editor", kinds.REVISION, _PAST_SPEC, changes, Stop.REVISION)


def _planted(key: str, text: str, **pod: Any) -> Attack:
    """A past spec whose component has these pod fields."""
    return _revision(key, text, {"data": templated(**pod)})


def _planted_helper(key: str, text: str, fields: Json) -> Attack:
    """A past spec with these fields beside its components."""
    plain = _helper(nodeSelector={"zone": "a"}, serviceAccountName="default")
    good = app()["spec"] | {"ros1": plain, "ros2": {"discovery": plain}}
    changes = {"data": {"spec": good | fields}}
    return Attack(key, text, "editor", kinds.REVISION, _PAST_SPEC | {"data": {"spec": good}}, changes, Stop.REVISION)


def _helper(**pod: Any) -> Json:
    """A helper of the operator's own whose pod has these fields."""
    return {"template": {"spec": pod}}


REVISIONS: Final = (
    _revision("revision-stateful", "a template for a StatefulSet's pods", {"metadata.ownerReferences": [_STATEFUL]}),
    _revision("revision-orphan", "one that nobody owns, for a StatefulSet to adopt", {"metadata.ownerReferences": []}),
    _revision("revision-labelled", "one that a StatefulSet's selector finds", {"metadata.labels": {"app": "db"}}),
    _planted(
        "revision-account", "a past spec with an account, for its owner to bring back", serviceAccountName="deployer"
    ),
    _planted(
        "revision-secret",
        "a past spec with a Secret",
        volumes=[{"name": "v", "secret": {"secretName": "deploy-key"}}],
    ),
    _planted(
        "revision-token",
        "a past spec with the token of `default`",
        volumes=[{"name": "v", "projected": {"sources": [_TOKEN]}}],
    ),
    _planted(
        "revision-host-path", "a past spec with files of the node", volumes=[{"name": "v", "hostPath": {"path": "/"}}]
    ),
    _planted("revision-host-network", "a past spec in the network of the node", hostNetwork=True),
    _planted(
        "revision-privileged",
        "a past spec with a privileged init container",
        initContainers=_init(securityContext={"privileged": True}),
    ),
    _planted("revision-unknown", "a past spec with a field of a later version", identity="deployer"),
    _planted_helper(
        "revision-account-helper",
        "a past spec whose discovery servers have an account",
        {"ros2": {"discovery": _helper(serviceAccountName="deployer")}},
    ),
    _planted_helper(
        "revision-secret-helper",
        "a past spec whose master reads a Secret, as a later version might",
        {"ros1": _helper(volumes=[{"name": "v", "secret": {"secretName": "deploy-key"}}])},
    ),
    _planted_helper(
        "revision-unknown-helper",
        "a past spec whose discovery servers have a field of a later version",
        {"ros2": {"discovery": {"envFrom": [{"secretRef": {"name": "deploy-key"}}]}}},
    ),
    _revision(
        "revision-node-port",
        "a past spec that opens a port on all nodes",
        {"data": app(service={"spec": {"type": "NodePort", "ports": _PORTS}})},
    ),
    _revision(
        "revision-annotated-service",
        "a past spec whose Service another program obeys",
        {"data": app(service={"metadata": {"annotations": {"example.com/a": "b"}}, "spec": {"ports": _PORTS}})},
    ),
    _planted_helper(
        "revision-external",
        "a past spec that opens discovery servers to the outside",
        {"ros2": {"external": {"expose": "NodePort"}}},
    ),
)

ESCALATIONS: Final = (*REFERENCES, *SERVICES, *FIELDS, *RIGHTS, *REVISIONS)
