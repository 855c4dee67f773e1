"""The rule of the verdict on two recorded sets of facts: the demo's second story, and the cascaded tanks."""

from sksurrogate.gap._verdict import Facts, decide


def test_a_stack_of_names_with_a_clear_law_left_is_unknown_and_a_useful_one_is_not():
    both = {"accepted": True, "exhausted": True}
    story = Facts(**both, share_left=0.073, left=38.0, law=0.56, force=0.094, retuned=False, error=0.91, n_samples=2000)
    tanks = Facts(**both, share_left=0.071, left=3918.0, law=0.22, force=0.30, retuned=True, error=1.05, n_samples=1024)
    assert decide(story) == "unknown"
    assert decide(tanks) == "explained"
