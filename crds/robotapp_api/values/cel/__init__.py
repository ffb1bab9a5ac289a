"""CEL as the API server of Kubernetes 1.37 evaluates it: text in, program out, value out.

Types are checked where a value is used, not before: whoever evaluates an expression here has it from the API server, which
accepts none whose types do not fit, or from our own definitions. Left out are the libraries for IP addresses, URLs, points in
time, arithmetic on durations, formats and authorization.
"""

from robotapp_api.values.cel.errors import EvaluationError, ExpressionError
from robotapp_api.values.cel.program import Program, compile_expression

__all__ = ["EvaluationError", "ExpressionError", "Program", "compile_expression"]
