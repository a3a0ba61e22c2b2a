"""The learned vector field as an ONNX graph, out of operators that runtimes have in double precision too."""

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.errors import UserError
from eigenode_cli.export.exported import ExportedModel, Monomials, Perceptron
from eigenode_cli.export.text import identifier

if TYPE_CHECKING:
    import onnx

OPSET, IR_VERSION = 17, 8
"""Of 2022, so that older runtimes read it as well."""
PRECISIONS = {"float64": np.float64, "float32": np.float32}


def onnx_file(model: ExportedModel, precision: str = "float64") -> "onnx.ModelProto":
    """Return the graph: inputs `x (batch, n)` and, where there are inputs, `u (batch, k)`, output `dxdt (batch, n)`.

    Args:
        model: what is exported.
        precision: of all its numbers, one of `PRECISIONS`.

    Raises:
        UserError: onnx is not installed.
    """
    try:
        import onnx  # noqa: PLC0415  # an extra
    except ImportError as error:
        raise UserError("--to onnx needs the package onnx: pip install 'eigenode[onnx]'") from error
    graph = _Graph(PRECISIONS[precision])
    z, scaled = _scaled(graph, model)
    network = model.network
    y = _perceptron(graph, network, z) if isinstance(network, Perceptron) else _monomials(graph, network, z)
    if model.linear is not None:
        y = graph.add("Add", y, graph.add("MatMul", z, graph.constant("linear", model.linear.T)))
    if model.structure == "second_order":
        half = len(model.states) // 2
        velocities = graph.gather("velocities", scaled, np.arange(half, len(model.states)))
        y = graph.add("Concat", velocities, y, axis=1)
    rates = graph.factor("rate_scale", y, model.state_units / model.time_unit)
    graph.add("Identity", rates, output="dxdt")
    made = onnx.helper.make_model(
        _graph_proto(graph, model),
        producer_name="eigenode",
        producer_version=model.version,
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        doc_string=f"dx/dt of {model.name}",
    )
    onnx.helper.set_model_props(made, metadata(model))
    onnx.checker.check_model(made, full_check=True)
    return made


def metadata(model: ExportedModel) -> dict[str, str]:
    """Return what is known of a model, texts as they are and the rest as JSON."""
    found: dict[str, Any] = {
        "name": model.name,
        "states": [{"name": state.name, "unit": state.unit} for state in model.states],
        "inputs": [{"name": state.name, "unit": state.unit} for state in model.inputs],
        "initial_state": model.initial_state.tolist(),
        "horizon": [model.start, model.end],
        "lowest": model.lowest.tolist(),
        "highest": model.highest.tolist(),
        "modes": [{"frequency": frequency, "damping": damping} for frequency, damping in model.modes],
        "modes_at": model.modes_at,
        "step": model.step,
        "trained_steps": model.trained_steps,
        "command": model.command,
        "run": model.run,
        "eigenode": model.version,
    }
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in found.items()}


class _Graph:
    """Nodes and constants as they are added, each value by its name."""

    def __init__(self, kind: type[np.floating[Any]]) -> None:
        self.kind = kind
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, name: str, values: Any, kind: Any = None) -> str:
        """Add a constant; returns its name."""
        from onnx import numpy_helper  # noqa: PLC0415  # an extra

        if name not in [known.name for known in self.constants]:
            array = np.ascontiguousarray(np.asarray(values, dtype=kind or self.kind))
            self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Add a node; returns the name of its output."""
        from onnx import helper  # noqa: PLC0415  # an extra

        name = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(
            helper.make_node(operator, list(inputs), [name], name=f"node_{len(self.nodes)}", **attributes)
        )
        return name

    def factor(self, name: str, value: str, factors: Floats) -> str:
        """Multiply by factors, none of which may be other than 1 for the value to stay as it is."""
        return value if (factors == 1.0).all() else self.add("Mul", value, self.constant(name, factors))

    def gather(self, name: str, value: str, columns: Any) -> str:
        """Take columns of a matrix."""
        return self.add("Gather", value, self.constant(name, columns, np.int64), axis=1)


def _graph_proto(graph: _Graph, model: ExportedModel) -> "onnx.GraphProto":
    from onnx import helper  # noqa: PLC0415  # an extra

    element = helper.np_dtype_to_tensor_dtype(np.dtype(graph.kind))

    def value(name: str, size: int) -> "onnx.ValueInfoProto":
        return helper.make_tensor_value_info(name, element, ["batch", size])

    inputs = [value("x", len(model.states)), *([value("u", len(model.inputs))] if model.inputs else [])]
    outputs = [value("dxdt", len(model.states))]
    return helper.make_graph(graph.nodes, identifier(model.name), inputs, outputs, graph.constants)


def _scaled(graph: _Graph, model: ExportedModel) -> tuple[str, str]:
    """Return z and its part x/X."""
    scaled, unit = "x", model.state_units
    if not (unit == 1.0).all():
        scaled = graph.add("Div", "x", graph.constant("state_scale", unit))
    if not model.inputs:
        return scaled, scaled
    inputs = "u"
    if not (model.input_units == 1.0).all():
        inputs = graph.add("Div", "u", graph.constant("input_scale", model.input_units))
    return graph.add("Concat", scaled, inputs, axis=1), scaled


def _perceptron(graph: _Graph, network: Perceptron, z: str) -> str:
    h = z if network.input_scale is None else graph.factor("network_input", z, network.input_scale)
    for number, layer in enumerate(network.layers):
        if number:
            h = _activation(graph, network.activation, h)
        product = graph.add("MatMul", h, graph.constant(f"weight_{number}", layer.weight.T))
        h = graph.add("Add", product, graph.constant(f"bias_{number}", layer.bias))
    return h if network.output_scale is None else graph.factor("network_output", h, network.output_scale)


def _activation(graph: _Graph, name: str, z: str) -> str:
    """Return an activation of z; onnxruntime has no Softplus and no Elu in double precision."""
    operators = {"tanh": "Tanh", "sigmoid": "Sigmoid", "relu": "Relu", "sin": "Sin", "identity": "Identity"}
    if name in operators:
        return graph.add(operators[name], z)
    if name == "silu":
        return graph.add("Mul", z, graph.add("Sigmoid", z))
    zero, one = graph.constant("zero", 0.0), graph.constant("one", 1.0)
    if name == "elu":
        below = graph.add("Sub", graph.add("Exp", graph.add("Min", z, zero)), one)
        return graph.add("Add", graph.add("Max", z, zero), below)
    decay = graph.add("Exp", graph.add("Neg", graph.add("Abs", z)))
    return graph.add("Add", graph.add("Max", z, zero), graph.add("Log", graph.add("Add", one, decay)))


def _monomials(graph: _Graph, network: Monomials, z: str) -> str:
    """Return a polynomial: 1 and the powers of all variables side by side, of which a monomial takes one a variable."""
    count = network.exponents.shape[1]
    zero, one = graph.constant("zero", 0.0), graph.constant("one", 1.0)
    ones = graph.add("Add", graph.add("Mul", graph.gather("first", z, [0]), zero), one)
    powers = [z]
    for _ in range(network.degree - 1):
        powers.append(graph.add("Mul", powers[-1], z))
    table = graph.add("Concat", ones, *powers, axis=1)
    product = ""
    for i, exponents in enumerate(network.exponents.T):
        columns = np.where(exponents == 0, 0, 1 + (exponents - 1) * count + i)
        part = graph.gather(f"powers_{i}", table, columns)
        product = graph.add("Mul", product, part) if product else part
    return graph.add("MatMul", product, graph.constant("coefficients", network.coefficients.T))
