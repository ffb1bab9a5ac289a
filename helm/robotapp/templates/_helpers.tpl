{{/* Name prefix of all objects. */}}
{{- define "robotapp.name" -}}
{{- .Values.nameOverride | trunc 40 | trimSuffix "-" -}}
{{- end -}}

{{/* Labels of every object. */}}
{{- define "robotapp.labels" -}}
helm.sh/chart: {{ printf "%s-%s" .Chart.Name .Chart.Version | replace "+" "_" }}
app.kubernetes.io/name: {{ include "robotapp.name" . }}
app.kubernetes.io/instance: {{ .Release.Name }}
app.kubernetes.io/version: {{ .Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .Release.Service }}
app.kubernetes.io/part-of: robotapp
{{- with .Values.commonLabels }}
{{ toYaml . }}
{{- end }}
{{- end -}}

{{/* Selector labels of a component; argument: (dict "root" $ "component" "operator"). */}}
{{- define "robotapp.selector" -}}
app.kubernetes.io/name: {{ include "robotapp.name" .root }}
app.kubernetes.io/instance: {{ .root.Release.Name }}
app.kubernetes.io/component: {{ .component }}
{{- end -}}

{{/* Image reference; a digest wins over a tag, and the tag defaults to the chart's version. No images are published, so a
repository without a registry, which container runtimes look for on Docker Hub, is refused. */}}
{{- define "robotapp.image" -}}
{{- $repository := .image.repository -}}
{{- $registry := .root.Values.imageRegistry | default (.root.Values.global | default dict).imageRegistry -}}
{{- if $registry }}
{{- $repository = printf "%s/%s" $registry $repository -}}
{{- else if not (regexMatch "^[^/]*([.:]|^localhost)[^/]*/" $repository) -}}
{{- fail (printf "imageRegistry is empty, so %s would be looked for on Docker Hub, where this project publishes nothing: build the images (docs/installation.md) and write imageRegistry, the registry you pushed them to" $repository) -}}
{{- end -}}
{{- if .image.digest -}}
{{ printf "%s@%s" $repository .image.digest }}
{{- else -}}
{{ printf "%s:%s" $repository (.image.tag | default .root.Chart.AppVersion) }}
{{- end -}}
{{- end -}}

{{/* Image of recordings: as written, else the recorder of this version for the app's distribution. */}}
{{- define "robotapp.recorderImage" -}}
{{- $registry := .Values.imageRegistry | default (.Values.global | default dict).imageRegistry -}}
{{- $image := printf "robotapp/recorder:%s-{distro}" .Chart.AppVersion -}}
{{- .Values.helperImages.recorder | default (ternary (printf "%s/%s" $registry $image) $image (not (empty $registry))) -}}
{{- end -}}

{{/* User name of a component's ServiceAccount as the API server sees it. */}}
{{- define "robotapp.username" -}}
{{- printf "system:serviceaccount:%s:%s-%s" .root.Release.Namespace (include "robotapp.name" .root) .component -}}
{{- end -}}

{{/* Pod fields that every component shares; argument: root, component, values; asRoot: as user 0, without its capabilities; offRobots: rather on a node that is no robot. */}}
{{- define "robotapp.podCommon" -}}
serviceAccountName: {{ include "robotapp.name" .root }}-{{ .component }}
{{- with .root.Values.imagePullSecrets | default (.root.Values.global | default dict).imagePullSecrets }}
imagePullSecrets:
{{- range . }}
- name: {{ if kindIs "string" . }}{{ . }}{{ else }}{{ .name }}{{ end }}
{{- end }}
{{- end }}
{{- with .values.priorityClassName }}
priorityClassName: {{ . }}
{{- end }}
terminationGracePeriodSeconds: 30
securityContext:
  {{- if .asRoot }}
  runAsUser: 0
  runAsGroup: 0
  {{- else }}
  runAsNonRoot: true
  {{- with .root.Values.podSecurity.runAsUser }}
  runAsUser: {{ int64 . }}
  {{- end }}
  {{- with .root.Values.podSecurity.runAsGroup }}
  runAsGroup: {{ int64 . }}
  {{- end }}
  {{- end }}
  seccompProfile: {type: RuntimeDefault}
{{- with .values.nodeSelector }}
nodeSelector:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- with .values.tolerations }}
tolerations:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- if .values.affinity }}
affinity:
  {{- toYaml .values.affinity | nindent 2 }}
{{- else if .offRobots }}
affinity:
  nodeAffinity:
    preferredDuringSchedulingIgnoredDuringExecution:
    - weight: 100
      preference:
        matchExpressions:
        - {key: robotics.io/robot, operator: DoesNotExist}
        - {key: robotics.io/tier, operator: NotIn, values: [robot]}
{{- end }}
{{- with .values.topologySpreadConstraints }}
topologySpreadConstraints:
  {{- toYaml . | nindent 2 }}
{{- end }}
{{- end -}}

{{- define "robotapp.containerSecurity" -}}
securityContext:
  allowPrivilegeEscalation: false
  readOnlyRootFilesystem: true
  capabilities: {drop: [ALL]}
{{- end -}}

{{/* Refuses a set of ids the API server would refuse: helm says so at once, not when the pool is created at last. */}}
{{- define "robotapp.checkIds" -}}
{{- $state := dict "last" -1 -}}
{{- range $part := splitList "," .ids -}}
{{- if $part -}}
{{- $ends := splitList "-" $part -}}
{{- $first := int (first $ends) -}}
{{- $last := int (last $ends) -}}
{{- if or (lt $last $first) (gt $last 232) (le $first (int (get $state "last"))) -}}
{{- fail (printf "domainPool.%s: %q in %q: ranges must ascend without overlap, up to 232" $.field $part $.ids) -}}
{{- end -}}
{{- $_ := set $state "last" $last -}}
{{- end -}}
{{- end -}}
{{- end -}}

{{/* Refuses another name for the pool of this release: the old one is kept, so two pools would have all ids. */}}
{{- define "robotapp.checkPoolName" -}}
{{- $release := printf "%s/%s" .Release.Namespace .Release.Name -}}
{{- $name := .Values.domainPool.name -}}
{{- range (lookup "robotics.io/v1alpha1" "DomainPool" "" "").items -}}
{{- $notes := default dict .metadata.annotations -}}
{{- $owner := printf "%s/%s" (get $notes "meta.helm.sh/release-namespace") (get $notes "meta.helm.sh/release-name") -}}
{{- if and (eq $owner $release) (ne .metadata.name $name) -}}
{{- fail (printf "domainPool.name: this release has DomainPool %s, which would stay beside %s with the same ids. Keep the name; for another pool set domainPool.create=false and create both yourself, each with ids or spec.network of its own" .metadata.name $name) -}}
{{- end -}}
{{- end -}}
{{- end -}}

{{/* Flags for a certificate of its own, and what follows a container of that; argument: the component's values. */}}
{{- define "robotapp.tlsArguments" -}}
{{- if .tls.secretName -}}
- --tls-cert-file=/etc/robotapp-tls/tls.crt
- --tls-private-key-file=/etc/robotapp-tls/tls.key
{{- end }}
{{- end -}}
{{- define "robotapp.tlsMount" -}}
{{- if .tls.secretName -}}
- {name: tls, mountPath: /etc/robotapp-tls, readOnly: true}
{{- end }}
{{- end -}}
{{- define "robotapp.tlsVolume" -}}
{{- with .tls.secretName -}}
- name: tls
  secret: {secretName: {{ . }}}
{{- end }}
{{- end -}}

{{/* Peers that may reach metrics, as a YAML list; empty when there are none. The chart knows where a Prometheus of the Prometheus operator is. */}}
{{- define "robotapp.metricsPeers" -}}
{{- $peers := .Values.networkPolicy.metricsFrom -}}
{{- $monitored := or .Values.metrics.podMonitor.enabled .Values.metrics.serviceMonitor.enabled -}}
{{- if and (not $peers) $monitored (.Capabilities.APIVersions.Has "monitoring.coreos.com/v1/Prometheus") -}}
{{- $namespaces := list -}}
{{- range (lookup "monitoring.coreos.com/v1" "Prometheus" "" "").items -}}
{{- $namespaces = append $namespaces .metadata.namespace -}}
{{- end -}}
{{- range $namespaces | uniq | sortAlpha -}}
{{- $peers = append $peers (dict "namespaceSelector" (dict "matchLabels" (dict "kubernetes.io/metadata.name" .))) -}}
{{- end -}}
{{- end -}}
{{- with $peers }}{{ toYaml . }}{{ end -}}
{{- end -}}

{{/* Rules for the ports of the API server: those of the values, and where the cluster is at hand those of its endpoints. */}}
{{- define "robotapp.apiServerRules" -}}
{{- $ports := list -}}
{{- range .Values.networkPolicy.apiServerPorts -}}
{{- $ports = append $ports (int .) -}}
{{- end -}}
{{- range (lookup "discovery.k8s.io/v1" "EndpointSlice" "default" "kubernetes").ports -}}
{{- $ports = append $ports (int .port) -}}
{{- end -}}
{{- range $ports | uniq }}
- {protocol: TCP, port: {{ . }}}
{{- end }}
{{- end -}}

{{/* Addresses of the node, whose probes a flooded port lets in (robotapp_client.serving.node_addresses). */}}
{{- define "robotapp.nodeAddresses" -}}
- name: HOST_IPS
  valueFrom: {fieldRef: {fieldPath: status.hostIPs}}
{{- end }}
