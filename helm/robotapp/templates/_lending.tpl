{{/*
What components and helpers (discovery servers, router, master) may have whose writer may create no pods: the allow-list
files/free-fields.yaml, level by level. Everything else names an identity, or is lent with one: an account, a Secret, a token,
a certificate, a priority.
Variables of a ValidatingAdmissionPolicy; argument: root, spec (the expression of the spec, {} where there is none). `lent` is
the sentence about the first thing beyond the lists, '' if there is none.
*/}}
{{- define "robotapp.lendingVariables" -}}
{{- $pod := "c.?template.?spec" -}}
{{- $free := .root.Files.Get "files/free-fields.yaml" | fromYaml -}}
- name: spec
  expression: {{ .spec | quote }}
- name: components
  expression: variables.spec.?components.orValue([])
- name: accounts
  expression: "variables.components.filter(c, !({{ $pod }}.?serviceAccountName.orValue('') in ['', 'default']))"
- name: priorities
  expression: >-
    variables.components.filter(c,
    !({{ $pod }}.?priorityClassName.orValue('') in [''{{ range .root.Values.policies.priorityClasses }}, {{ squote . }}{{ end }}]))
- name: values
  expression: >-
    variables.components.filter(c,
    (has(c.env) && c.env.exists(e, has(e.valueFrom) && {{ include "robotapp.beyond" (list $free "e.valueFrom" "valueFrom") }}))
    || (has(c.envFrom) && c.envFrom.exists(e, {{ include "robotapp.beyond" (list $free "e" "envFrom") }}))
    || (has(c.parameters) && c.parameters.exists(p, {{ include "robotapp.beyond" (list $free "p" "parameters") }})))
- name: overrides
  expression: >-
    variables.spec.?overrides.orValue([]).filter(o, {{ include "robotapp.beyond" (list $free "o" "overrides") }}
    || o.components.exists(c, {{ include "robotapp.beyond" (list $free "c" "overriddenComponents") }}
    || (has(c.env) && c.env.exists(e, has(e.valueFrom) && {{ include "robotapp.beyond" (list $free "e.valueFrom" "valueFrom") }}))
    || (has(c.parameters) && c.parameters.exists(p, {{ include "robotapp.beyond" (list $free "p" "parameters") }}))))
{{- range list "containers" "initContainers" }}
- name: {{ . }}Values
  expression: >-
    variables.components.filter(c, {{ $pod }}.?{{ . }}.orValue([]).exists(i,
    (has(i.env) && i.env.exists(e, has(e.valueFrom) && {{ include "robotapp.beyond" (list $free "e.valueFrom" "valueFrom") }}))
    || (has(i.envFrom) && i.envFrom.exists(e, {{ include "robotapp.beyond" (list $free "e" "envFrom") }}))))
{{- end }}
- name: volumes
  expression: >-
    variables.components.filter(c, {{ $pod }}.?volumes.orValue([]).exists(v, {{ include "robotapp.beyond" (list $free "v" "volumes") }}
    || v.?projected.?sources.orValue([]).exists(s, {{ include "robotapp.beyond" (list $free "s" "sources") }})))
- name: pulls
  expression: "variables.components.filter(c, size({{ $pod }}.?imagePullSecrets.orValue([])) > 0)"
- name: others
  expression: >-
    variables.components.filter(c, {{ include "robotapp.beyond" (list $free "c" "components") }}
    || (has(c.template) && {{ include "robotapp.beyond" (list $free "c.template" "template") }})
    || {{ $pod }}.optMap(s, {{ include "robotapp.beyond" (list $free "s" "podSpec") }}).orValue(false)
    || {{ $pod }}.?containers.orValue([]).exists(i, {{ include "robotapp.beyond" (list $free "i" "initContainers") }})
    || {{ $pod }}.?initContainers.orValue([]).exists(i, {{ include "robotapp.beyond" (list $free "i" "initContainers") }}))
- name: contexts
  expression: >-
    variables.components.filter(c, {{ include "robotapp.namesWindowsIdentity" "c" }} || {{ include "robotapp.namesWindowsIdentity" $pod }}
    || {{ $pod }}.?containers.orValue([]).exists(i, {{ include "robotapp.namesWindowsIdentity" "i" }})
    || {{ $pod }}.?initContainers.orValue([]).exists(i, {{ include "robotapp.namesWindowsIdentity" "i" }}))
- name: helpers
  expression: >-
    variables.spec.?ros2.?discovery.optMap(h, {{ include "robotapp.beyond" (list $free "h" "discovery") }}).orValue(false)
    || variables.spec.?ros1.optMap(h, {{ include "robotapp.beyond" (list $free "h" "ros1") }}).orValue(false)
    || [variables.spec.?ros2.?discovery, variables.spec.?ros1].exists(h,
    h.?template.optMap(t, {{ include "robotapp.beyond" (list $free "t" "template") }}).orValue(false)
    || h.?template.?spec.optMap(s, {{ include "robotapp.beyond" (list $free "s" "helperPod") }}).orValue(false)
    || !(h.?template.?spec.?serviceAccountName.orValue('') in ['', 'default'])
    || size(h.?template.?spec.?imagePullSecrets.orValue([])) > 0
    || !(h.?template.?spec.?priorityClassName.orValue('') in [''{{ range .root.Values.policies.priorityClasses }}, {{ squote . }}{{ end }}])
    || {{ include "robotapp.namesWindowsIdentity" "h.?template.?spec" }} || {{ include "robotapp.namesWindowsIdentity" "h" }})
- name: lent
  expression: >-
    size(variables.accounts) > 0
    ? 'component ' + variables.accounts[0].name + ' names ServiceAccount ' + variables.accounts[0].template.spec.serviceAccountName
    : size(variables.priorities) > 0
    ? 'component ' + variables.priorities[0].name + ' names PriorityClass ' + variables.priorities[0].template.spec.priorityClassName
    : size(variables.values) > 0 ? 'component ' + variables.values[0].name + ' reads a Secret (env, envFrom or parameters)'
    : size(variables.overrides) > 0 ? 'override ' + variables.overrides[0].name + ' reads a Secret (env or parameters), or has a field that is not free for every writer'
    : size(variables.containersValues) > 0 ? 'component ' + variables.containersValues[0].name + ' reads a Secret (containers)'
    : size(variables.initContainersValues) > 0 ? 'component ' + variables.initContainersValues[0].name + ' reads a Secret (initContainers)'
    : size(variables.volumes) > 0 ? 'component ' + variables.volumes[0].name + ' has a volume with a Secret, a token or a certificate, or of another host or driver'
    : size(variables.pulls) > 0 ? 'component ' + variables.pulls[0].name + ' names a Secret (imagePullSecrets)'
    : size(variables.contexts) > 0 ? 'component ' + variables.contexts[0].name + ' sets windowsOptions, which name an identity'
    : size(variables.others) > 0 ? 'component ' + variables.others[0].name + ' has a field that is not free for every writer'
    : variables.helpers ? 'ros2.discovery or ros1 names a ServiceAccount, a Secret, a PriorityClass or an identity, or has a field that is not free'
    : ''
{{- end -}}

{{/* Does an object have a field that is not free at its level? Argument: the levels, the object's expression, its level. */}}
{{- define "robotapp.beyond" -}}
dyn({{ index . 1 }}).exists(k, !(k in [{{ range $index, $key := get (index . 0) (index . 2) }}{{ if $index }}, {{ end }}{{ squote $key }}{{ end }}]))
{{- end -}}

{{/* Does a security context name an identity of Windows? Argument: the expression of what has the context. `hostProcess` names none. */}}
{{- define "robotapp.namesWindowsIdentity" -}}
{{ . }}.?securityContext.?windowsOptions.optMap(w, dyn(w).exists(k, k != 'hostProcess')).orValue(false)
{{- end -}}

{{/* The condition under which a write of a RobotApp changes what its pods are: not metadata, nor `suspend`, which stays free for
who may write the app. Garbage collection, for one, changes metadata under a name of its own. */}}
{{- define "robotapp.specChanged" -}}
- name: spec-but-suspend-changed
  expression: >-
    oldObject == null
    || dyn(object.spec).exists(k, k != 'suspend' && !(k in dyn(oldObject.spec) && dyn(oldObject.spec)[k] == dyn(object.spec)[k]))
    || dyn(oldObject.spec).exists(k, k != 'suspend' && !(k in dyn(object.spec)))
{{- end -}}
