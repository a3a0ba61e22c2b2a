"""Kernels as plain Python (`NUMBA_DISABLE_JIT=1`): the same numbers, and a buffer's end is seen."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.engines.compiled import debug_memory as memory
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.method import Steps
from eigenode_cli.terms import NAMES
from tests.engines.compiled import oracle

ROOT = Path(__file__).resolve().parents[3]
SUBSET = (
    "tests/engines/compiled/test_spectrum.py",
    "tests/engines/compiled/test_activations.py",
    "tests/engines/compiled/test_loss_jacobian.py::test_every_solver",
    "tests/engines/compiled/test_engine.py::test_guard_bounds_gradients_where_eigenvalues_meet",
    "tests/engines/compiled/test_engine.py::test_evaluate",
    "tests/engines/compiled/test_engine.py::test_user_terms",
    "tests/engines/compiled/test_advance.py::test_without_halt_failed_solves_stabilise",
    "tests/engines/test_agreement.py::test_failed_solve_stabilises_alike",
    "tests/terms/test_terms.py",
)
"""Seconds in plain Python, and between them they come through every kernel."""


def in_python(*words: str, cwd: Path = ROOT, text: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python with these arguments where kernels are plain Python."""
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *words], cwd=cwd, env=environment, input=text, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("at", [-1, 6])
def test_an_element_outside_of_its_buffer_is_an_error_with_its_place(at: int) -> None:
    pointer = memory.shift(memory.doubles(memory.Address(np.arange(6.0).reshape(2, 3)), 1), 2)
    assert [pointer[-3], pointer[0], pointer[2]] == [0.0, 3.0, 5.0]
    message = rf"array \(2, 3\): no element {at} \(offset 3, index {at - 3}\), its size is 6 float64"
    with pytest.raises(IndexError, match=message):
        pointer[at - 3]
    with pytest.raises(IndexError, match=message):
        pointer[at - 3] = 0.0
    with pytest.raises(IndexError, match="no element 6"):
        memory.carray(pointer, (2, 2))
    assert memory.carray(pointer, (3, 1)).tolist() == [[3.0], [4.0], [5.0]]
    assert memory.carray(memory.shift(pointer, 3), (0, 2)).shape == (0, 2)


def test_buffers_have_the_names_of_their_fields() -> None:
    steps = memory.label(Steps(2, memory.Address(np.zeros(2)), *[memory.Address(np.zeros(1))] * 2, *[0] * 16))
    with pytest.raises(IndexError, match=r"Steps.size: no element 2 \(offset 0, index 2\)"):
        memory.doubles(steps.size, 0)[2] = 1.0


def test_pointers_share_memory_and_know_its_type() -> None:
    array = np.zeros(2, dtype=np.complex128)
    address = memory.Address(array)
    memory.doubles(address, 3)[0] = 2.0
    assert memory.complexes(address, 1)[0] == array[1] == 2j
    assert address == array.ctypes.data
    with pytest.raises(TypeError, match="holds complex128, not int64"):
        memory.integers(address, 0)
    with pytest.raises(TypeError, match="a number"):
        memory.doubles(address + 8, 0)
    with pytest.raises(ValueError, match="contiguous"):
        memory.start_of(np.zeros(4)[::2])
    assert type(memory.integers(memory.Address(np.ones(1, dtype=np.int64)), 0)[0]) is int
    assert memory.booleans(memory.Address(np.ones(1, dtype=np.bool_)), 0)[0] is True


@pytest.mark.parametrize("number", [0.0, -0.0, 1.0, -math.pi, 5e-324, -math.inf])
def test_bits_of_a_number(number: float) -> None:
    bits = int(np.float64(number).view(np.int64))
    assert memory.bits_of(number) == bits
    assert memory.float_of(bits).tobytes() == np.float64(number).tobytes()
    assert memory.float_of(bits + 2**64).tobytes() == np.float64(number).tobytes()  # machine code overflows


def results() -> dict[str, np.ndarray]:
    """What the engine says of problems that come through every kernel."""
    found: dict[str, np.ndarray] = {}
    for n, activation, way, solver in (
        (2, "tanh", "adjoint", oracle.adaptive()),
        (2, "sin", "forward", oracle.adaptive("dopri5")),
        (3, "softplus", "adjoint", oracle.fixed(0.2)),
        (4, "silu", "forward", oracle.adaptive()),
        (4, "elu", "adjoint", oracle.adaptive(max_steps=2, rtol=1e-9)),
    ):
        shape = oracle.make_shape(n, (5, 4), activation, "full")
        engine = CompiledEngine(shape, oracle.make_problem(n, solver=solver), sensitivity=way)
        theta = oracle.make_theta(shape)
        got, evaluated = engine.loss_jacobian(theta), engine.evaluate(theta, np.linspace(0.0, 2.0, 7))
        key = f"{n} {activation} {way}"
        for name in ("values", "gradients", "trajectory", "spectra"):
            found[f"{key} {name}"] = getattr(got, name)
        found[f"{key} dense"] = evaluated.dense
        found[f"{key} counts"] = np.array([got.status, got.n_accepted, got.n_rejected, got.guard_count])
    return found


def test_results_are_those_of_machine_code(tmp_path: Path) -> None:
    script = "import sys, numpy; from tests.engines.compiled.test_debug import results; "
    done = in_python("-c", script + "numpy.savez(sys.argv[1], **results())", str(tmp_path / "plain.npz"))
    assert done.returncode == 0, done.stderr
    plain = np.load(tmp_path / "plain.npz")
    for key, wanted in results().items():
        found = plain[key]
        assert found.shape == wanted.shape
        np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
        if not np.isnan(wanted).all():
            scale = np.nanmax(np.abs(wanted))
            # adaptive steps carry the difference of a fused product and sum from step to step
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * scale, err_msg=key)
    assert len(NAMES) == plain["2 tanh adjoint values"].size


OFF_BY_ONE = """
import numpy as np
from eigenode_cli.engines.compiled import kernel
from eigenode_cli.engines.compiled.engine import CompiledEngine
from tests.engines.compiled import oracle

shape = oracle.make_shape(2)
engine = CompiledEngine(shape, oracle.make_problem(2))
theta = oracle.make_theta(shape)
engine.loss_jacobian(theta)
core = engine._core._replace(setup=engine._core.setup._replace(outputs=engine._core.setup.outputs + 1))
states, spectra = engine._outputs()
kernel.forward(core, engine._room.steps, np.empty(0), engine._codes, True, np.empty(6), states, spectra)
"""


def test_an_off_by_one_in_a_kernel_has_a_traceback() -> None:
    done = in_python("-c", OFF_BY_ONE)
    assert done.returncode == 1
    assert "in integrate\n" in done.stderr
    last = done.stderr.rstrip().rpartition("\n")[2]
    assert last == "IndexError: array (9, 2): no element 18 (offset 0, index 18), its size is 18 float64"


def test_kernel_tests_pass_in_plain_python() -> None:
    done = in_python("-m", "pytest", "-q", "-p", "no:cacheprovider", *SUBSET)
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout
    assert "skipped" not in done.stdout


def test_a_debugger_stops_in_a_kernel_of_a_run(tmp_path: Path) -> None:
    """The command of docs/compiled-engine.md, with a smaller network."""
    (line,) = (line for line in (ROOT / "docs/compiled-engine.md").read_text().splitlines() if "-m pdb" in line)
    assignment, python, *words = line.split()
    assert (assignment, python) == ("NUMBA_DISABLE_JIT=1", "python")
    assert words[-3:] == ["train", "engine=compiled", "trainer.steps=2"]
    small = ("system=sparse_oscillator", "network.hidden=[3]", "grads=sol", "trainer.figures=false")
    commands = "import eigenode_cli.engines.compiled.mlp as mlp\nb mlp.evaluate_field\nc\np net.n, x\ncl 1\nc\nq\n"
    done = in_python(*words, *small, f"hydra.run.dir={tmp_path / 'run'}", cwd=tmp_path, text=commands)
    assert "mlp.py" in done.stdout
    assert "(2, <Steps.x from element 0 of 2 float64>)" in done.stdout
    assert done.stdout.count("NUMBA_DISABLE_JIT is set") == 1
    assert "after 2 steps" in done.stdout
