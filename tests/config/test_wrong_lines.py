"""Wrong command lines: each is answered in one line a mistake that names the fix, and leaves no folder behind."""

import functools
from pathlib import Path

import pytest

from eigenode_cli.cli import main
from eigenode_cli.commands import train
from eigenode_cli.config.composer import Composer

WRONG = [
    # choices
    ("train system=vpd", "system=vpd: unknown system 'vpd', did you mean vdp? choose from vdp, "),
    ("train protocol=papers", "protocol=papers: unknown protocol 'papers', did you mean paper? choose from paper"),
    ("train solver=rk5", "solver=rk5: unknown solver 'rk5', did you mean rk4? choose from rk4, "),
    ("train network.init=glorrot", "network.init=glorrot: unknown name 'glorrot', did you mean glorot? choose from gl"),
    ("train error.sol=rmse", "error.sol=rmse: unknown name 'rmse', did you mean mse? choose from mse, mae, huber"),
    ("train hydra/launcher=jobblib", "hydra/launcher=jobblib: unknown hydra/launcher 'jobblib', did you mean joblib?"),
    ("train +system=vdp", "+system=vdp: there is one chosen already; write system=vdp"),
    ("train ~solver", "~solver: every run needs one; choose solver=..."),
    ("train system=[vdp]", "system=[vdp]: unknown system '['vdp']'"),
    (
        "train engine=compiled solver=dopri8",
        "engine=compiled: it has no solver=dopri8 (it knows tsit5, dopri5, bosh3, ",
    ),
    (
        "train stages.0.horizons=[0.5,0.2]",
        "stages.0.horizons=[0.5,0.2]: must be growing fractions, for example [0.25,0.5,1",
    ),
    ("train stages.0.horizons=[0.5]", "stages.0.horizons=[0.5]: the last one must be 1, the whole horizon"),
    (
        "train stages.0.horizon=[1]",
        "stages.0.horizon=[1]: unknown setting 'stages.0.horizon', did you mean stages.0.horizons",
    ),
    ("train stages=[{horizon:[1]}]", "stages=[{horizon:[1]}]: "),
    ("train system.initial_known=[x]", "system.initial_known=[x]: unknown state 'x'; choose from nu, nu_dot"),
    ("train system.initial_known=[nu,nu]", "system.initial_known=[nu,nu]: state 'nu' is repeated; write it once"),
    ("train stages=[]", "stages=[]: nothing is trained; write at least stages=[{horizons:[1.0]}]"),
    ("train stages=[{spectra:here}]", "stages.0.spectra=here: unknown name 'here'; choose from trajectory, data"),
    ("train stages=[{trained:[linear]}]", "stages.0.trained=[linear]: there is no such block; this run has network"),
    ("train grads=sol stages=[{solve:false,steps:9},{}]", "stages.0.solve=false: sol has no term of the spectrum"),
    # keys
    ("train sede=3", "sede=3: unknown setting 'sede', did you mean seed? 'eigenode train --cfg job' lists all"),
    (
        "train optimizer.learning_rate=3",
        "optimizer.learning_rate=3: adam has no option 'learning_rate', did you mean optimizer.lr? (it has: ",
    ),
    ("train epochs=9", "epochs=9: unknown setting 'epochs', did you mean trainer.steps?"),
    ("train damping=1", "damping=1: unknown setting 'damping'; 'eigenode train --cfg job' lists all"),
    ("train lr=3", "lr=3: unknown setting 'lr', did you mean optimizer.lr?"),
    ("train trainer.step=9", "trainer.step=9: unknown setting 'trainer.step', did you mean trainer.steps?"),
    ("train solver=rk4 solver.rtol=1e-3", "solver.rtol=1e-3: rk4 has no option 'rtol' (it has: step)"),
    (
        "train optimizer=sgd optimizer.beta1=0",
        "optimizer.beta1=0: sgd has no option 'beta1' (it has: lr, momentum, clip)",
    ),
    ("train network.hiden=[8]", "network.hiden=[8]: mlp has no option 'hiden', did you mean network.hidden?"),
    ("train engine.sensitivity=forward", "engine.sensitivity=forward: auto has no option 'sensitivity' (it has: none)"),
    ("train combine=sum combine.repeat_last_update=true", "combine.repeat_last_update=true: sum has no option "),
    ("train +foo=1", "foo=1: nothing reads this setting;"),
    ("train +trainer.stepz=1", "trainer.stepz=1: nothing reads this setting, did you mean trainer.steps?"),
    ("train +seed=1", "+seed=1: the setting is there already; write seed=1"),
    ("train ~seed", "~seed: nothing can be taken away; write seed=..."),
    ("train hydra.job.nam=x", "hydra.job.nam=x: unknown setting 'hydra.job.nam', did you mean hydra.job.name?"),
    ("train protocol_system=paper-vdp", "protocol_system=paper-vdp: unknown setting 'protocol_system'"),
    ("train system.name=foo", "system.name=foo: follows from the choice; write system=..."),
    ("train system@foo=vdp", "system@foo=vdp: "),
    # terms of the user's own
    ("train +terms.calm=tests.terms.own:calm error.calm=mse", "error.calm=mse: a term of your own returns its error i"),
    ("train error.calm=mse +terms.calm=tests.terms.own:calm", "error.calm=mse: a term of your own returns its error i"),
    ("train +terms.calm=tests.terms.own:calm +error.calm=mse", "error.calm=mse: a term of your own returns its error "),
    (
        "train +terms.own=tests.terms.own:vector",
        "terms.own=tests.terms.own:vector: returns a tensor of shape (91,); it must return a scalar, for example with",
    ),
    ("train +terms.own=tests.terms.own:number", ":number: returns a float; it must return a torch tensor"),
    ("train +terms.own=tests.terms.own:array", ":array: returns a ndarray; it must return a torch tensor"),
    ("train +terms.own=tests.terms.own:nothing", ":nothing: returns None; it must return a torch tensor"),
    ("train +terms.own=tests.terms.own:whole", ":whole: returns int64; it must return a real floating-point number"),
    ("train +terms.own=tests.terms.own:complex_value", ":complex_value: returns complex128; it must return a real fl"),
    # types
    ("train seed=abc", "seed=abc: not a whole number"),
    ("train trainer.steps=1e3", "trainer.steps=1e3: not a whole number; write trainer.steps=1000"),
    ("train optimizer.lr=fast", "optimizer.lr=fast: not a number"),
    ("train network.hidden=32", "network.hidden=32: not a list; write network.hidden=[32]"),
    ("train network.hidden=[a]", "network.hidden=[a]: not a whole number"),
    ("train combine.repeat_last_update=7x", "combine.repeat_last_update=7x: not true or false"),
    ("train seed=null", "seed=null: must have a value"),
    ("train grads=[sol,frq]", "grads=[sol,frq]: terms are joined by +, for example grads=sol+frq"),
    # ranges
    ("train seed=-1", "seed=-1: must be at least 0"),
    ("train optimizer.lr=0", "optimizer.lr=0: must be above 0"),
    ("train optimizer.lr=nan", "optimizer.lr=nan: must be above 0"),
    ("train eigen.margin=inf", "eigen.margin=inf: must be a finite number"),
    ("train optimizer.beta1=1", "optimizer.beta1=1: must be at least 0 and below 1"),
    ("train trainer.steps=0", "trainer.steps=0: must be at least 1"),
    ("train system.points=1", "system.points=1: must be at least 2"),
    ("train network.hidden=[8,0]", "network.hidden=[8,0]: must be at least 1"),
    ("train system=oscillator system.m=0", "system.m=0: must be above 0"),
    ("train scale.sol=-1", "scale.sol=-1: must be at least 0"),
    # what must fit together
    ("train eigen.every=92", "eigen.every=92: must be at most system.points=91"),
    ("train network=polynomial eigen.jacobian=symbolic", "eigen.jacobian=symbolic: polynomial has no Jacobian in clos"),
    ("train target.stiffness=[5,2]", "target.stiffness=[5,2]: must be [low,high] with low at most high"),
    ("train target=stated grads=frq target.frequency=[1.0]", "target.damping=[]: needs one value for each of the 1"),
    (
        "train target=stated target.frequency=[1.0] target.damping=[1.0]",
        "target.damping=[1]: must be above -1 and belo",
    ),
    ("train target=stated grads=frq", "grads=frq: frq has nothing to meet; state target.frequency and target.damping"),
    (
        "train system=oscillator system.c=9 system.d=20 grads=frq+dmp",
        "grads=frq+dmp: no target has a pair: frq, dmp have no effect; the truth's eigenvalues are real at all data",
    ),
    ("train system=oscillator system.c=9 system.d=6 grads=sol+osc", "grads=sol+osc: no target has a pair: osc has no"),
    ("train system=oscillator system.c=25 system.d=10 grads=sol+frq", "grads=sol+frq: no target has a pair: frq has"),
    (
        "train system=oscillator system.c=2 system.d=2.8284271247461903 grads=sol stages=[{terms:frq,steps:5},{}]",
        "stages.0.terms=frq: no target has a pair: frq has no effect",
    ),
    (
        "train -m system=oscillator system.c=9 system.d=0.5,20 grads=sol,sol+frq",
        "grads=sol+frq: no target has a pair: frq has no effect",
    ),
    (
        "train system=oscillator system.c=0 grads=sol+stf",
        "grads=sol+stf: no target has a finite stiffness ratio: stf has no effect; state target.stiffness=[low,high]",
    ),
    (
        "train target=stated grads=frq target.frequency=[1.0] target.damping=[0.9999999999999999]",
        "target.frequency=[1.0] target.damping=[0.9999999999999999]: the pair of 1.0 Hz with damping",
    ),
    (
        "train target=stated grads=frq target.frequency=[[1.1,0.9]] target.damping=[0.1]",
        "target.frequency=[[1.1,0.9]]: the range [1.1,0.9] has its low end last",
    ),
    (
        "train target=stated grads=frq target.frequency=[1.0] target.damping=[[0.1,0.2,0.3]]",
        "target.damping=[[0.1,0.2,0.3]]: [0.1,0.2,0.3] is no number and no range [low,high]",
    ),
    (
        "train target=stated grads=frq target.frequency=[a] target.damping=[0.1]",
        "target.frequency=[a]: a is no number and no range [low,high]",
    ),
    (
        "train target=stated grads=frq target.frequency=[[-1.0,1.0]] target.damping=[0.1]",
        "target.frequency=[[-1,1]]: must be above 0",
    ),
    ("train solver=rk4 solver.step=40", "solver.step=40: longer than system.horizon=30 s"),
    (
        "train system=oscillator solver=rk4 solver.step=2",
        "solver.step=2: the target swings with 0.796 Hz, and a step must fit twice into its period; write at most",
    ),
    (
        "train target=stated target.frequency=[2] target.damping=[0.1] solver=rk4 solver.step=0.4",
        "solver.step=0.4: the target swings with 2 Hz, and a step must fit twice into its period",
    ),
    ("train target.at=rest", "target.at=rest: unknown name 'rest'; choose from trajectory, equilibrium"),
    (
        "train target.at=equilibrium stages.0.spectra=data grads=sol+frq",
        "stages.0.spectra=data: no effect, as target.at=equilibrium takes these terms there",
    ),
    (
        "train system=vdp target.at=equilibrium grads=sol+frq",
        "grads=sol+frq: no target has a pair: frq has no effect; the truth's eigenvalues are real at its equilibrium",
    ),
    ("train target=stated grads=stf", "grads=stf: stf has nothing to meet; state target.stiffness=[low,high]"),
    (
        "train trainer.pretrain=frq",
        "trainer.pretrain=frq: another setting says it now, for example 'stages=[{terms:frq",
    ),
    ("train eigen.at=data", "eigen.at=data: another setting says it now, for example stages.0.spectra=data"),
    (
        "train stages=[{terms:frq,steps:9},{}] trainer.steps=9",
        "trainer.steps=9: the stages take 9 of them, 1 more share the rest; give more steps",
    ),
    ("train stages=[{terms:frq,steps:9}]", "trainer.steps=5000: the stages take 9 of them; leave out the steps of one"),
    (
        "train stages=[{terms:frg,steps:9},{}]",
        "stages.0.terms=frg: unknown term 'frg', did you mean frq? choose from frq, ",
    ),
    (
        "train target=stated grads=sol stages=[{terms:frq,steps:9},{}]",
        "stages.0.terms=frq: frq has nothing to meet; state target.frequency and target.damping",
    ),
    ("train target.frequency_factor=0", "target.frequency_factor=0: must be above 0"),
    (
        "train grads=sol target=stated target.frequency_factor=2",
        "target.frequency_factor=2: stated has no option 'frequency_factor', did you mean target.frequency?",
    ),
    ("train system.noise=-1", "system.noise=-1: must be at least 0"),
    ("train system.observed=[x]", "system.observed=[x]: unknown state 'x'; choose from nu, nu_dot"),
    ("train system.observed=[]", "system.observed=[]: nothing is observed; choose from nu, nu_dot"),
    ("train system.initial_state=[1,2,3,4]", "system.initial_state=[1,2,3,4]: vdp has 2 states (nu, nu_dot)"),
    # terms
    ("train grads=sol+frg", "grads=sol+frg: unknown term 'frg', did you mean frq? choose from frq, "),
    ("train grads=sol+sol", "grads=sol+sol: term 'sol' is repeated; write it once"),
    ("train grads=", "grads=: an empty term; join terms with +, for example grads=sol+frq"),
    ("train grads=sol,frq", "grads=sol,frq: join terms with + (grads=sol+frq), or sweep over them with -m"),
    ("train grads=frq(10)+sol", "grads=frq(10)+sol: cannot be read ("),
    ("train scale.frg=10", "scale.frg=10: unknown term 'frg', did you mean frq? choose from frq, "),
    (
        "train scale.stf=3",
        "scale.stf: no effect, grads=sol+frq+dmp+osc does not have stf; add it or leave the scale out",
    ),
    ("train scale={stf:3}", "scale.stf: no effect, grads=sol+frq+dmp+osc does not have stf"),
    (
        "train error.huber_delta=2",
        "error.huber_delta: no effect, no error function is huber; choose one with error.TERM",
    ),
    ("train grads=sol eigen.max_condition=9", "eigen.max_condition: no effect, grads=sol has no term of the spectrum"),
    ("train +terms.mine=os.path:nope", "terms.mine=os.path:nope: module os.path has no such function;"),
    ("train +terms.mine=nomodule:f", "terms.mine=nomodule:f: cannot import nomodule (ModuleNotFoundError"),
    (
        "train +terms.mine=os.path:dirname",
        "terms.mine=os.path:dirname: dirname of os.path: unknown argument 'p'; choose from ",
    ),
    ("train +terms.mine=f", "terms.mine=f: not of the form module:function"),
    ("train +terms.sol=os.path:join", "terms.sol=os.path:join: sol is one of the six terms; choose another name"),
    # Hydra's own
    ("train seed", "seed: not of the form KEY=VALUE"),
    (
        "train system=vdp,oscillator",
        "system=vdp,oscillator: one value here, for example system=vdp; or sweep over them",
    ),
    ("train seed=range(3)", "seed=range(3): a sweep needs -m"),
    ("train seed=${foo}", "seed=${foo}: Interpolation key 'foo' not found"),
    ("train --config-dir nope", "--config-dir nope: no such folder"),
    ("train --config-name nope", "Cannot find primary config 'nope'."),
    ("train --config-path nope", "--config-path nope: would hide the shipped configs; add yours with --config-dir"),
    ("train hydra.searchpath=[nope]", "path=nope is not available."),
    ("train --foo", "train: unrecognized arguments: --foo; 'eigenode train --hydra-help' lists the flags"),
    ("train -m --cfg job", "train: only one of --run, --multirun, --cfg, --info and --shell-completion goes at a time"),
    ("train --resolve", "train: --resolve goes with --cfg"),
    ("train --cfg job sede=3", "sede=3: unknown setting 'sede', did you mean seed?"),
    ("train --cfg job -p scales", ""),
    # sweeps
    ("train -m seed=range(0)", "seed=range(0): an empty sweep, no run would start;"),
    ("train -m seed=1,1", "seed=1: the sweep has this run twice; name each value once"),
    ("train -m grads=sol+frq,frq+sol", "grads=sol+frq: the sweep has this run twice; name each value once"),
    ("train -m grads=sol,sol+foo", "grads=sol+foo: unknown term 'foo'; choose from "),
    ("train -m seed=0,-1", "seed=-1: must be at least 0"),
    (
        "train -m optimizer.lr=interval(0,1)",
        "optimizer.lr=interval(0,1): no finite list of values; write choice(...) or",
    ),
    ("train -m hydra.job.name=a,b", "hydra.job.name=a,b: settings of Hydra cannot be swept; give one value"),
    ("train -m grads=sol,sol+frq scale.stf=3", "scale.stf: no effect, "),
    ("train hydra.mode=MULTIRUN system=vdp,vpd", "system=vpd: unknown system 'vpd', did you mean vdp?"),
    # other commands
    ("import", "unknown command 'import'; choose from "),
    ("trian", "unknown command 'trian', did you mean train? choose from train, "),
    ("system=vdp", "system=vdp: a setting without a command; write eigenode train system=vdp"),
    ("list solvers", "list solvers: unknown group 'solvers', did you mean solver? choose from solver, "),
    ("plot nowhere", "nowhere: no such folder"),
    ("plot", "plot: the following arguments are required: RUN"),
]


shared_composer = functools.cache(Composer)
"""One for each place that configs come from: what is composed once need not be composed for every line."""


@pytest.fixture(autouse=True)
def _share_compositions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "Composer", shared_composer)


@pytest.mark.parametrize(("line", "answer"), WRONG, ids=[line for line, _ in WRONG])
def test_one_line_that_names_the_fix(
    line: str, answer: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line.split(" ")) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    if answer:
        assert err.startswith("eigenode: error: ")
        assert answer in err
    assert list(tmp_path.iterdir()) == []


def test_all_mistakes_of_a_command_at_once(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "system=vpd solver=rk4 solver.rtol=1 sede=3 seed=x trainer.steps=0 eigen.every=999 grads=sol+foo scale.frg=1"
    )
    assert main(["train", *words.split()]) == 2
    lines = capsys.readouterr().err.splitlines()
    beginnings = ["system=vpd", "solver.rtol=1", "sede=3", "seed=x", "trainer.steps=0", "grads=sol+foo", "scale.frg=1"]
    assert [line.split(":")[2].strip() for line in lines] == [*beginnings, "eigen.every=999"]


def test_mistakes_of_all_runs_of_a_sweep_at_once(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "-m", "grads=sol,sol+foo", "system=vdp,vpd", "optimizer.lr=0,1e-3", "seed=range(2)"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert sorted(line.split(":")[2].strip() for line in lines) == ["grads=sol+foo", "optimizer.lr=0", "system=vpd"]
    assert list(tmp_path.iterdir()) == []
