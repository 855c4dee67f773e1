"""The demo's second story: a linear model of a nonlinear reactor lacks one law, and no stack of names."""

from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser


def test_the_linear_reactor_lacks_a_law_and_no_stack_of_names():
    """Four names close 93 % of the gap; one formula in the balance closes all of it."""
    X, y, groups = make_reactor_runs(10, 200, noise=0.02, random_state=0)
    report = GapDiagnoser(linear_reactor(), random_state=0).fit(X, y, groups=groups).report_
    law = report.certified_law
    assert report.verdict == "unknown" and not report.effects
    assert law is not None and (law.location, law.kind) == ("y", "state")
    assert report.shrink.fraction_law > 0.99
