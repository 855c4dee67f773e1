"""Options of the command line that hold what a user knows."""

import argparse
import inspect

import pytest

from sksurrogate._command_options import add_knowledge, knowledge_of
from sksurrogate._in_options import OPTION_OF
from sksurrogate.blind import run_blind_check
from sksurrogate.cli import main
from sksurrogate.exceptions import DataError
from sksurrogate.gap import GapDiagnoser

PLANT = """
from sksurrogate.physics import ODESimulator
def rhs(t, x, u, p):
    return [u[0] - p["k"] * x[0]]
plant = ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0}, dt=0.1)
"""


def parsed(options):
    parser = argparse.ArgumentParser()
    add_knowledge(parser)
    return parser.parse_args(options)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--bounds", "k=0.1:2", "c=:3"], {"bounds": {"k": (0.1, 2.0), "c": (None, 3.0)}}),
        (["--time-limit", "60"], {"time_limit": 60.0}),
        (["--clock-offset", "0.5"], {"clock_offset": 0.5}),
        (["--prior", "k=0.05", "c=-1:0.2"], {"priors": {"k": 0.05, "c": (-1.0, 0.2)}}),
        (
            ["--exclude", "drift", "friction@speed", "@level"],
            {"exclude": ["drift", ("friction", "speed"), (None, "level")]},
        ),
        (["--exclude", "drift", "--exclude", "@level"], {"exclude": ["drift", (None, "level")]}),
        (["--bounds", "k=0.1:2", "--bounds", "c=:3"], {"bounds": {"k": (0.1, 2.0), "c": (None, 3.0)}}),
        (["--plausible", "*friction@joint", "valve"], {"plausible": [("*friction", "joint"), "valve"]}),
    ],
)
def test_what_is_known_is_read_from_the_command_line(options, expected):
    found = knowledge_of(parsed(options))
    assert knowledge_of(parsed([])) != found  # nothing is kept from one call to the next
    assert found == {
        "time_limit": None,
        "clock_offset": 0.0,
        "exclude": (),
        "plausible": None,
        "bounds": None,
        "priors": None,
        **expected,
    }


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--bounds", "k"], "--bounds k: expected NAME=LOW:HIGH"),
        (["--bounds", "k=1"], "--bounds k=1: expected NAME=LOW:HIGH, two numbers"),
        (["--bounds", "k=a:b"], "--bounds k=a:b"),
        (["--prior", "k=a"], r"--prior k=a: expected NAME=SD .relative, as 0.05. or NAME=MEAN:SD"),
        (["--clock-offset", "-3"], "--clock-offset -3: expected a time from 0 on"),
        (["--time-limit", "-3"], "--time-limit -3: expected a number of seconds above 0"),
        (["--exclude", "a@b@c@d"], "--exclude a@b@c@d: expected effect, place"),
        (["--plausible", "a@b@c@d"], "--plausible a@b@c@d: expected effect, place"),
    ],
)
def test_a_mistaken_option_is_named(options, message):
    with pytest.raises(DataError, match=message):
        knowledge_of(parsed(options))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--time-limt", "5"], "unknown option --time-limt; did you mean --time-limit?"),
        (["--n_jobs=2"], "unknown option --n_jobs; did you mean --jobs?"),
        (["--xyzzy"], "unknown option --xyzzy"),
        (["--jobs", "two"], "argument --jobs: invalid int value: 'two'"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_a_mistyped_option_is_told_in_one_line_with_the_nearest_one(words, said, first, capsys):
    names = ["plant.py:plant", "data.csv"]
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", *(words if first else names), *(names if first else words)])
    assert ended.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        f"sksurrogate: {said}",
        "sksurrogate diagnose --help lists all options.",
    ]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["diagnose", "plant.py:plant"], "required: data"),
        (["diagnose", "--quite", "plant.py:plant"], "did you mean --quiet?"),
        (["diagnose", "plant.py:plant", "data.csv", "more.csv"], "'more.csv' belongs to no option"),
        (["--verison"], "unknown option --verison; did you mean --version?"),
        (["blind", "--case-count", "3"], "unknown option --case-count; did you mean --cases?"),
    ],
)
def test_words_that_do_not_fit_are_told_without_the_usage(words, said, capsys):
    with pytest.raises(SystemExit):
        main(words)
    err = capsys.readouterr().err
    assert said in err and "usage:" not in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--free", "q"], "--free: the simulator has no parameter 'q'; it has ['k']."),
        (["--free", "k", "k"], "--free k k: 'k' is listed twice; list each parameter once."),
        (["--bounds", "q=0:1"], "--bounds names 'q', which is not a parameter of the simulator"),
        (["--bounds", "k=2:1"], "--bounds k=2:1: expected NAME=LOW:HIGH with LOW below HIGH; an empty side is open."),
        (["--bounds", "k=-2:-1"], "--bounds k=-2:-1 holds no value of the sign of the simulator's k=1"),
        (["--prior", "k=-1"], "--prior k=-1: expected a relative standard deviation above 0, for instance 0.05, or "
         "MEAN:SD in the unit of k, for instance 1:0.05."),
        (["--effects", "drag"], "--effects: 'drag' is not in the catalogue; did you mean 'quadratic_drag'"),
        (["--exclude", "bias@here"], "--exclude bias@here: 'bias' is not an effect (did you mean"),
        (["--exclude", "drift", "*"], "--exclude drift * leaves none of the "),
        (["--plausible", "nowhere"], "effect@place or effect@place@variable, or places of the simulator, for example "
         "--plausible drift *friction@speed level."),
    ],
)  # fmt: skip
def test_errors_of_a_diagnosis_name_the_option_as_it_was_typed(options, said, tmp_path, capsys):
    (tmp_path / "plant.py").write_text(PLANT)
    (tmp_path / "data.csv").write_text("\n".join(["flow,level", *(f"{k % 3},{k % 2}" for k in range(20))]))
    assert main(["diagnose", f"{tmp_path / 'plant.py'}:plant", str(tmp_path / "data.csv"), "--quiet", *options]) == 2
    err = capsys.readouterr().err
    assert said in err and not any(f"{name}=" in err for name in OPTION_OF)


def test_every_parameter_that_is_said_as_an_option_has_one(capsys):
    known = inspect.signature(GapDiagnoser).parameters.keys() | inspect.signature(run_blind_check).parameters.keys()
    assert known >= OPTION_OF.keys()
    shown = ""
    for command in ("diagnose", "blind"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        shown += capsys.readouterr().out
    assert all(option in shown for option in OPTION_OF.values())
