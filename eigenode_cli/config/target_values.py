"""Checks of what is stated of the target."""

from collections.abc import Iterable, Iterator
from typing import Any

from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.names import named_terms, training_terms
from eigenode_cli.config.outline import Outline, is_table
from eigenode_cli.config.validators import show
from eigenode_cli.terms import AT_TARGET, TERMS, split_grads


def target_faults(config: DictConfig, found: Outline | None) -> Iterator[str]:
    """Yield a corridor is one, and stated targets give the terms something to meet; `found` is the system's outline."""
    target = config.target
    corridor = target.stiffness
    if corridor is not None and not (len(corridor) == 2 and corridor[0] <= corridor[1]):
        yield f"target.stiffness={show(corridor)}: must be [low,high] with low at most high, for example [1,1]"
    elsewhere = set(training_terms(config)) - {"sol", *AT_TARGET}
    for number, stage in enumerate(config.stages):
        if target.at == "equilibrium" and stage.spectra == "data" and not elsewhere:
            yield f"stages.{number}.spectra=data: no effect, as target.at=equilibrium takes these terms there"
    origin = {word: f"{key}={text}" for key, text in reversed(list(named_terms(config))) for word in split_grads(text)}
    if "stp" in origin and config.stp.step is None:
        yield f"{origin['stp']}: stp has no solver to keep to; state stp.step=... in s, and stp.method"
    if target.name != "stated":
        if is_table(config.system):
            yield f"target={target.name}: measured data have no truth; write target=stated"
        return
    wrong = [*_stated_faults("target.frequency", target.frequency), *_stated_faults("target.damping", target.damping)]
    yield from wrong
    count, pairs = len(target.frequency), len(target.frequency) if found is None else len(found.states) // 2
    if count != len(target.damping):
        yield (
            f"target.damping={show(target.damping)}: needs one value for each of the {count} in"
            f" target.frequency={show(target.frequency)}"
        )
    if count > pairs:
        yield f"target.frequency={show(target.frequency)}: {config.system.name} has room for {pairs} pair(s)"
    for word in training_terms(config):
        key = origin[word]
        target_part = TERMS[word].target if word in TERMS else None
        if target_part == "pairs" and count == 0:
            yield f"{key}: {word} has nothing to meet; state target.frequency and target.damping"
        if target_part == "ratio" and corridor is None:
            yield f"{key}: {word} has nothing to meet; state target.stiffness=[low,high]"


def _stated_faults(key: str, entries: Iterable[Any]) -> Iterator[str]:
    """Yield every entry of a stated target is a number or a range."""
    for entry in entries:
        ends = list(entry) if OmegaConf.is_list(entry) else [entry]
        numbers = all(isinstance(end, int | float) and not isinstance(end, bool) for end in ends)
        if not (numbers and (not OmegaConf.is_list(entry) or len(ends) == 2)):
            yield f"{key}={show(entries)}: {show(entry)} is no number and no range [low,high]"
        elif ends[0] > ends[-1]:
            yield f"{key}={show(entries)}: the range {show(entry)} has its low end last"
