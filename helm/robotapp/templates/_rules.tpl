{{/* Claims, for both components. The spec never changes, so only the status is updated. */}}
{{- define "robotapp.claimRules" -}}
- apiGroups: [robotics.io]
  resources: [robotclaims]
  verbs: [get, list, watch, create, delete]
- apiGroups: [robotics.io]
  resources: [robotclaims/status]
  verbs: [update]
{{- end -}}

{{/* Who asks for a page that is not for everybody, and may they see it? */}}
{{- define "robotapp.callerRules" -}}
- apiGroups: [authentication.k8s.io]
  resources: [tokenreviews]
  verbs: [create]
- apiGroups: [authorization.k8s.io]
  resources: [subjectaccessreviews]
  verbs: [create]
{{- end -}}

{{/* Rules of the operator inside a namespace it serves: a Role in each, or one ClusterRole. */}}
{{- define "robotapp.operatorNamespacedRules" -}}
- apiGroups: [robotics.io]
  resources: [robotapps]
  verbs: [get, list, watch]
{{- if .Values.policies.enabled }}
# Apps that have ended and have spec.completion.ttl: policy {{ include "robotapp.name" . }}-expiry limits this to them, and without it there is no such right.
- apiGroups: [robotics.io]
  resources: [robotapps]
  verbs: [delete]
{{- end }}
- apiGroups: [robotics.io]
  resources: [robotapps/status]
  verbs: [patch]
# What an instance of an app does, for people to read; written anew as soon as it is deleted.
- apiGroups: [robotics.io]
  resources: [robotappinstances]
  verbs: [get, list, watch, create, delete]
- apiGroups: [robotics.io]
  resources: [robotappinstances/status]
  verbs: [patch]
# Children name the RobotApp as owner with blockOwnerDeletion; some clusters ask for this right before they accept that.
- apiGroups: [robotics.io]
  resources: [robotapps/finalizers]
  verbs: [update]
# Children are written by server-side apply, which needs create and patch.
- apiGroups: [apps]
  resources: [deployments]
  verbs: [get, list, watch, create, patch, delete]
# Components that end.
- apiGroups: [batch]
  resources: [jobs]
  verbs: [get, list, watch, create, patch, delete]
- apiGroups: [""]
  resources: [services]
  verbs: [get, list, watch, create, patch, delete]
# What apps mount or read: metadata watched per namespace in use, contents read by name; who needs which only an app can say.
- apiGroups: [""]
  resources: [configmaps]
  verbs: [get, list, watch]
# The fleet view, replaced as a whole. A role cannot limit what name is created; nothing else is ever changed or deleted.
- apiGroups: [""]
  resources: [configmaps]
  verbs: [create]
- apiGroups: [""]
  resources: [configmaps]
  resourceNames:
  - robot-fleet-assignments
  {{- range untilStep 2 9 1 }}
  - robot-fleet-assignments-{{ . }}
  {{- end }}
  verbs: [update, delete]
- apiGroups: [apps]
  resources: [replicasets]
  verbs: [get, list, watch]
# Devices that a driver hands over: claims are made and deleted. Who gets which device is in their status, which schedulers write.
- apiGroups: [resource.k8s.io]
  resources: [resourceclaims]
  verbs: [get, list, watch, create, delete]
# patch: takes the scheduling gate off pods of other schedulers once their domain is claimed.
- apiGroups: [""]
  resources: [pods]
  verbs: [get, list, watch, patch]
# Moves: a pod whose latency budget or device is better served elsewhere, and pods of other schedulers that wait for a node
# that closed. By eviction, so that disruption budgets hold.
- apiGroups: [""]
  resources: [pods/eviction]
  verbs: [create]
# list: why a pod does not get to its containers, such as a Secret that is missing, is in the kubelet's events about it alone.
- apiGroups: [events.k8s.io]
  resources: [events]
  verbs: [create, patch, list]
{{- end -}}

{{/* Rules of the operator on cluster-scoped objects. */}}
{{- define "robotapp.operatorClusterRules" -}}
{{ include "robotapp.claimRules" . }}
- apiGroups: [robotics.io]
  resources: [domainpools]
  verbs: [get, list, watch]
# How full each pool is.
- apiGroups: [robotics.io]
  resources: [domainpools/status]
  verbs: [patch]
# spec.probe: which peers a node's agent should measure.
- apiGroups: [robotics.io]
  resources: [nodetelemetries]
  verbs: [get, list, watch, create, patch]
- apiGroups: [""]
  resources: [nodes]
  verbs: [get, list, watch]
# On which nodes the driver of devices runs.
- apiGroups: [resource.k8s.io]
  resources: [resourceslices]
  verbs: [get, list, watch]
{{ include "robotapp.callerRules" . }}
{{- end -}}

{{- define "robotapp.schedulerRules" -}}
- apiGroups: [""]
  resources: [nodes, namespaces, pods, persistentvolumeclaims, persistentvolumes]
  verbs: [get, list, watch]
# Before a pod is bound its volumes are given to its claims, or asked for: claimRef, and the selected-node annotation.
- apiGroups: [""]
  resources: [persistentvolumeclaims, persistentvolumes]
  verbs: [patch]
# A pod with claims of devices goes where these are, or can be allocated. Before it is bound, the allocation is written and
# the pod entered as a user; `patch` on resourceclaims sets the finalizer that protects the allocation.
- apiGroups: [resource.k8s.io]
  resources: [resourceclaims]
  verbs: [get, list, watch, patch]
- apiGroups: [resource.k8s.io]
  resources: [resourceslices, deviceclasses, devicetaintrules]
  verbs: [get, list, watch]
- apiGroups: [resource.k8s.io]
  # binding is no path: newer API servers ask for it before they let somebody change users of a claim.
  resources: [resourceclaims/status, resourceclaims/binding]
  verbs: [patch]
# Pods of one Service or workload are spread by default.
- apiGroups: [""]
  resources: [services, replicationcontrollers]
  verbs: [get, list, watch]
- apiGroups: [storage.k8s.io]
  resources: [storageclasses, csinodes, csidrivers, csistoragecapacities, volumeattachments]
  verbs: [get, list, watch]
# The sweep asks whether a domain is still named by a workload.
- apiGroups: [apps]
  resources: [deployments, replicasets, statefulsets]
  verbs: [get, list, watch]
- apiGroups: [batch]
  resources: [jobs]
  verbs: [get, list, watch]
- apiGroups: [robotics.io]
  resources: [robotapps, domainpools, nodetelemetries]
  verbs: [get, list, watch]
- apiGroups: [""]
  resources: [pods/binding]
  verbs: [create]
- apiGroups: [""]
  resources: [pods/status]
  verbs: [patch]
# Preemption: pods of lower priority make room, disruption budgets are looked at.
- apiGroups: [""]
  resources: [pods]
  verbs: [delete]
- apiGroups: [policy]
  resources: [poddisruptionbudgets]
  verbs: [get, list, watch]
# Groups of pods that are placed together, where one of these APIs is served.
- apiGroups: [scheduling.x-k8s.io, scheduling.k8s.io]
  resources: [podgroups]
  verbs: [get, list, watch]
- apiGroups: [scheduling.k8s.io]
  resources: [podgroups/status]
  verbs: [patch]
{{ include "robotapp.claimRules" . }}
- apiGroups: [events.k8s.io]
  resources: [events]
  verbs: [create, patch]
{{ include "robotapp.callerRules" . }}
{{- end -}}

{{/* A binding of a role to a component's ServiceAccount; argument: root, component. */}}
{{- define "robotapp.subject" -}}
subjects:
- kind: ServiceAccount
  name: {{ include "robotapp.name" .root }}-{{ .component }}
  namespace: {{ .root.Release.Namespace }}
{{- end -}}
