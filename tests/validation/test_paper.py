"""Every claim of the page on the paper holds, but for training. `make paper` uses the same runs."""

import numpy as np
import pytest

from validation.paper_replication import CHAPTERS, SLOW, loop
from validation.topic import Topic

TOPICS = [topic for chapter in CHAPTERS for topic in chapter.topics]
#: Bisections over whole runs, of which one is enough here, and what needs Stable-Baselines3.
APART = (SLOW, "inclines", "environment")


@pytest.mark.slow("repeats a page")
@pytest.mark.parametrize("topic", [t for t in TOPICS if t.name not in APART], ids=lambda topic: topic.name)
def test_claims_hold(topic: Topic) -> None:
    findings = topic.run()
    assert findings.claims, f"{topic.name} claims nothing"
    assert not [str(claim) for claim in findings.claims if not claim.holds]


def test_environment_passes_the_checkers() -> None:
    pytest.importorskip("stable_baselines3")
    topic = next(t for t in TOPICS if t.name == "environment")
    assert all(claim.holds for claim in topic.run().claims)


def test_more_torque_than_traction_makes_the_robot_fall() -> None:
    incline = (3.0, 0.0)
    for model in ("contact", "rigid"):
        capped = loop.balance(model, incline, seconds=1.0)
        assert not capped.fell
        assert np.degrees(capped.tilt[-1]) < 0.1
        assert loop.balance(model, incline, max_torque=loop.PRINTED_TORQUE, seconds=1.0).fell


def test_every_topic_has_a_title_and_a_text() -> None:
    for topic in TOPICS:
        assert topic.title
        assert topic.text, topic.name
