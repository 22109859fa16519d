"""Every claim of the page on closed forms holds. `make verify` draws the same runs."""

import pytest

from verification.closed_forms import TOPICS
from verification.topic import Topic


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_claims_hold(topic: Topic) -> None:
    findings = topic.run()
    assert findings.claims, f"{topic.name} claims nothing"
    assert not [str(claim) for claim in findings.claims if not claim.holds]
