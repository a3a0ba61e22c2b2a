"""Experiment files: found, read with all their faults at once, and checked against what `eigenode train` accepts."""

import types
from collections.abc import Iterator, Sequence
from dataclasses import MISSING as NEVER
from dataclasses import Field, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import yaml

from eigenode_cli.config.check import Examined, examine, normalise
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.validators import constraint_of
from eigenode_cli.errors import UserError, nearest, unknown
from eigenode_cli.reproduce.schema import ClaimSpec, Experiment, FigureSpec, RunSpec, default_of
from eigenode_cli.runs.paths import EXPERIMENT_DIR

WORDS = {
    int: "a whole number",
    float: "a number",
    str: "text",
    bool: "true or false",
    list: "a list",
    dict: "a mapping",
}

MEASURED = "measured"
"""Folder of the settings of measured records, which `eigenode train measured=NAME` takes."""


def names(folder: Path = EXPERIMENT_DIR) -> dict[str, Path]:
    """File of every experiment by its name, in alphabetical order of the paths."""
    return {path.stem: path for path in sorted(folder.rglob("*.yaml")) if path.parent.name != MEASURED}


def load(name: str, folder: Path = EXPERIMENT_DIR) -> Experiment:
    """Return the experiment called `name`, or in the file `name` if that ends in .yaml.

    Raises:
        UserError: there is none, or its file has faults; with all of them.
    """
    if name.endswith(".yaml"):
        return read(Path(name))
    known = names(folder)
    if name not in known:
        raise UserError(f"reproduce {name}: {unknown('experiment', name, known)}")
    return read(known[name])


def read(path: Path) -> Experiment:
    """Return the experiment in a file.

    Raises:
        UserError: with all faults of the file.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{path.name}: not valid YAML: {' '.join(str(error).split())}") from error
    faults: list[str] = []
    experiment = _read(Experiment, content, "", faults)
    if not faults:
        faults += _fit(experiment)
    if faults:
        raise UserError([f"{path.name}: {fault}" for fault in faults])
    return experiment


def _read(schema: type[Any], content: Any, prefix: str, faults: list[str]) -> Any:
    """Return an instance of a dataclass from a mapping; what is wrong goes to `faults`."""
    if not isinstance(content, dict):
        faults.append(f"{prefix.rstrip('.') or 'the file'}: must be a mapping of settings")
        return None
    known = {entry.name: entry for entry in fields(schema)}
    for key in content:
        if key not in known:
            guess = nearest(str(key), known)
            faults.append(f"{prefix}{key}: no such setting" + (f", did you mean {guess}?" if guess else ""))
    hints = get_type_hints(schema)
    values = {}
    for name, entry in known.items():
        if name in content:
            values[name] = _value(hints[name], content[name], f"{prefix}{name}", entry, faults)
        else:
            values[name] = default_of(entry)
            if values[name] is NEVER:
                faults.append(f"{prefix}{name}: missing")
    return schema(**values)


def _value(hint: Any, value: Any, key: str, entry: "Field[Any]", faults: list[str]) -> Any:
    """Return a value of the type that the hint names: optional, dataclass, list, mapping, or a plain one."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return None if value is None else _value(inner[0], value, key, entry, faults)
    if is_dataclass(hint) and isinstance(hint, type):
        return _read(hint, value, f"{key}.", faults)
    if origin is list and isinstance(value, list):
        return [_value(inner[0], item, f"{key}[{i}]", entry, faults) for i, item in enumerate(value)]
    if origin is dict and isinstance(value, dict):
        return {str(name): _value(inner[1], item, f"{key}.{name}", entry, faults) for name, item in value.items()}
    return _plain(hint if origin is None else origin, value, key, entry, faults)


def _plain(kind: Any, value: Any, key: str, entry: "Field[Any]", faults: list[str]) -> Any:
    """Return a number, text or switch within its constraint; a whole number is a number, too."""
    if kind is float and type(value) is int:
        value = float(value)
    fault = constraint_of(entry).fault(value) if type(value) is kind else f"must be {WORDS[kind]}"
    if fault:
        faults.append(f"{key}={value}: {fault}")
    return value


def _fit(experiment: Experiment) -> Iterator[str]:
    """Yield what must fit together in one experiment."""
    if not experiment.protocols:
        yield "protocols: name at least one"
    if not experiment.runs and not experiment.growth:
        yield "runs: name at least one"
    for kind, items in (("figure", experiment.figures), ("claim", experiment.claims)):
        listed = [item.name for item in items]
        yield from (f"{kind} {name}: is there twice" for name in dict.fromkeys(listed) if listed.count(name) > 1)
    for figure in experiment.figures:
        yield from (f"figure {figure.name}: {fault}" for fault in _figure_faults(figure, experiment.runs))
    for claim in experiment.claims:
        yield from (f"claim {claim.name}: {fault}" for fault in _claim_faults(claim, experiment.runs))


def _figure_faults(figure: FigureSpec, runs: dict[str, RunSpec]) -> Iterator[str]:
    yield from (unknown("run", run, runs) for run in figure.runs or [] if run not in runs)
    if figure.twice and figure.kind != "solution":
        yield f"twice: a figure of the {figure.kind} has no horizon"


def _claim_faults(claim: ClaimSpec, runs: dict[str, RunSpec]) -> Iterator[str]:
    yield from (unknown("run", run, runs) for run in (claim.run, claim.against) if run and run not in runs)
    if claim.at_least is None and claim.at_most is None:
        yield "needs at_least, at_most or both"
    stable = claim.measure in ("stable_first", "stable_from")
    if stable != (claim.tolerance is not None):
        yield f"tolerance: {'missing for' if stable else 'not read by'} {claim.measure}"
    if (claim.measure == "rebound") != (claim.window is not None and len(claim.window) == 2):
        yield "window: rebound takes the first and the last training step, no other measure takes it"
    if claim.share is not None and claim.statistic != "share":
        yield f"share: not read by the {claim.statistic}"
    if claim.step is not None and claim.measure not in AT_A_STEP:
        yield f"step: not read by {claim.measure}"


AT_A_STEP = ("sol", "dense_error", "relative_error", "sol_to_average", "max_real")
"""Measures that can be taken at any recorded step."""


def words_of(run: RunSpec, protocol: str) -> list[str]:
    """Return the words of `eigenode train` that start a run, but for its seed."""
    chosen = [f"protocol={run.protocol or protocol}", f"system={run.system}", f"grads={run.grads}"]
    return normalise([*chosen, *run.overrides, "trainer.figures=false"])


@dataclass
class Checked:
    """Outcome of checking all experiments: how many configurations were composed, and the faults."""

    experiments: int
    compositions: int
    faults: list[str]


def check_all(composer: Composer, folder: Path = EXPERIMENT_DIR) -> Checked:
    """Read every experiment and compose each of its runs under each of its protocols."""
    found = names(folder)
    faults: list[str] = []
    compositions = 0
    for name, path in found.items():
        try:
            experiment = read(path)
        except UserError as error:
            faults += error.faults
            continue
        for protocol in experiment.protocols:
            if protocol not in composer.choices("protocol"):
                faults.append(f"{path.name}: {unknown('protocol', protocol, composer.choices('protocol'))}")
                continue
            compositions += len(experiment.runs)
            faults += run_faults(composer, name, experiment, protocol)
    return Checked(len(found), compositions, list(dict.fromkeys(faults)))


def run_faults(composer: Composer, name: str, experiment: Experiment, protocol: str) -> Sequence[str]:
    """Return what `eigenode train` would say against the runs of an experiment."""
    faults = []
    for label, run in experiment.runs.items():
        found = examine(composer, words_of(run, protocol))
        faults += run_lines(name, label, found)
    return faults


def run_lines(name: str, label: str, found: Examined) -> list[str]:
    """Return the faults of one run with its place."""
    return [f"{name}: run {label}: {fault}" for fault in (*found.faults, *found.useless.values())]
