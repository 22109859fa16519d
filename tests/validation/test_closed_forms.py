"""Every claim of the page on closed forms holds. `make verify` uses the same runs."""

from pathlib import Path

import pytest

from validation import page
from validation.claim import Claim
from validation.closed_forms import TOPICS
from validation.topic import Findings, Topic


@pytest.mark.slow("repeats a page")
@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_claims_hold(topic: Topic) -> None:
    findings = topic.run()
    assert findings.claims, f"{topic.name} claims nothing"
    assert not [str(claim) for claim in findings.claims if not claim.holds]


@pytest.mark.parametrize(
    ("findings", "allow_missing", "code"),
    [
        (Findings([Claim("holds", 1.0, 1.0, 0.0)]), False, 0),
        (Findings([Claim("fails", 1.0, 2.0, 0.1)]), True, 1),
        (Findings([Claim("not a number", float("nan"), 2.0, 0.1)]), True, 1),
        (Findings([], missing=("an engine is not available",)), False, 1),
        (Findings([], missing=("an engine is not available",)), True, 0),
    ],
)
def test_the_exit_code_reports_failures_and_skipped_topics(findings: Findings, allow_missing: bool, code: int) -> None:
    assert page.verdict([findings], allow_missing) == code


def test_a_topic_by_name_prints_its_claims_and_plots_only_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    topic = next(topic for topic in TOPICS if topic.name == "growth")
    findings = topic.run()
    page.print_alone(topic, findings, None)
    printed = capsys.readouterr().out
    assert all(claim.what in printed for claim in findings.claims)
    assert list(tmp_path.iterdir()) == []
    pytest.importorskip("matplotlib")
    page.print_alone(topic, findings, tmp_path / "figures")
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["growth.svg"]
