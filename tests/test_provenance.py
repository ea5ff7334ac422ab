"""It is told in words where an episode comes from."""

from __future__ import annotations

from juicer.episode import Source
from juicer.provenance import NOUNS, provenance


def test_a_source_that_is_added_must_be_told():
    assert set(NOUNS) == set(Source)


def test_where_an_episode_comes_from_is_told_by_what_its_record_holds(episode_factory):
    snippet = episode_factory(12, source=Source.AUGMENTATION, parent="abc/3", critical_state=1)
    assert provenance(snippet.record) == ["corrective snippet grown from abc/3", "returns to critical state 1"]
    rollout = episode_factory(12, source=Source.ROLLOUT, policy="0123456789abcdef")
    assert provenance(rollout.record) == ["rollout", "policy 01234567"]
    by_hand = {"parent": "abc", "parent_step": 7, "operator": "Ann", "device": "keyboard", "log": "a.npz"}
    correction = episode_factory(12, source=Source.CORRECTION, **by_hand)
    assert provenance(correction.record) == [
        "correction grown from abc at step 7", "by Ann", "keyboard", "a.npz",
    ]  # fmt: skip
