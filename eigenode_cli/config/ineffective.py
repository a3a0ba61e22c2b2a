"""Terms that train nothing because no target gives them anything to compare, and fixed steps too long for the target.

Targets come from the truth's spectra, so this is asked last, of a command line that is otherwise right: it loads SciPy
and Numba, and solves the system once.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.arrays import Floats
from eigenode_cli.config.names import damped_frequencies, named_terms, stated_ranges
from eigenode_cli.config.outline import is_table
from eigenode_cli.config.schema import SystemConfig
from eigenode_cli.terms import of_target, split_grads

if TYPE_CHECKING:
    from eigenode_cli.data.targets import TruthTarget

OF_PAIRS, OF_RATIO = of_target("pairs"), of_target("ratio")
"""Terms that only act where a target has a pair, or a finite stiffness ratio."""


def late_faults(config: DictConfig) -> list[str]:
    """Return what only targets tell, of a configuration without other faults: idle terms, a step that is too long."""
    return [*_target_faults(config), *_step_faults(config)]


def _step_faults(config: DictConfig) -> Iterator[str]:
    """Yield a fault for a fixed step that does not fit into the horizon, or not twice into a period of the target."""
    if "step" not in config.solver:
        return
    step, table = config.solver.step, is_table(config.system)
    if not table and step > config.system.horizon:
        yield f"solver.step={step:g}: longer than system.horizon={config.system.horizon:g} s"
        return
    if config.target.name == "stated":
        fastest = max((high for _, high in damped_frequencies(config.target)), default=0.0)
    else:
        fastest = 0.0 if table else _fastest(config)
    if step * fastest > 0.5:
        yield (
            f"solver.step={step:g}: the target swings with {fastest:.3g} Hz, and a step must fit twice into its period;"
            f" write at most solver.step={0.5 / fastest:.2g}"
        )


def _fastest(config: DictConfig) -> float:
    """Return the highest frequency in Hz of the truth along its trajectory, 0 where it has no pair."""
    target, times = _truth_target(config, 1.0)
    try:
        rows = target.rows(times)
    except ValueError:  # a system that cannot be solved is for the run to tell
        return 0.0
    known = rows.frequency[np.isfinite(rows.frequency)]
    return float(known.max(initial=0.0))


def _target_faults(config: DictConfig) -> list[str]:
    """Return a fault for every setting that names terms without effect."""
    if config.target.name == "stated":
        return list(_lost_pairs(config))
    named = {f"{key}={text}": split_grads(text) for key, text in named_terms(config)}
    at_rest = config.target.at == "equilibrium"
    if not (at_rest or any({*OF_PAIRS, *OF_RATIO}.intersection(words) for words in named.values())):
        return []
    try:
        pairs, ratios = _truth(config)
    except ValueError as error:
        return [f"target.at=equilibrium: {error}"]
    faults = []
    for setting, words in named.items():
        idle = [word for word in OF_PAIRS if word in words and not pairs]
        if idle:
            faults.append(
                f"{setting}: no target has a pair: {_no_effect(idle)}; the truth's eigenvalues are real at"
                f" {'its equilibrium' if at_rest else 'all data times'}, so leave out what has no effect, or state"
                " pairs with target=stated"
            )
        idle = [word for word in OF_RATIO if word in words]
        if idle and not ratios and config.target.stiffness is None:
            faults.append(
                f"{setting}: no target has a finite stiffness ratio: {_no_effect(idle)}; state"
                " target.stiffness=[low,high]"
            )
    return faults


def _no_effect(words: list[str]) -> str:
    return f"{', '.join(words)} {'has' if len(words) == 1 else 'have'} no effect"


def _lost_pairs(config: DictConfig) -> Iterator[str]:
    """Yield a fault for each stated pair that by the rule for all spectra is none."""
    from eigenode_cli.data.targets import StatedTarget  # noqa: PLC0415  # Numba, only once all else is right

    frequency, damping = damped_frequencies(config.target), stated_ranges(config.target.damping)
    spectrum, level = StatedTarget(frequency, damping).spectrum()
    for number, (hertz, ratio) in enumerate(zip(config.target.frequency, config.target.damping, strict=True)):
        if not spectrum[number].imag > level:
            yield (
                f"target.frequency={config.target.frequency} target.damping={config.target.damping}: the pair of"
                f" {hertz!r} Hz with damping {ratio!r} is no pair to rounding (2 pi f must be above {level:.2g} 1/s);"
                " state less damping, or leave this pair out"
            )


def _truth(config: DictConfig) -> tuple[bool, bool]:
    """Whether any target of the truth has a pair, and whether any has a finite stiffness ratio.

    Raises:
        ValueError: they are to be those of an equilibrium, and there is none.
    """
    target, times = _truth_target(config, config.target.frequency_factor)
    if config.target.at == "equilibrium":
        there = target.resting(times)[1]
        return bool(there.pairs.any()), bool(np.isfinite(there.stiffness).any())
    try:
        along = target.rows(times)
    except ValueError:  # a system that cannot be solved is for the run to tell
        return True, True
    targets = along.rows(np.arange(0, times.size, config.eigen.every))
    return bool(targets.pairs.any()), bool(np.isfinite(targets.stiffness).any())


def _truth_target(config: DictConfig, factor: float) -> "tuple[TruthTarget, Floats]":
    """Return the truth's target with a factor on its frequencies, and the data times in s."""
    from eigenode_cli.config.build import build_truth  # noqa: PLC0415  # SciPy, only once all else is right
    from eigenode_cli.data.targets import TruthTarget  # noqa: PLC0415  # Numba, as above

    settings = config.system
    truth = build_truth(cast(SystemConfig, OmegaConf.to_object(settings)))
    return TruthTarget(truth, factor), np.linspace(0.0, settings.horizon, settings.points)
