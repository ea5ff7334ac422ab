from __future__ import annotations

from juicer.augmentation.augment import FailedAttempt
from juicer.augmentation.summary import AugmentationSummary, histogram
from juicer.augmentation.verify import RejectionReason


def test_every_value_falls_into_one_bin():
    assert histogram([-3, 0, 1.9, 2, 7, 1000], (0, 2, 5, 10)) == {"0..2": 3, "2..5": 1, "5..10": 2}


def test_rejections_are_counted_by_reason_and_kind():
    summary = AugmentationSummary(["insert leg"])
    attempts = [
        FailedAttempt("0123/0", 0, "far", RejectionReason.DROPPED),
        FailedAttempt("0123/0", 0, "near", RejectionReason.DROPPED),
        FailedAttempt("0123/1", 0, "near", RejectionReason.PART_POSITION),
    ]
    assert list(summary.keep(attempts)) == []
    facts = summary.as_json()
    assert facts["yield"] == 0.0
    assert facts["rejections"] == {"dropped": 2, "part_position": 1}
    assert facts["by_departure"]["near"] == {"attempts": 2, "snippets": 0}


def test_a_summary_of_nothing_is_all_zero():
    assert AugmentationSummary(["insert leg"]).as_json()["attempts"] == 0
