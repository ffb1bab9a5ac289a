{{/* One validation of a policy that has the variables of files/host-access.yaml: whoever writes a field that takes `right` holds the
verb `use` on it. One question to the authorizer per validation: each costs a third of what an expression may cost.
Arguments: root, right, subject (who is asked for it). */}}
{{- define "robotapp.hostRight" -}}
{{- $role := printf "%s-use-%s" (include "robotapp.name" .root) .right -}}
- expression: >-
    variables.{{ .right }} == ''
    || authorizer.group('robotics.io').resource('robotapps').subresource('{{ .right }}').namespace(request.namespace).check('use').allowed()
  reason: Forbidden
  message: {{ .subject }} needs the verb use on robotapps/{{ .right }} in the namespace (ClusterRole {{ $role }})
  messageExpression: >-
    variables.{{ .right }} + '; {{ .subject }} needs the verb use on robotapps/{{ .right }} in namespace ' + request.namespace
    + ': leave it out, or ask whoever runs the cluster for kubectl create rolebinding {{ $role }} --clusterrole={{ $role }} --user='
    + request.userInfo.username + ' -n ' + request.namespace
    + (request.operation == 'UPDATE' ? ' (without it only suspend may be changed)' : '')
{{- end -}}
