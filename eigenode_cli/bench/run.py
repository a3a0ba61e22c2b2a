"""One bench: the named cases measured, everything in one dictionary that is bench.json."""

from collections.abc import Callable, Sequence
from math import prod
from typing import Any

import torch

from eigenode_cli import __version__
from eigenode_cli.bench import GROWTH, RECIPES
from eigenode_cli.bench.agreement import GRADIENTS, LOOSE_REASON, VALUES, agreement
from eigenode_cli.bench.case import ATOL, RTOL, TIGHT, Case
from eigenode_cli.bench.contestants import OURS, PEERS, Contestant
from eigenode_cli.bench.growth import measure_growth
from eigenode_cli.bench.measure import compare, describe_machine
from eigenode_cli.bench.training import (
    Trained,
    gradient_over_step,
    six_over_one,
    step_over_floor,
    train_case,
    two_threads,
)

Say = Callable[[str], None]

GROWTH_PEERS = ("torchdiffeq", "diffrax")
WAYS = ("adjoint", "forward")
"""The two ways of sensitivities; the paper's 1.015 is of the second one."""
ONE_TERM = ("sol", "frq")
"""What all six terms are compared with: the term without spectra, and one with them."""


def run_bench(names: Sequence[str], say: Say) -> dict[str, Any]:
    """Measure the named cases, one thread each.

    Args:
        names: of `bench.NAMES`.
        say: told in one line what goes on.
    """
    torch.set_num_threads(1)
    missing = {name: peer.missing() for name, peer in PEERS.items()}
    peers = [peer for name, peer in PEERS.items() if not missing[name]]
    versions = {"torch": torch.__version__.partition("+")[0], "eigenode": __version__}
    for peer in peers:
        versions |= peer.versions()
    content: dict[str, Any] = {
        "machine": describe_machine(versions),
        "tolerances": {"rtol": RTOL, "atol": ATOL, "agreement": TIGHT, "values": VALUES, "gradients": GRADIENTS},
        "missing": {name: packages for name, packages in missing.items() if packages},
        "cases": {},
        "growth": {},
    }
    for name in names:
        if name == GROWTH:
            content["growth"] = measure_growth([peer for peer in peers if peer.name in GROWTH_PEERS], say)
        else:
            say(f"{name}: training its weights")
            content["cases"][name] = measure_trained(name, train_case(name), peers, say)
    content["goals"] = goals(content)
    return content


def measure_trained(name: str, trained: Trained, peers: Sequence[Contestant], say: Say) -> dict[str, Any]:
    """Return a case at trained weights: peers over ours, and our own training step over its floor."""
    case = trained.case
    measured = measure_peers(name, case, peers, say)
    say(f"{name}: training steps")
    step, threads = step_over_floor(trained), two_threads(trained)
    measured |= {
        "train_seconds": trained.train_seconds,
        "step_over_floor": step.as_json(),
        "two_threads": threads.as_json(),
        "six_over_one": {way: {term: six_over_one(case, term, way).as_json() for term in ONE_TERM} for way in WAYS},
    }
    if "torchdiffeq" in measured["ratios"]:
        gradient = PEERS["torchdiffeq"].build(case).call
        measured["gradient_over_step"] = gradient_over_step(trained, gradient).as_json()
    return measured


def measure_peers(name: str, case: Case, peers: Sequence[Contestant], say: Say) -> dict[str, Any]:
    """Agreement of every peer with ours, and the ratio of its time to ours if it agrees."""
    tight, ours, ours_tight = case.tight(), OURS.build(case), OURS.build(case.tight()).result()
    here = ours.result()
    agreements: dict[str, Any] = {}
    ratios: dict[str, Any] = {}
    details = {OURS.name: ours.detail}
    for peer in peers:
        say(f"{name}: {peer.title}")
        runner = peer.build(case)
        close = agreement(peer.build(tight).result(), ours_tight)
        agreements[peer.name] = {
            "holds": close.holds,
            "tight": close.as_json(),
            "timed": agreement(runner.result(), here).as_json(),
        }
        details[peer.name] = runner.detail
        if close.holds:
            ratios[peer.name] = compare(runner.call, ours.call).as_json()
    return {
        "terms": list(case.problem.terms),
        "parameters": int(case.theta.size),
        "steps": here.steps,
        "values": here.values.tolist(),
        "agreement": agreements,
        "timed_differs_because": LOOSE_REASON,
        "ratios": ratios,
        "details": details,
    }


def _goal(what: str, value: float, must: float, aim: float) -> dict[str, Any]:
    """Return a bound and an aim: at most if the aim is the smaller of the two, at least otherwise."""
    less = aim < must
    return {
        "what": what,
        "value": value,
        "bound": "at most" if less else "at least",
        "must": must,
        "aim": aim,
        "holds": value <= must if less else value >= must,
        "aim_holds": value <= aim if less else value >= aim,
    }


def goals(content: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what this engine promises, with the numbers found; only what was measured."""
    found: list[dict[str, Any]] = []
    cases = content["cases"]
    for name, case in cases.items():
        if "gradient_over_step" in case:
            value = case["gradient_over_step"]["median"]
            found.append(_goal(f"{name}: torchdiffeq's gradients over as many training steps", value, 500.0, 1000.0))
        if "diffrax" in case["ratios"]:
            found.append(_goal(f"{name}: diffrax over ours", case["ratios"]["diffrax"]["median"], 4.0, 10.0))
        if "step_over_floor" in case:
            value = case["step_over_floor"]["median"]
            found.append(_goal(f"{name}: whole training step over bare solve", value, 4.0, 2.5))
            found.append(_goal(f"{name}: two threads over one", case["two_threads"]["median"], 1.8, 2.0))
            found += [
                _goal(f"{name}: six terms over {term} alone, {way}", ratio["median"], 1.3, 1.1)
                for way, terms in case["six_over_one"].items()
                for term, ratio in terms.items()
            ]
    diffrax = [case["ratios"]["diffrax"]["median"] for case in cases.values() if "diffrax" in case["ratios"]]
    if len(diffrax) == len(RECIPES):
        found.append(_goal("geometric mean: diffrax over ours", prod(diffrax) ** (1.0 / len(diffrax)), 6.0, 10.0))
    for name, curve in content["growth"].items():
        for peer, rows in curve["ratios"].items():
            smallest = min(ratio["median"] for ratio in rows)
            found.append(_goal(f"growth, {name}: smallest ratio of {peer}", smallest, 1.0, 4.0))
    return found


def disagreements(content: dict[str, Any]) -> list[str]:
    """Contestants that computed something else, one line each."""
    lines = [
        f"{name}: {peer} disagrees"
        for name, case in content["cases"].items()
        for peer, row in case["agreement"].items()
        if not row["holds"]
    ]
    return lines + [
        f"growth, {name}: {peer} disagrees at {values}"
        for name, curve in content["growth"].items()
        for peer, values in curve["disagree"].items()
    ]
