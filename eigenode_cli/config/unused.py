"""Options that the user typed and the run would not read.

All six terms are recorded whatever `grads` is, so what shapes a recorded value (error functions, margin, targets) is
always read; what only shapes a gradient is not.
"""

from collections.abc import Sequence

from omegaconf import DictConfig

from eigenode_cli.config.names import training_terms
from eigenode_cli.terms import SPECTRAL, TERMS

SPECTRAL_ONLY = ("eigen.max_condition",)
"""Keys that only the gradients of spectral terms depend on."""


def useless_options(config: DictConfig, typed: Sequence[str]) -> dict[str, str]:
    """Return a fault for each of the typed keys that nothing reads in this (valid) configuration."""
    found = {}
    for key in typed:
        reason = _reason(config, key)
        if reason:
            found[key] = f"{key}: no effect, {reason}"
    return found


def _reason(config: DictConfig, key: str) -> str | None:
    """Why nothing reads a key, or None."""
    words = list(training_terms(config))
    group, _, name = key.rpartition(".")
    reasons = (
        (
            group == "scale" and name not in words,
            f"grads={config.grads} does not have {name}; add it or leave the scale out",
        ),
        (
            key == "error.huber_delta" and "huber" not in config.error.values(),
            "no error function is huber; choose one with error.TERM=huber",
        ),
        (
            key in ("schedule.rate", "schedule.every") and config.schedule.get("extra") == 0.0,
            "the learning rate is constant; schedule.extra=... lets it decay",
        ),
        (
            key == "stp.method" and config.stp.step is None,
            "no step is stated; write stp.step=... in s",
        ),
        (
            key == "optimizer.evidence_ridge" and not config.optimizer.evidence,
            "the ridge does not follow the evidence; write optimizer.evidence=true",
        ),
        (
            key == "network.scaling_from"
            and "max_abs" not in (config.network.get("input_scaling"), config.network.get("output_scaling")),
            "nothing is scaled; choose network.input_scaling=max_abs or network.output_scaling=max_abs",
        ),
        (
            key == "eigen.eigenvalue_count" and not any(word in TERMS and TERMS[word].per_eigenvalue for word in words),
            f"grads={config.grads} has no term that averages over eigenvalues",
        ),
        (
            key in SPECTRAL_ONLY and not set(words).intersection({*SPECTRAL, *config.terms}),
            "grads=sol has no term of the spectrum",
        ),
    )
    return next((reason for applies, reason in reasons if applies), None)
