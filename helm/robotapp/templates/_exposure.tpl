{{/* What opens a component or a helper to others than pods of the cluster, or has other programs obey a Service's annotations.
Variables of a ValidatingAdmissionPolicy that has the spec as `variables.spec`; `exposed` is the sentence about the first such thing, '' if
there is none. A Service of type ClusterIP without annotations is reached by pods of the cluster, which reach the component's pod anyway. */}}
{{- define "robotapp.exposureVariables" -}}
- name: open
  expression: >-
    variables.spec.?components.orValue([]).filter(c, has(c.service) && (c.service.spec.?type.orValue('ClusterIP') != 'ClusterIP'
    || size(c.service.?metadata.?annotations.orValue({})) > 0))
- name: exposed
  expression: >-
    size(variables.open) == 0 ? (variables.spec.?ros2.?external.hasValue() ? 'spec.ros2.external opens a port to the outside' : '')
    : 'component ' + variables.open[0].name + (variables.open[0].service.spec.?type.orValue('ClusterIP') == 'ClusterIP'
    ? ' annotates its Service' : ' has a Service of type ' + variables.open[0].service.spec.type)
{{- end -}}
