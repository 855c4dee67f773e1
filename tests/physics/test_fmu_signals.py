"""What a unit's description says, read without a unit."""

from types import SimpleNamespace as Made

import pytest

from sksurrogate.physics._fmu_events import EventSteps
from sksurrogate.physics._fmu_signals import Unfit, read_signals
from sksurrogate.physics._fmu_steps import CoSteps


def variable(name, reference, **other):
    made = {"name": name, "valueReference": reference, "type": "Float64", "shape": None, "start": None}
    return Made(**(made | {"variability": "continuous"} | other))


def unit(states=("x", "v"), version="3.0", indicators=0, **changed):
    known = {n: variable(n, 10 + k) for k, n in enumerate(["x", "v", "u", "y", "k"])}
    known |= {n: variable(n, 20, **how) for n, how in changed.items()}
    derivatives = [Made(variable=Made(derivative=known[n])) for n in states]
    exchange = Made(needsCompletedIntegratorStep=True)
    return Made(
        fmiVersion=version, modelVariables=list(known.values()), derivatives=derivatives, modelExchange=exchange,
        numberOfEventIndicators=indicators,
    )  # fmt: skip


def read(made, kind="ModelExchange", **other):
    return read_signals(made, kind, **({"inputs": ["u"], "outputs": ["y"], "params": ["k"], "initial": None} | other))


def test_references_places_and_flags():
    found = read(unit(), initial=["v", "x"])
    assert found.version == 3 and found.states == ("v", "x") and found.order.tolist() == [1, 0]
    assert [list(v) for v in (found.inputs, found.outputs, found.params, found.state_references)] == [
        [12],
        [13],
        [14],
        [11, 10],
    ]
    assert (
        found.start_inputs.tolist() == [0.0] and found.n_indicators == 0 and not found.events and found.completes_steps
    )
    assert not read(unit(), kind="CoSimulation").completes_steps
    assert read(unit(version="2.0")).version == 2 and read(unit(indicators=3)).n_indicators == 3
    assert read(unit(indicators=1)).events and read(unit(u={"variability": "discrete"})).events
    assert read(unit(u={"start": "1.5"})).start_inputs.tolist() == [1.5]


def test_states_that_the_unit_does_not_name_are_named_by_the_user_or_not_at_all():
    assert read(unit(states=()), kind="CoSimulation", initial=["v"]).states == ("v",)
    with pytest.raises(Unfit, match="no continuous states; name in initial="):
        read(unit(states=()), kind="CoSimulation")
    for initial in (None, ["v"]):
        with pytest.raises(Unfit, match=r"no continuous states$"):
            read(unit(states=()), initial=initial)
    with pytest.raises(Unfit, match=r"initial=\['x'\] are not its continuous states \['x', 'v'\]"):
        read(unit(), initial=["x"])


@pytest.mark.parametrize("how", [{"type": "Boolean"}, {"shape": (2,)}])
@pytest.mark.parametrize("name", ["u", "y", "k", "x"])
def test_a_signal_that_is_no_real_scalar(name, how):
    with pytest.raises(Unfit, match=f"variable '{name}' is .* not a real scalar"):
        read(unit(**{name: how}))


def test_another_version_of_the_standard():
    with pytest.raises(Unfit, match=r"FMI 1\.0 shows no equations here"):
        read(unit(version="1.0"))


@pytest.mark.parametrize(("version", "name"), [(2, "freeFMUstate"), (3, "freeFMUState")])
def test_a_copy_of_a_unit_is_freed_by_the_name_of_its_standard(version, name):
    done = []
    instance = Made(**{name: done.append, "freeInstance": lambda: done.append("instance")})
    steps = Made(_state="copy", instance=instance, signals=Made(version=version))
    CoSteps.close(steps)
    assert done == ["copy", "instance"] and steps._state is None


@pytest.mark.parametrize(("version", "ending"), [(2, "FMUstate"), (3, "FMUState")])
def test_the_copy_of_a_start_is_taken_put_back_and_freed_by_the_names_of_its_standard(version, ending):
    done = []

    def call(what):
        return lambda *given: done.append((what, *given)) or "copy"

    signals = Made(version=version, states=(), n_indicators=0)
    exchange = Made(modelExchange=Made(canGetAndSetFMUstate=True))
    instance = Made(**{what + ending: call(what) for what in ("get", "set", "free")})
    steps = EventSteps(
        Made(instance=instance, signals=signals, description=exchange, begin=lambda *given: None, close=call("close"))
    )
    for values in ((1.0,), (1.0,), (2.0,)):
        steps._begin(values, (), 0.0)
    steps.close()
    assert done == [("get",), ("set", "copy"), ("free", "copy"), ("get",), ("free", "copy"), ("close",)]
