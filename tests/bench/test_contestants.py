import numpy as np
import pytest

from eigenode_cli.bench.agreement import agreement
from eigenode_cli.bench.case import Case, oscillating, torch_field
from eigenode_cli.bench.contestants import OURS, PEERS, BareSolve, Contestant
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.model import flat_parameters
from tests.conftest import make_case

IN_TORCH = ("torch", "torchdiffeq", "torchode")


def peer(name: str) -> Contestant:
    contestant = PEERS[name]
    if contestant.missing():
        pytest.skip(f"optional: {', '.join(contestant.missing())} not installed")
    return contestant


def paper_case(seed: int) -> Case:
    """The paper's network with random weights on the Van der Pol oscillator, over a short horizon."""
    system = make_case("vdp")
    system.horizon, system.points = 3.0, 10
    field = system.field(seed=seed)
    problem = system.problem(terms=("sol", "frq", "dmp", "stb", "osc"))
    return Case(shape_of(field), problem, flat_parameters(field))


@pytest.mark.parametrize("name", IN_TORCH)
@pytest.mark.parametrize("seed", [0, 3])
def test_peers_in_torch_give_the_same_on_the_papers_network(name: str, seed: int) -> None:
    case = paper_case(seed).tight()
    close = agreement(peer(name).build(case).result(), OURS.build(case).result())
    assert close.holds, close


@pytest.mark.parametrize("name", IN_TORCH)
def test_peers_in_torch_give_the_same_on_more_states(name: str) -> None:
    case = oscillating(6, [4], 1.0, 5, ("sol", "frq")).tight()
    close = agreement(peer(name).build(case).result(), OURS.build(case).result())
    assert close.holds, close


@pytest.mark.slow
@pytest.mark.parametrize("made", [lambda: paper_case(0), lambda: oscillating(6, [4], 1.0, 5, ("sol", "frq"))])
def test_every_adjoint_of_diffrax_gives_the_same(made) -> None:
    contestant = peer("diffrax")
    from eigenode_cli.bench.plain_jax import _runner, choices  # noqa: PLC0415  # an optional peer

    case = made()
    close = agreement(contestant.build(case.tight()).result(), OURS.build(case.tight()).result())
    assert close.holds, close
    results = [_runner(case, choice, "PI").result() for choice in choices(case, 64)]
    assert len(results) == 3
    for other in results[1:]:
        np.testing.assert_allclose(other.gradients, results[0].gradients, rtol=1e-9, atol=1e-12)


def test_the_terms_of_the_comparison_are_not_all_zero() -> None:
    values = np.array([OURS.build(paper_case(seed).tight()).result().values for seed in (0, 3)])
    assert (values.max(axis=0) > 0.0).all()


def test_an_absent_package_is_named() -> None:
    contestant = Contestant("x", "x", PEERS["torch"].build, ("torch", "no_such_package"))
    assert contestant.missing() == ["no_such_package"]


def test_the_bare_solve_is_the_same_solve() -> None:
    case = paper_case(0).tight()
    bare = BareSolve(case)
    assert bare() == 0
    from eigenode_cli.engines.compiled.engine import CompiledEngine  # noqa: PLC0415

    expected = CompiledEngine(case.shape, case.problem).loss_jacobian(case.theta).trajectory
    np.testing.assert_allclose(bare.states, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("n", "hidden"), [(2, [8]), (6, [4]), (4, [8, 8])])
def test_made_weights_oscillate_with_all_the_pairs_they_can_hold(n: int, hidden: list[int]) -> None:
    case = oscillating(n, hidden, 1.0, 5, ("sol", "frq"))
    pairs = min(n, *hidden) // 2
    assert (case.problem.targets.pairs == pairs).all()
    assert case.problem.targets.frequency.shape == (5, pairs)
    values = OURS.build(case).result().values
    # the targets are the network's own frequencies, two percent higher, over both members of each pair
    expected = 0.02 / 1.02 * 2.0 * case.problem.targets.frequency.sum() / (5 * n)
    assert values[1] == pytest.approx(expected, rel=1e-3)


def test_a_case_and_its_torch_field_hold_the_same_parameters() -> None:
    case = oscillating(4, [6], 1.0, 3, ("sol",))
    field = torch_field(case)
    np.testing.assert_array_equal(flat_parameters(field), case.theta)
    assert shape_of(field).sizes == case.shape.sizes
