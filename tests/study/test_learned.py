"""What policies learned from is told by every source."""

from __future__ import annotations

from juicer.study.learned import learned_section

LEARNED = {
    "episodes": {"teleop": 50, "rollout": 83, "augmentation": 150, "correction": 7},
    "timesteps": {"teleop": 28_900, "rollout": 44_120, "augmentation": 8_250, "correction": 1_230},
    "windows": {"teleop": 28_000, "rollout": 43_000, "augmentation": 8_000, "correction": 1_200},
    "unused_timesteps": {"teleop": 900, "rollout": 1120},
}


def test_sizes_have_the_form_of_table_v_with_corrections_after_them(made):
    made.evaluation("ta_ci", made.artifact("train", "checkpoint", summary=LEARNED))
    made.evaluation("replay", made.artifact("memorise", "checkpoint", summary={"episodes": {"teleop": 50}}))
    section = learned_section([made.study])
    assert section is not None
    assert "demonstrations / rollouts / corrective snippets / corrections" in section.note
    ours, replay = section.tables[0].rows
    assert ours == (
        "TA_CI", "50 / 83 / 150 / 7", "28900 / 44120 / 8250 / 1230", "28000 / 43000 / 8000 / 1200", "2020", "10%",
        "50 / 50 / 150",
    )  # fmt: skip
    assert replay[:2] == ("REPLAY", "50 / 0 / 0 / 0")
