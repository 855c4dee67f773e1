"""Linear algebra that breaks in one place or one stage costs that place or stage, and says so, never the diagnosis."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap import _pipeline as pipeline
from sksurrogate.gap.fit._unstable import largest_growth, piece_starts
from sksurrogate.gap.unnamed._ode_channels import OdeChannels
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import smooth
from sksurrogate.physics import ODESimulator


def growth(x):
    """Monod growth on a substrate; beyond a substrate of -0.5 its slope has no bound."""
    return x[0] * x[1] / (0.5 + x[1])


def chemostat(with_growth):
    return ODESimulator(
        lambda t, x, u, p: [with_growth * growth(x) - 0.3 * x[0], 0.3 * (5 - x[1]) - 2 * growth(x)],
        states=["cells", "substrate"], inputs=[], outputs=["cells", "substrate"], params={}, dt=0.1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def data():
    """Runs of the chemostat whose growth the simulator lacks."""
    rng = np.random.default_rng(1)
    starts = rng.uniform((0.2, 0.2), (3.0, 4.0), (3, 2))
    runs = chemostat(1.0).simulate_batch(np.zeros((3, 60, 0)), starts)
    runs = runs + 0.01 * runs.std(axis=(0, 1)) * rng.normal(size=runs.shape)
    return runs.reshape(-1, 2), np.repeat(np.arange(3), 60)


def diagnosed(data):
    y, groups = data
    diagnoser = GapDiagnoser(chemostat(0.0), effects=["sensor_quantization"], n_jobs=1, random_state=0)
    return diagnoser.fit(np.zeros((len(y), 0)), y, groups=groups).report_


def test_a_smoother_does_not_leave_the_data_over_a_pole():
    """Full Gauss-Newton steps from a wrong free run cross the pole of the growth and end at a path that no noise follows."""
    rng = np.random.default_rng(1)
    truth = np.concatenate(
        [chemostat(1.0).simulate(np.zeros((200, 0)), x0=x0).T for x0 in rng.uniform((0.2, 0.2), (3.0, 4.0), (6, 2))],
        axis=1,
    )
    scale, sd = truth.std(axis=1), 0.01 * truth.std(axis=1)
    y = truth + sd[:, None] * rng.normal(size=truth.shape)
    starts = 200 * np.arange(6)

    class Bound:
        """Steps of explicit Euler of the simulator without growth."""

        def __call__(self, x):
            return x + 0.1 * np.stack([-0.3 * x[0], 0.3 * (5 - x[1]) - 2 * growth(x)])

        def outputs(self, x):
            return x

    start = np.empty_like(y)
    for a in starts:
        start[:, a] = y[:, a]
        for k in range(a, a + 199):
            start[:, k + 1] = Bound()(start[:, k])
    found = smooth(Bound(), y, starts, sd, start, scale, rigid=np.array([False, True]))
    assert np.sqrt(np.mean(((found.x - y) / scale[:, None]) ** 2)) < np.sqrt(
        np.mean(((start - y) / scale[:, None]) ** 2)
    )
    assert found.x[1].min() > -0.5  # on this side of the pole
    assert np.isfinite(found.A).all()


@pytest.mark.slow
def test_a_place_that_cannot_be_followed_is_lost_with_a_note(data, monkeypatch):
    def broken(null, location, kind):
        raise np.linalg.LinAlgError("the posterior precision is not positive definite")

    monkeypatch.setattr(OdeChannels, "made", broken)
    report = diagnosed(data)
    assert report.verdict == "unknown" and report.missing_term.curves == () and report.missing_term.law is None
    assert any(note.startswith("No missing term could be looked for at") for note in report.notes)


@pytest.mark.slow
def test_a_stage_that_breaks_is_left_out_with_a_note(data, monkeypatch):
    def broken(self):
        raise np.linalg.LinAlgError("the matrix is singular")

    stages = tuple(
        pipeline.Stage(s.name, broken, s.summary, s.share, s.until) if s.name == "law" else s for s in pipeline.STAGES
    )
    monkeypatch.setattr(pipeline, "STAGES", stages)
    report = diagnosed(data)
    assert report.verdict == "unknown" and report.complete
    assert any("law (the matrix is singular)" in note for note in report.notes)


def test_pieces_are_as_long_as_noise_and_growth_allow():
    """A state that grows by a tenth in every sample: pieces of the limit over log 1.1 samples, longer where the noise is smaller."""
    n = 400
    A = np.full((1, 1, n), 1.1)
    record = Record(np.zeros((0, n)), np.zeros((1, n)), np.arange(n) * 1.0, np.array([0]), 1.0)
    for noise in (0.05, 0.01, 0.001):
        limit = largest_growth(np.array([noise]), np.array([1.0]))
        pieces = np.diff(piece_starts(A, np.ones(1), record.starts, limit))
        assert np.all(pieces == max(int(np.floor(limit / np.log(1.1))) + 1, 20))
