"""Stated probabilities: the shares of names that acted, among those that the evidence was certain of."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from sksurrogate.gap.decide import _calibration
from sksurrogate.gap.decide._calibration import calibrated, with_stated
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._remainder import NOTHING_KNOWN, Remainder

#: The script that fits the log odds to the stored names.
SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "_scripts" / "calibration.py"))


def test_the_log_odds_are_those_of_the_stored_names():
    own = _calibration.LOG_ODDS, _calibration.PER_REST, _calibration.PER_SMALLNESS
    assert SCRIPT["fitted"]() == pytest.approx(own, abs=0.06)


def test_stated_shares_are_true_shares_over_the_stored_names():
    ratios, acts, _, _ = SCRIPT["read"]()
    stated = np.array([calibrated(1.0, 0.1 * rest, (0.1 / small) ** 2, 0.1) for rest, small in ratios])
    assert np.mean(stated) == pytest.approx(np.mean(acts), abs=0.02)
    doubtful = stated < 0.9
    assert np.mean(stated[doubtful]) == pytest.approx(np.mean(acts[doubtful]), abs=0.1)


def test_rest_and_small_shares_make_a_name_doubtful_and_units_do_not_matter():
    rests = [calibrated(1.0, rest, 1.0, 0.1) for rest in (0.0, 0.05, 0.1, 0.2)]
    shares = [calibrated(1.0, 0.0, share, 0.1) for share in (1.0, 0.1, 0.01, 0.001)]
    assert rests == sorted(rests, reverse=True) and shares == sorted(shares, reverse=True)
    assert calibrated(1.0, 0.03, 0.04, 0.1) == pytest.approx(calibrated(1.0, 0.06, 0.16, 0.2))
    assert calibrated(0.5, 0.03, 0.04, 0.1) == pytest.approx(0.5 * calibrated(1.0, 0.03, 0.04, 0.1))
    assert calibrated(1.0, 0.0, 0.0, 0.1) > 0.1  # a share that left-out runs do not show is no proof


def test_what_is_not_known_yet_takes_nothing():
    effect = EffectEstimate("sensor_bias", "y", None, np.nan, {"value": 0.5}, {"value": (0.4, 0.6)}, 0.8)
    (first,) = with_stated([effect], NOTHING_KNOWN, 0.1)
    (second,) = with_stated([effect], Remainder(lawful=0.1), 0.1)
    assert first.probability == pytest.approx(0.8 * calibrated(1.0, 0.0, 1.0, 0.1))
    assert second.probability < first.probability
    (unknown,) = with_stated([EffectEstimate("drift", "x", None, 1.0, {}, {}, np.nan)], NOTHING_KNOWN, 0.1)
    assert np.isnan(unknown.probability)
