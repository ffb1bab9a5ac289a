package main

import (
	"github.com/google/cel-go/cel"
	admission "k8s.io/api/admissionregistration/v1"
	admissioncel "k8s.io/apiserver/pkg/admission/plugin/cel"
	"k8s.io/apiserver/pkg/cel/environment"
	"sigs.k8s.io/yaml"
)

// One expression of a policy, with the type it must have.
type expression struct {
	path, kind, text, name string
	types                  []*cel.Type
}

func (e expression) GetExpression() string    { return e.text }
func (e expression) GetName() string          { return e.name }
func (e expression) ReturnTypes() []*cel.Type { return e.types }

func policyReport(file string, text []byte, base *environment.EnvSet) (Report, error) {
	var policy admission.ValidatingAdmissionPolicy
	if err := yaml.UnmarshalStrict(text, &policy); err != nil {
		return Report{}, err
	}
	compiler, err := admissioncel.NewCompositedCompiler(base)
	if err != nil {
		return Report{}, err
	}
	result := Report{File: file, Costs: []Cost{}}
	add := func(e expression, compiled admissioncel.CompilationResult) {
		cost := Cost{Path: e.path, Kind: e.kind, Text: e.text}
		if compiled.Error != nil {
			cost.Error = compiled.Error.Error()
		}
		result.Costs = append(result.Costs, cost)
	}
	// Messages see no authorizer; everything else does.
	params := policy.Spec.ParamKind != nil
	options := admissioncel.OptionalVariableDeclarations{HasParams: params, HasAuthorizer: true}
	ofMessages := admissioncel.OptionalVariableDeclarations{HasParams: params}
	for _, variable := range policy.Spec.Variables {
		e := expression{"variables." + variable.Name, "variable", variable.Expression, variable.Name, []*cel.Type{cel.AnyType, cel.DynType}}
		add(e, compiler.CompileAndStoreVariable(e, options, environment.NewExpressions))
	}
	bool, words := []*cel.Type{cel.BoolType}, []*cel.Type{cel.StringType}
	for _, condition := range policy.Spec.MatchConditions {
		e := expression{"matchConditions." + condition.Name, "condition", condition.Expression, "", bool}
		add(e, compiler.CompileCELExpression(e, options, environment.NewExpressions))
	}
	for _, validation := range policy.Spec.Validations {
		e := expression{"validations", "validation", validation.Expression, "", bool}
		add(e, compiler.CompileCELExpression(e, options, environment.NewExpressions))
		if validation.MessageExpression != "" {
			e := expression{"validations", "message", validation.MessageExpression, "", words}
			add(e, compiler.CompileCELExpression(e, ofMessages, environment.NewExpressions))
		}
	}
	for _, annotation := range policy.Spec.AuditAnnotations {
		e := expression{"auditAnnotations." + annotation.Key, "annotation", annotation.ValueExpression, "", []*cel.Type{cel.StringType, cel.NullType}}
		add(e, compiler.CompileCELExpression(e, options, environment.NewExpressions))
	}
	return result, nil
}
