"""The user's own terms evaluated once before a run: on the truth's trajectory and spectra, with the initial network."""

from collections.abc import Iterator

import torch
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.build import build_dataset, build_field, build_truth
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data.targets import TruthTarget
from eigenode_cli.terms.user import load_user_terms, value_fault


def rehearse(config: DictConfig) -> Iterator[str]:
    """Yield a fault for each own term of a configuration, valid otherwise, whose value is none.

    A term that raises is left to the run, which keeps its traceback: it may need what only a training gives it.
    """
    settings = TrainConfig(**vars(OmegaConf.to_object(config)))
    truth = build_truth(settings.system)
    try:
        series = build_dataset(settings.system, truth, settings.seed).series[0]
    except ValueError:  # the run says so
        return
    states = truth.states(series.times)
    spectra = TruthTarget(truth).spectra(series.times)[:: settings.eigen.every]
    known = {
        "trajectory": torch.from_numpy(states).requires_grad_(),
        "spectra": torch.from_numpy(spectra).requires_grad_(),
        "times": torch.from_numpy(series.times),
        "data": torch.from_numpy(series.seen),
        "field": build_field(settings.network, states, truth.system.dynamics(states), settings.seed),
    }
    for term in load_user_terms(settings.terms, tuple(settings.terms), print).values():
        try:
            value = term.function(**{name: known[name] for name in term.takes})
        except Exception:  # the user's code may raise anything
            continue
        fault = value_fault(value)
        if fault is not None:
            yield f"{term.label}: {fault}"
