// Compiles every CEL expression of CustomResourceDefinitions and ValidatingAdmissionPolicies as the API server does
// before it takes one, and prints the static cost of the rules: each rule may cost 10 million units over the largest
// object the schema allows, all rules of a schema 100 million. Expressions of policies have no static cost.
//
//	cel-cost [-release 1.32] FILE.yaml...     one object per file; JSON on standard output
//
// -release compiles as the API server of that Kubernetes release does, whose new expressions may use only what the
// release before it knew as well: a cluster must survive a rollback. What does not compile has an error in the output.
package main

import (
	"encoding/json"
	"flag"
	"fmt"
	"os"
	"sort"

	"k8s.io/apiextensions-apiserver/pkg/apis/apiextensions"
	v1 "k8s.io/apiextensions-apiserver/pkg/apis/apiextensions/v1"
	"k8s.io/apiextensions-apiserver/pkg/apis/apiextensions/validation"
	"k8s.io/apiextensions-apiserver/pkg/apiserver/schema/cel"
	metav1 "k8s.io/apimachinery/pkg/apis/meta/v1"
	"k8s.io/apimachinery/pkg/util/version"
	limits "k8s.io/apiserver/pkg/apis/cel"
	"k8s.io/apiserver/pkg/cel/environment"
	"sigs.k8s.io/yaml"
)

// Cost of one rule or message over the largest object.
type Cost struct {
	Path  string `json:"path"`
	Kind  string `json:"kind"` // rule or message; of policies variable, condition, validation or message
	Units uint64 `json:"units"`
	Text  string `json:"text"`
	Error string `json:"error,omitempty"`
}

// Report about one file.
type Report struct {
	File  string `json:"file"`
	Total uint64 `json:"total"`
	Costs []Cost `json:"costs"`
}

type walker struct {
	base  *environment.EnvSet
	costs []Cost
}

func (w *walker) walk(schema *apiextensions.JSONSchemaProps, context *validation.CELSchemaContext, path string) error {
	if len(schema.XValidations) > 0 {
		if err := w.compile(schema, context, path); err != nil {
			return fmt.Errorf("%s: %w", path, err)
		}
	}
	names := make([]string, 0, len(schema.Properties))
	for name := range schema.Properties {
		names = append(names, name)
	}
	sort.Strings(names)
	for _, name := range names {
		child := schema.Properties[name]
		if err := w.walk(&child, context.ChildPropertyContext(&child, name), path+"."+name); err != nil {
			return err
		}
	}
	if schema.Items != nil {
		if err := w.walk(schema.Items.Schema, context.ChildItemsContext(schema.Items.Schema), path+"[]"); err != nil {
			return err
		}
	}
	if schema.AdditionalProperties != nil {
		inner := schema.AdditionalProperties.Schema
		return w.walk(inner, context.ChildAdditionalPropertiesContext(inner), path+"{}")
	}
	return nil
}

func (w *walker) compile(schema *apiextensions.JSONSchemaProps, context *validation.CELSchemaContext, path string) error {
	info, err := context.TypeInfo()
	if err != nil {
		return err
	}
	results, err := cel.Compile(info.Schema, info.DeclType, limits.PerCallLimit, w.base, cel.NewExpressionsEnvLoader())
	if err != nil {
		return err
	}
	for i, result := range results {
		written := schema.XValidations[i]
		times := result.MaxCardinality
		if context.MaxCardinality != nil {
			times = *context.MaxCardinality
		}
		rule := Cost{Path: path, Kind: "rule", Units: result.MaxCost * times, Text: written.Rule}
		if result.Error != nil {
			rule.Error = result.Error.Error()
		}
		w.costs = append(w.costs, rule)
		if written.MessageExpression != "" {
			message := Cost{Path: path, Kind: "message", Units: result.MessageExpressionMaxCost, Text: written.MessageExpression}
			if result.MessageExpressionError != nil {
				message.Error = result.MessageExpressionError.Error()
			}
			w.costs = append(w.costs, message)
		}
	}
	return nil
}

func report(file string, base *environment.EnvSet) (Report, error) {
	text, err := os.ReadFile(file)
	if err != nil {
		return Report{}, err
	}
	var object metav1.TypeMeta
	if err := yaml.Unmarshal(text, &object); err != nil {
		return Report{}, err
	}
	switch object.Kind {
	case "CustomResourceDefinition":
		return definitionReport(file, text, base)
	case "ValidatingAdmissionPolicy":
		return policyReport(file, text, base)
	}
	return Report{}, fmt.Errorf("kind %q is not known here: CustomResourceDefinition and ValidatingAdmissionPolicy are", object.Kind)
}

func definitionReport(file string, text []byte, base *environment.EnvSet) (Report, error) {
	var definition v1.CustomResourceDefinition
	if err := yaml.UnmarshalStrict(text, &definition); err != nil {
		return Report{}, err
	}
	var internal apiextensions.CustomResourceDefinition
	if err := v1.Convert_v1_CustomResourceDefinition_To_apiextensions_CustomResourceDefinition(&definition, &internal, nil); err != nil {
		return Report{}, err
	}
	schema := internal.Spec.Validation
	if schema == nil {
		schema = internal.Spec.Versions[0].Schema
	}
	found := walker{base: base, costs: []Cost{}}
	if err := found.walk(schema.OpenAPIV3Schema, validation.RootCELContext(schema.OpenAPIV3Schema), ""); err != nil {
		return Report{}, err
	}
	sort.SliceStable(found.costs, func(i, j int) bool { return found.costs[i].Units > found.costs[j].Units })
	result := Report{File: file, Costs: found.costs}
	for _, cost := range found.costs {
		result.Total += cost.Units
	}
	return result, nil
}

func main() {
	release := flag.String("release", "", "Kubernetes release whose API server is to take the expressions, such as 1.32")
	flag.Parse()
	wanted := environment.DefaultCompatibilityVersion()
	if *release != "" {
		wanted = version.MustParseGeneric(*release).SubtractMinor(1)
	}
	base := environment.MustBaseEnvSet(wanted)
	reports := make([]Report, 0, flag.NArg())
	for _, file := range flag.Args() {
		found, err := report(file, base)
		if err != nil {
			fmt.Fprintf(os.Stderr, "cel-cost: %s: %v\n", file, err)
			os.Exit(1)
		}
		reports = append(reports, found)
	}
	if err := json.NewEncoder(os.Stdout).Encode(reports); err != nil {
		fmt.Fprintf(os.Stderr, "cel-cost: %v\n", err)
		os.Exit(1)
	}
}
