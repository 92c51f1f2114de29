"""Values of the laws that exports state: an evaluator of their expressions, nothing else."""

import ast
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.integrate import quad

from pyburgers.model.arrhenius import GAS_CONSTANT

FUNCTIONS = {
    "exp": np.exp,
    "sinh": np.sinh,
    "sqrt": np.sqrt,
    "abs": abs,
    "sign": np.sign,
    "max": max,
    "log": np.log,
    "pi": np.pi,
}


def names_of(values: Mapping[str, float], **state: float) -> dict[str, float]:
    """Return what laws refer to: parameters, constants, and a state."""
    factor = values["beta"] * values["activation_enthalpy"]
    return {**values, "R": GAS_CONSTANT, "ln_flow_law_factor": factor, **state}


class _Quadrature(ast.NodeTransformer):
    """Writes integral(f, x, a, b) as integral(lambda x: f, a, b)."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "integral":
            integrand, variable, *ends = node.args
            assert isinstance(variable, ast.Name)
            arguments = ast.arguments([], [ast.arg(variable.id)], None, [], [], None, [])
            node.args = [ast.Lambda(arguments, integrand), *ends]
        return node


def value_of(expression: str, values: Mapping[str, Any]) -> float:
    """Evaluate what stands behind the equals sign, if there is one; ^ is a power."""
    text = expression.split("=")[-1].strip().replace("^", "**")
    tree = ast.fix_missing_locations(_Quadrature().visit(ast.parse(text, mode="eval")))

    def integral(integrand: Any, low: float, high: float) -> float:
        return float(quad(integrand, low, high, epsabs=0.0, epsrel=1e-10, limit=400)[0])

    names = {**FUNCTIONS, "integral": integral, **values}
    return float(eval(compile(tree, "law", "eval"), names))
