"""Options of the command line that hold what a user knows."""

import argparse

import pytest

from sksurrogate._command_options import add_knowledge, knowledge_of
from sksurrogate.cli import main
from sksurrogate.exceptions import DataError


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
        "exclude": [],
        "plausible": None,
        "bounds": {},
        "priors": {},
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
