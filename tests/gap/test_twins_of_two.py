"""Two names that both have exact twins: what stands holds one of each pair, and both classes are kept."""

from sksurrogate.blind import draw
from sksurrogate.gap import GapDiagnoser

#: A circuit of which only the current is read: a bias of its sensor is a ramp of its balance, a wrong resistance a loss.
SEED = 6824764789708391347
LIBRARY = ["linear_loss", "parameter_error", "sensor_bias", "drift", "sensor_drift"]


def test_twins_stand_beside_one_another():
    question = draw("two", SEED).question
    report = (
        GapDiagnoser(question.simulator, effects=LIBRARY, n_jobs=1, random_state=0)
        .fit(question.X, question.y, groups=question.groups)
        .report_
    )
    classes = [{effect.name, *(one[0] for one in effect.equivalents)} for effect in report.effects]
    assert report.verdict == "explained" and classes == [{"parameter_error", "linear_loss"}, {"drift", "sensor_bias"}]
