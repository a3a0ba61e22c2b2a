"""The typed schema of every setting. No defaults stand here: they are in `configs/`, where people look for them.

Each choice of a group has a class of its own with exactly the options that it reads, so that an option which the
chosen method would ignore is an unknown key. Importing this module costs nothing: no torch, no Numba.
"""

from dataclasses import dataclass

from omegaconf import MISSING


@dataclass
class SystemConfig:
    """Ground truth and how it is observed; each system adds its own parameters, with units, in a subclass."""

    name: str = MISSING
    """Registered system (see `eigenode_cli.systems`)."""
    initial_state: list[float] = MISSING
    """State at time 0, one value a state."""
    horizon: float = MISSING
    """Time of the last data point in s."""
    points: int = MISSING
    """Number of equidistant data times, both ends included."""
    observed: list[str] = MISSING
    """Names of the states that the data shows and SOL compares."""


@dataclass
class OscillatorConfig(SystemConfig):
    """Translational spring-damper oscillator (Equ. linsys)."""

    c: float = MISSING
    """Spring constant in N/m."""
    d: float = MISSING
    """Damping constant in N s/m."""
    m: float = MISSING
    """Mass in kg."""


@dataclass
class VanDerPolConfig(SystemConfig):
    """Van der Pol oscillator (Equ. nonlinsys)."""

    mu: float = MISSING
    """Strength of the nonlinear damping, without unit."""


@dataclass
class NetworkConfig:
    """The learned part of the vector field."""

    name: str = MISSING
    structure: str = MISSING
    """How the network's output becomes dx/dt: second_order | full."""


@dataclass
class MlpConfig(NetworkConfig):
    """Multilayer perceptron."""

    hidden: list[int] = MISSING
    """Width of each hidden layer."""
    activation: str = MISSING
    """Activation of the hidden layers; the output layer is linear."""
    init: str = MISSING
    """Initial weights: glorot | uniform01 | kaiming."""
    input_scaling: str = MISSING
    """none | max_abs: divide each state by its largest modulus in the data."""
    output_scaling: str = MISSING
    """none | max_abs: multiply each output by the largest modulus of that derivative in the data."""


@dataclass
class PolynomialConfig(NetworkConfig):
    """All monomials of the states up to a degree, with learned coefficients."""

    degree: int = MISSING
    spread: float = MISSING
    """Initial coefficients are uniform in [-spread, spread]."""


@dataclass
class SolverConfig:
    """Integrator of the vector field."""

    name: str = MISSING


@dataclass
class AdaptiveSolverConfig(SolverConfig):
    """Embedded Runge-Kutta method with step-size control."""

    rtol: float = MISSING
    atol: float = MISSING
    max_steps: int = MISSING
    """Attempted steps after which a solve ends with the status max_steps."""


@dataclass
class FixedSolverConfig(SolverConfig):
    """Method with a fixed step."""

    step: float = MISSING
    """Step size in s."""


@dataclass
class OptimizerConfig:
    """Turns updates into new parameters."""

    name: str = MISSING
    lr: float = MISSING
    """Learning rate."""


@dataclass
class AdamConfig(OptimizerConfig):
    """Adam (Kingma & Ba 2015)."""

    beta1: float = MISSING
    beta2: float = MISSING
    eps: float = MISSING


@dataclass
class SgdConfig(OptimizerConfig):
    """Gradient descent with momentum."""

    momentum: float = MISSING


@dataclass
class CombineConfig:
    """How several gradients become optimizer steps."""

    name: str = MISSING


@dataclass
class EngineConfig:
    """What computes the loss Jacobian."""

    name: str = MISSING


@dataclass
class TargetConfig:
    """What the spectral terms compare the spectrum with."""

    name: str = MISSING
    stiffness: list[float] | None = None
    """Corridor [low, high] of the stiffness ratio in place of the target's own; [1, 1] for a fast simulation."""


@dataclass
class StatedTargetConfig(TargetConfig):
    """Targets stated by the user, the same at all times."""

    frequency: list[float] = MISSING
    """Frequency |Im|/2 pi of each pair in Hz (the damped one)."""
    damping: list[float] = MISSING
    """Damping ratio of each pair, in the same order."""


@dataclass
class TrainerConfig:
    """Length of the training and what is written."""

    steps: int = MISSING
    record_every: int = MISSING
    """Steps between rows of metrics.csv."""
    checkpoint_every: int = MISSING
    """Steps between checkpoints."""
    on_unsolvable: str = MISSING
    """What to do when a solve fails: stabilise | skip | stop."""


@dataclass
class EigenConfig:
    """Spectra along the trajectory."""

    every: int = MISSING
    """A spectrum at every k-th data time."""
    jacobian: str = MISSING
    """How A = df/dx is computed: autodiff | finite_difference | symbolic."""
    max_condition: float = MISSING
    """Guard: largest eigenvalue condition number that a sensitivity may show."""
    margin: float = MISSING
    """Stability margin of STB in 1/s."""


@dataclass
class ErrorConfig:
    """Error function of each term: mae | mse | huber."""

    sol: str = MISSING
    frq: str = MISSING
    dmp: str = MISSING
    stb: str = MISSING
    osc: str = MISSING
    stf: str = MISSING
    huber_delta: float = MISSING
    """Difference at which huber turns from a square to a line."""


@dataclass
class TrainConfig:
    """Everything that one run depends on."""

    system: SystemConfig = MISSING
    network: NetworkConfig = MISSING
    solver: SolverConfig = MISSING
    optimizer: OptimizerConfig = MISSING
    combine: CombineConfig = MISSING
    engine: EngineConfig = MISSING
    target: TargetConfig = MISSING
    trainer: TrainerConfig = MISSING
    eigen: EigenConfig = MISSING
    error: ErrorConfig = MISSING
    protocol: str = MISSING
    grads: str = MISSING
    """Terms whose gradients train, joined by +."""
    scale: dict[str, float] = MISSING
    """Factor of each term's gradient."""
    terms: dict[str, str] = MISSING
    """The user's own terms: name to `module:function`."""
    seed: int = MISSING


CHOICES: dict[str, dict[str, type]] = {
    "system": {"oscillator": OscillatorConfig, "vdp": VanDerPolConfig},
    "network": {"mlp": MlpConfig, "polynomial": PolynomialConfig},
    "solver": {"adaptive": AdaptiveSolverConfig, "fixed": FixedSolverConfig},
    "optimizer": {"adam": AdamConfig, "sgd": SgdConfig},
    "combine": {"combine": CombineConfig},
    "engine": {"engine": EngineConfig},
    "target": {"truth": TargetConfig, "stated": StatedTargetConfig},
}
"""Schema of each group's choices, registered with Hydra as `schema/<group>/<name>`."""
