"""The user's own terms evaluated once before a run: on the truth's trajectory and spectra, with the initial network."""

from collections.abc import Iterator

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.config.build import build_field, build_source, build_target
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data.reconstruct import reconstruct
from eigenode_cli.data.targets import TruthTarget
from eigenode_cli.terms.user import load_user_terms, value_fault


def rehearse(config: DictConfig) -> Iterator[str]:
    """Yield a fault for each own term of a configuration, valid otherwise, whose value is none.

    A term that raises is left to the run, which keeps its traceback: it may need what only a training gives it.
    """
    settings = TrainConfig(**vars(OmegaConf.to_object(config)))
    try:
        source = build_source(settings)
    except ValueError:  # the run says so
        return
    series, truth = source.dataset.series[0], source.truth
    if truth is None:
        found = reconstruct(series, settings.network.structure)
        states, rates = np.nan_to_num(found.states), np.nan_to_num(found.rates)
        spectra = np.resize(build_target(settings.target, source).spectra(series.times), states.shape)
    else:
        states = truth.states(series.times)
        spectra, rates = TruthTarget(truth).spectra(series.times), truth.system.dynamics(states)
    known = {
        "trajectory": torch.from_numpy(states).requires_grad_(),
        "spectra": torch.from_numpy(spectra[:: settings.eigen.every]).requires_grad_(),
        "times": torch.from_numpy(series.times),
        "data": torch.from_numpy(series.seen),
        "field": build_field(settings.network, states, rates, settings.seed, inputs=series.driven),
    }
    for term in load_user_terms(settings.terms, tuple(settings.terms), print).values():
        try:
            value = term.function(**{name: known[name] for name in term.takes})
        except Exception:  # the user's code may raise anything
            continue
        fault = value_fault(value)
        if fault is not None:
            yield f"{term.label}: {fault}"
