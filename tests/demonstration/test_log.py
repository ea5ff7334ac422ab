"""Operator logs survive the disk, and damaged ones are named."""

from __future__ import annotations

import errno
import json
import pickle
import resource
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.demonstration.log import MOST_STEPS, VERSION, OperatorLog, read_log, write_log
from juicer.episode import Outcome
from juicer.errors import LogNotWritten, RejectedLog


def test_a_log_reads_back_as_it_was_written(make_log, tmp_path: Path):
    log = make_log(milestones={"leg_lifted": 3})
    write_log(tmp_path / "log.npz", log)
    back = read_log(tmp_path / "log.npz")
    assert (back.task, back.seed, back.device, back.outcome) == (log.task, log.seed, log.device, log.outcome)
    assert back.milestones == {"leg_lifted": 3}
    for name, values in log.steps.items():
        np.testing.assert_array_equal(back.steps[name], values)
        assert back.steps[name].dtype == values.dtype
    np.testing.assert_array_equal(back.final["sim_state"], log.final["sim_state"])
    np.testing.assert_array_equal(back.timestamp_s, log.timestamp_s)


def test_equal_logs_give_equal_bytes_and_no_draft_stays(make_log, tmp_path: Path):
    write_log(tmp_path / "one.npz", make_log())
    write_log(tmp_path / "two.npz", make_log())
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.npz", "two.npz"]


def test_a_missing_file_is_rejected(tmp_path: Path):
    with pytest.raises(RejectedLog, match="does not exist"):
        read_log(tmp_path / "nowhere.npz")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_log_is_rejected(make_log, tmp_path: Path, share: float):
    path = tmp_path / "log.npz"
    write_log(path, make_log())
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RejectedLog, match="truncated or no operator log"):
        read_log(path)


def test_flipped_bytes_are_rejected(make_log, tmp_path: Path):
    path = tmp_path / "log.npz"
    write_log(path, make_log())
    content = bytearray(path.read_bytes())
    for position in range(len(content) // 3, len(content) // 3 + 64):
        content[position] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(RejectedLog):
        read_log(path)


@pytest.mark.parametrize("content", [b"not a log", b"\x93NUMPY garbage", b"PK\x03\x04 garbage"])
def test_a_foreign_file_is_rejected(tmp_path: Path, content: bytes):
    (tmp_path / "log.npz").write_bytes(content)
    with pytest.raises(RejectedLog, match="no operator log"):
        read_log(tmp_path / "log.npz")


def test_a_plain_array_is_no_log(tmp_path: Path):
    with (tmp_path / "log.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(RejectedLog, match="no operator log"):
        read_log(tmp_path / "log.npz")


def test_pickled_content_is_never_loaded(make_log, tmp_path: Path):
    np.savez(tmp_path / "log.npz", header=np.array([{"format": "x"}], dtype=object))
    with pytest.raises(RejectedLog, match="no operator log"):
        read_log(tmp_path / "log.npz")


def _rewrite(
    path: Path, drop: str = "", arrays: Mapping[str, NDArray[Any]] | None = None, **header_changes: object
) -> None:
    with np.load(path) as archive:
        entries = {name: archive[name] for name in archive.files if name != drop} | (arrays or {})
    header = json.loads(str(entries["header"])) | header_changes
    entries["header"] = np.array(json.dumps(header))
    np.savez(path, **entries)


def test_another_version_is_named(make_log, tmp_path: Path):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", version=VERSION + 1)
    with pytest.raises(RejectedLog, match=f"version {VERSION + 1}, but this program reads version {VERSION}"):
        read_log(tmp_path / "log.npz")


def test_a_missing_array_is_named(make_log, tmp_path: Path):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", drop="sim_state")
    with pytest.raises(RejectedLog, match="sim_state"):
        read_log(tmp_path / "log.npz")


def test_a_wrong_header_entry_is_named(make_log, tmp_path: Path):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", seed="seven")
    with pytest.raises(RejectedLog, match="'seed'"):
        read_log(tmp_path / "log.npz")


@pytest.mark.parametrize("seed", [True, 7.0, None])
def test_a_seed_that_is_no_integer_is_named(make_log, tmp_path: Path, seed: object):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", seed=seed)
    with pytest.raises(RejectedLog, match="'seed'"):
        read_log(tmp_path / "log.npz")


@pytest.mark.parametrize("step", ["40", 40.0, None, True, [40], -1])
def test_a_milestone_that_is_no_step_is_named(make_log, tmp_path: Path, step: object):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", milestones={"leg_lifted": step})
    with pytest.raises(RejectedLog, match="milestone 'leg_lifted' must be the number of a step"):
        read_log(tmp_path / "log.npz")


@pytest.mark.parametrize("name", ["action", "sim_state", "idle", "timestamp_s", "final_part_poses"])
@pytest.mark.parametrize("values", [np.array(["none"] * 80), np.zeros((80, 10), complex), np.array(0.0)])
def test_an_array_of_another_type_is_named(make_log, tmp_path: Path, name: str, values: NDArray[Any]):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", arrays={name: values})
    with pytest.raises(RejectedLog, match=f"array '{name}' must hold"):
        read_log(tmp_path / "log.npz")


def test_numbers_are_read_as_they_will_be_stored(make_log, tmp_path: Path):
    write_log(tmp_path / "log.npz", make_log())
    _rewrite(tmp_path / "log.npz", arrays={"proprioception": np.full((80, 16), 1e300)})
    proprioception = read_log(tmp_path / "log.npz").steps["proprioception"]
    assert proprioception.dtype == np.float32
    assert np.isinf(proprioception).all()


BAD_TO_WRITE: dict[str, tuple[dict[str, Any], str]] = {
    "a missing array": ({"steps": {"action": np.zeros((80, 10))}}, "array 'proprioception' is missing"),
    "an unknown array": (
        {"steps": {"images": np.zeros((80, 10))}},
        "there is no place in a log for the array 'images'",
    ),
    "an action too short": ({"steps": {"action": np.zeros((80, 9))}}, "'action' must have the shape"),
    "another length": ({"idle": np.zeros(79, bool)}, "'idle' must have the shape"),
    "one axis more": ({"timestamp_s": np.zeros((80, 1))}, "'timestamp_s' must have the shape"),
    "rows of different lengths": ({"idle": [[True], [True, False]]}, "rows of different lengths"),
    "numbers for truths": ({"idle": np.zeros(80)}, "'idle' must hold bool"),
    "texts for numbers": ({"timestamp_s": np.array(["1"] * 80)}, "'timestamp_s' must hold float64"),
    "complex numbers": ({"timestamp_s": np.zeros(80, complex)}, "'timestamp_s' must hold float64"),
    "objects": ({"timestamp_s": np.array([None] * 80)}, "'timestamp_s' must hold float64"),
    "another final state": ({"final": {"sim_state": np.zeros(3)}}, "'final_sim_state' must have the shape"),
    "a seed that is no number": ({"seed": "seven"}, "header entry 'seed'"),
    "a mark that is none": ({"success": 1}, "header entry 'success'"),
    "a milestone that is no step": ({"milestones": {"leg_lifted": 3.5}}, "milestone 'leg_lifted' must be the number"),
    "a device that steers terminals": ({"device": "\x1b[31m"}, "'device' must be at most 200 printable letters"),
    "a long device": ({"device": "x" * 201}, "'device' must be at most 200 printable letters"),
}


@pytest.mark.parametrize(("changes", "reason"), BAD_TO_WRITE.values(), ids=list(BAD_TO_WRITE))
def test_a_bad_log_is_not_written(make_log, tmp_path: Path, changes: dict[str, Any], reason: str):
    log = make_log()
    parts = {
        name: ({} if "missing" in reason else dict(getattr(log, name))) | changes[name]
        for name in ("steps", "final")
        if name in changes
    }
    with pytest.raises(RejectedLog, match=reason):
        write_log(tmp_path / "log.npz", make_log(**(changes | parts)))
    assert list(tmp_path.iterdir()) == []


def test_a_log_without_steps_or_with_too_many_is_not_written(make_log, tmp_path: Path):
    for length in (0, MOST_STEPS + 1):
        with pytest.raises(RejectedLog, match=f"must hold 1 to 20,000 steps, got {length:,}"):
            write_log(tmp_path / "log.npz", make_log(length=1, **_resized(make_log(length=1), length)))


def _resized(log: OperatorLog, length: int) -> dict[str, Any]:
    steps = {name: np.resize(values, (length, *values.shape[1:])) for name, values in log.steps.items()}
    return {"steps": steps, "timestamp_s": np.arange(float(length)), "idle": np.zeros(length, bool)}


def test_what_numpy_and_environments_give_is_written_as_it_is_meant(make_log, tmp_path: Path):
    log = make_log(seed=np.int64(7), success=np.True_, outcome=Outcome.SUCCESS, milestones={"screwed": np.int32(3)})
    write_log(tmp_path / "log.npz", log)
    back = read_log(tmp_path / "log.npz")
    assert (back.seed, back.success, back.outcome, back.milestones) == (7, True, "success", {"screwed": 3})


@pytest.mark.parametrize(("name", "reason"), [("log", "must end in .npz"), ("folder/log.npz", "folder does not exist")])
def test_a_place_that_cannot_be_written_is_named(make_log, tmp_path: Path, name: str, reason: str):
    with pytest.raises(LogNotWritten, match=f"log '{tmp_path / name}' cannot be written: .*{reason}"):
        write_log(tmp_path / name, make_log())


def test_a_full_disk_is_named_and_leaves_nothing(make_log, tmp_path: Path):
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limit[1]))
    try:
        with pytest.raises(LogNotWritten, match="cannot be written: File too large") as refusal:
            write_log(tmp_path / "log.npz", make_log())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, handler)
    assert refusal.value.errno == errno.EFBIG
    assert list(tmp_path.iterdir()) == []


def test_a_refusal_to_write_survives_the_way_between_processes_and_machines():
    refusal = LogNotWritten(errno.ENOSPC, "No space left on device", "a.npz")
    back = pickle.loads(pickle.dumps(refusal))
    assert (str(back), back.errno) == ("log 'a.npz' cannot be written: No space left on device", errno.ENOSPC)
    assert str(LogNotWritten(str(refusal))) == str(refusal)
