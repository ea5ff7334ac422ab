"""Curves lose no point at a kill."""

from __future__ import annotations

from juicer.progress import NullMetricSink
from juicer.storage.curves import CurveWriter, read_curves


def test_half_a_line_takes_no_later_one_with_it(tmp_path):
    CurveWriter(tmp_path, NullMetricSink()).log({"train/loss": 1.0}, 500)
    with (tmp_path / "curves.jsonl").open("a") as file:
        file.write('[550, {"train/lo')
    resumed = CurveWriter(tmp_path, NullMetricSink())
    for step in (550, 600):
        resumed.log({"train/loss": 0.5}, step)
    resumed.finish(tmp_path)
    assert read_curves(tmp_path)["train/loss"] == ((500, 550, 600), (1.0, 0.5, 0.5))
