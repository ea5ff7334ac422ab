"""Logs that nobody should have to read, by name: how each is made of an honest one's entries."""

from __future__ import annotations

import io
import json
import struct
import tarfile
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from juicer.demonstration.log import OperatorLog, write_log

Entries = dict[str, bytes]
Forge = Callable[[Entries], bytes]

ARRAYS = (
    *("proprioception", "part_poses", "sim_state", "action", "reward", "timestamp_s", "idle"),
    *("final_proprioception", "final_part_poses", "final_sim_state"),
)
ENTRIES = ("header", *ARRAYS)
FLAGS, METHOD, CRC, UNPACKED_SIZE, OFFSET = (8, "<H"), (10, "<H"), (16, "<L"), (24, "<L"), (42, "<L")
"""Where a field lies in an entry of a zip archive's directory, and its form."""


# How archives are made and spoilt.


def npy(values: Any, **options: Any) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array(file, np.asanyarray(values), **options)
    return file.getvalue()


def npy_of(descr: str, shape: str, content: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """An array file with a header of one's own words."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = struct.pack("<H" if version == (1, 0) else "<L", len(header))
    return b"\x93NUMPY" + bytes(version) + length + header + content


def pack(entries: Mapping[str, bytes], method: int = zipfile.ZIP_STORED, **options: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method, **options) as archive:
        for name, content in entries.items():
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def directory_field(content: bytes, name: str, field: tuple[int, str], value: int) -> bytes:
    """The archive with one field of an entry in its directory set."""
    spoilt = bytearray(content)
    at = content.rindex(b"PK\x01\x02" + b"", 0, content.rindex(f"{name}.npy".encode()))
    offset, form = field
    struct.pack_into(form, spoilt, at + offset, value)
    return bytes(spoilt)


def array_of(entries: Entries, name: str) -> Any:
    return np.lib.format.read_array(io.BytesIO(entries[name]))


def header_of(entries: Entries) -> dict[str, Any]:
    return json.loads(str(array_of(entries, "header")))


def with_header(text: str) -> Forge:
    return lambda entries: pack(entries | {"header": npy(np.array(text))})


def with_fields(**fields: Any) -> Forge:
    return lambda entries: with_header(json.dumps(header_of(entries) | fields))(entries)


def without_field(name: str) -> Forge:
    def forge(entries: Entries) -> bytes:
        header = header_of(entries)
        del header[name]
        return with_header(json.dumps(header))(entries)

    return forge


def with_array(name: str, change: Callable[[Any], Any]) -> Forge:
    return lambda entries: pack(entries | {name: npy(change(array_of(entries, name)))})


def with_entry(name: str, content: bytes) -> Forge:
    return lambda entries: pack(entries | {name: content})


# The families of hostile logs.


def truncated() -> Iterator[tuple[str, Forge]]:
    for share in (0, 1e-5, 1e-4, 0.001, 0.01, *np.linspace(0.1, 0.9, 9).tolist(), 0.99, 0.999, 0.9999, 1 - 1e-6):
        yield f"cut off at {share:g}", lambda entries, share=share: pack(entries)[: int(len(pack(entries)) * share)]


def foreign() -> Iterator[tuple[str, Forge]]:
    files = {
        "text": b"a log\n" * 100,
        "zeros": bytes(10_000),
        "an array": npy(np.zeros(3)),
        "a picture": b"\x89PNG\r\n\x1a\n" + bytes(1000),
        "gzip": b"\x1f\x8b\x08\x00" + bytes(100),
        "a pickle": b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00}\x94.",
        "HDF5": b"\x89HDF\r\n\x1a\n" + bytes(1000),
        "magic number of an array": b"\x93NUMPY garbage",
        "magic number of an archive": b"PK\x03\x04 garbage",
        "an archive's end": b"PK\x05\x06" + bytes(18),
        "an archive's end that lies": b"PK\x05\x06" + struct.pack("<4H2LH", 0, 0, 9, 9, 2**31, 2**31, 0),
        "an archive's end beyond 32 bits": b"PK\x06\x07" + bytes(16) + b"PK\x05\x06" + b"\xff" * 16 + bytes(2),
    }
    for name, content in files.items():
        yield f"a file of {name}", lambda entries, content=content: content
    yield "a folder of it, as tar", in_tar
    yield "an archive in an archive", lambda entries: pack({"log": pack(entries)})
    yield "an archive of nothing", lambda entries: pack({})
    yield "entries without their ending", lambda entries: packed_as(entries, "{}")
    yield "entries in a folder", lambda entries: packed_as(entries, "log/{}.npy")
    yield "entries of other case", lambda entries: packed_as(entries, "{}.NPY")
    yield "garbage behind it", lambda entries: pack(entries) + bytes(100_000)
    yield "many entries", lambda entries: pack(entries | {f"more{number}": b"" for number in range(100)})
    yield "a great many entries", lambda entries: pack(entries | {f"more{number}": b"" for number in range(30_000)})
    yield "bzip2", lambda entries: pack(entries, zipfile.ZIP_BZIP2)
    yield "lzma", lambda entries: pack(entries, zipfile.ZIP_LZMA)


def in_tar(entries: Entries) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("header.npy"), io.BytesIO(entries["header"]))
    return file.getvalue()


def packed_as(entries: Entries, form: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in entries.items():
            archive.writestr(form.format(name), content)
    return file.getvalue()


def spoilt_entries() -> Iterator[tuple[str, Forge]]:
    fields = {
        "is encrypted": (FLAGS, 1),
        "is compressed in an unknown way": (METHOD, 99),
        "is compressed as in 1989": (METHOD, 1),
        "is said to be deflated": (METHOD, 8),
        "has another checksum": (CRC, 12345),
        "is said to be empty": (UNPACKED_SIZE, 0),
        "is said to be short": (UNPACKED_SIZE, 100),
        "is said to be huge": (UNPACKED_SIZE, 2**32 - 2),
        "is said to lie elsewhere": (OFFSET, 7),
        "is said to lie beyond the end": (OFFSET, 2**31),
    }
    for name in ENTRIES:
        yield f"{name} is missing", lambda entries, name=name: pack({k: v for k, v in entries.items() if k != name})
        yield f"{name} is there twice", lambda entries, name=name: twice(entries, name)
        yield f"{name} has a tail", lambda entries, name=name: pack(entries | {name: entries[name] + b"tail"})
        yield f"{name} lacks its end", lambda entries, name=name: pack(entries | {name: entries[name][:-3]})
        for words, (field, value) in fields.items():
            yield (
                f"{name} {words}",
                lambda entries, name=name, field=field, value=value: directory_field(pack(entries), name, field, value),
            )
    for name, content in {
        "is empty": b"",
        "is garbage": b"garbage" * 10,
        "is of numpy's version 9": npy_of("'<f8'", "(3,)", bytes(24), version=(9, 0)),
        "has a header without end": b"\x93NUMPY\x01\x00\xff\xff{'descr': ",
        "has a long header": npy_of("'<f8'", "(" + "3, " * 20_000 + ")", version=(2, 0)),
        "has a deep header": npy_of("(" * 900, "(3,)"),
        "has a header that is code": npy_of("__import__('os')", "(3,)"),
        "has a header of other keys": b"\x93NUMPY\x01\x00\x0b\x00{'a': 'b'}\n",
        "has no type": npy_of("'nothing'", "(3,)"),
        "has a shape of words": npy_of("'<f8'", "('a',)"),
        "has a negative shape": npy_of("'<f8'", "(-3, -281)"),
        "has a shape beyond 64 bits": npy_of("'<f8'", f"({10**30},)"),
        "has a shape of 4000 digits": npy_of("'<f8'", f"({'9' * 900},)"),
        "has a thousand million steps": npy_of("'<f8'", f"({10**9}, 281)"),
        "has no steps, each huge": npy_of("'<f8'", f"(0, {10**12})"),
        "has rows of rows": npy_of("('<f8', (1000,))", "(300,)"),
        "has a fields type": npy_of("[('a', '<f8')]", "(300,)", bytes(2400)),
    }.items():
        yield f"sim_state {name}", with_entry("sim_state", content)


def twice(entries: Entries, name: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for entry in (*entries, name):
            archive.writestr(f"{entry}.npy", entries[entry])
    return file.getvalue()


def odd_arrays() -> Iterator[tuple[str, Forge]]:
    changes: dict[str, Callable[[Any], Any]] = {
        "objects": lambda values: np.array([{"a": 1}] * len(values), dtype=object),
        "texts": lambda values: values.astype(str),
        "bytes": lambda values: values.astype("S8"),
        "complex numbers": lambda values: values.astype(complex),
        "records": lambda values: np.zeros(len(values), dtype=[("a", "f8"), ("b", "i4")]),
        "dates": lambda values: np.zeros(values.shape, dtype="datetime64[s]"),
        "raw memory": lambda values: np.zeros(values.shape, dtype="V8"),
        "one number": lambda values: values.dtype.type(0),
        "nothing": lambda values: values[:0],
        "one entry less": lambda values: values[:-1],
        "one axis more": lambda values: values[..., None],
        "one axis more, of no entries": lambda values: np.zeros((*values.shape, 0), values.dtype),
    }
    for name in ARRAYS:
        for words, change in changes.items():
            yield f"{name} holds {words}", with_array(name, change)
        if name != "idle":
            for number in (np.nan, np.inf, -np.inf):
                yield f"{name} holds {number}", with_array(name, lambda values, number=number: ended(values, number))
    yield "idle holds numbers", with_array("idle", lambda values: values.astype(float))


def ended(values: Any, number: float) -> Any:
    values = np.array(values)
    values.flat[-1] = number
    return values


def odd_headers() -> Iterator[tuple[str, Forge]]:
    texts = {
        "is empty": "",
        "is no JSON": "task: one_leg",
        "is a list": "[]",
        "is a number": "7",
        "is null": "null",
        "is cut off": '{"format": "juicer-operator-log", ',
        "is nested deeply": "[" * 60_000,
        "is nested deeply in mappings": '{"a":' * 10_000,
        "has a long number": '{"format": "juicer-operator-log", "version": 1, "seed": ' + "9" * 5000 + "}",
        "holds NaN": '{"format": "juicer-operator-log", "version": NaN}',
        "holds Infinity": '{"format": "juicer-operator-log", "version": -Infinity}',
        "says a thing twice": '{"format": "juicer-operator-log", "version": 1, "version": 1}',
        "is of another format": '{"format": "\\u001b[31mred"}',
        "is of version 2": '{"format": "juicer-operator-log", "version": 2}',
        "is of version true": '{"format": "juicer-operator-log", "version": true}',
        "is of a long version": '{"format": "juicer-operator-log", "version": "' + "\\u001b" * 9000 + '"}',
        "is 20 MB long": " " * 20_000_000,
    }
    for name, text in texts.items():
        yield f"header {name}", with_header(text)
    yield "header is bytes", with_entry("header", npy(np.array(b"{}")))
    yield "header is two texts", with_entry("header", npy(np.array(["{}", "{}"])))
    yield "header is a number", with_entry("header", npy(np.array(7)))
    yield "header is an object", with_entry("header", npy(np.array({"format": "x"}, dtype=object)))
    yield "header holds letters that are none", with_entry("header", npy_of("'<U2'", "()", b"\xff" * 8))
    for field in ("task", "randomness", "seed", "device", "success", "outcome", "parts_assembled", "milestones"):
        yield f"header lacks {field}", without_field(field)
        for value in (["a"], 1.5, {"a": {"b": 1}}, *(() if field == "outcome" else (None,))):
            yield f"header says {field} is {value}", with_fields(**{field: value})
    escape = "\x1b[2J\x1b[31m\n\u202e" * 400
    for field, value in {"task": escape, "randomness": escape, "outcome": escape, "milestones": {escape: 1}}.items():
        yield f"header steers the terminal by {field}", with_fields(**{field: value})
    for milestones in ({"leg_lifted": -1}, {"leg_lifted": True}, {"leg_lifted": 10**15}, {"leg_lifted": "3"}):
        yield f"header says milestones {milestones}", with_fields(milestones=milestones)
    yield "header has many milestones", with_fields(milestones={f"m{number}": 1 for number in range(4000)})
    for seed in (-1, 10**17, 3_000_000, "7", 7.0, True):
        yield f"header says seed {seed!r}", with_fields(seed=seed)


def bombs() -> Iterator[tuple[str, Forge]]:
    """Small files that say, or hide, that they unfold into much."""
    yield "bomb of a million steps", million_steps
    yield "bomb of a header", with_packed("header", npy_of(f"'<U{2**25}'", "()", bytes(2**27)))
    yield "bomb of wide steps", with_packed("part_poses", npy_of("'<f4'", "(300, 200000)", bytes(300 * 4 * 200_000)))
    yield (
        "bomb that lies",
        lambda entries: directory_field(
            with_packed("idle", entries["idle"] + bytes(2**28))(entries), "idle", UNPACKED_SIZE, len(entries["idle"])
        ),
    )
    yield "bomb of a foreign entry and no log", lambda entries: pack({"more": bytes(2**28)}, zipfile.ZIP_DEFLATED)


def with_packed(name: str, content: bytes) -> Forge:
    return lambda entries: pack(entries | {name: content}, zipfile.ZIP_DEFLATED, compresslevel=1)


def million_steps(entries: Entries) -> bytes:
    """Every array says that it has a million steps, and the directory agrees."""
    length = 10**6
    arrays = {name: array_of(entries, name) for name in ARRAYS if not name.startswith("final")}
    heads = {name: npy_of(repr(values.dtype.str), str((length, *values.shape[1:]))) for name, values in arrays.items()}
    content = pack(entries | {name: head + bytes(1000) for name, head in heads.items()}, zipfile.ZIP_DEFLATED)
    for name, head in heads.items():
        size = len(head) + length * arrays[name][:1].nbytes
        content = directory_field(content, name, UNPACKED_SIZE, size)
    return content


HOSTILE_LOGS: Mapping[str, Forge] = dict(
    (*truncated(), *foreign(), *spoilt_entries(), *odd_arrays(), *odd_headers(), *bombs())
)


UNUSUAL_LOGS: Mapping[str, Forge] = {
    "deflated": lambda entries: pack(entries, zipfile.ZIP_DEFLATED),
    "with more": lambda entries: pack(entries | {"notes": npy(np.arange(3)), "pictures": b"of another program"}),
    "after a script": lambda entries: b"#!/bin/sh\n" + pack(entries),
    "fortran": with_array("sim_state", np.asfortranarray),
    "big endian": with_array("sim_state", lambda values: values.astype(">f8")),
    "double": with_array("action", lambda values: values.astype(np.float64)),
    "an entry": with_entry("more", b"more"),
    "a field": with_fields(notes="of the recording tool"),
    "no milestones": with_fields(milestones={}),
    "a device": with_fields(device="a hand\x1b[31m" + "x" * 5000),
}
"""Logs that are only unusual."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every log is a test of its own."""
    for name, logs in {"hostile_log": HOSTILE_LOGS, "unusual_log": UNUSUAL_LOGS}.items():
        if name in metafunc.fixturenames:
            metafunc.parametrize(name, logs.values(), ids=list(logs))


@pytest.fixture(scope="session")
def good(recording: OperatorLog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("good") / "good.npz"
    write_log(path, recording)
    return path


@pytest.fixture(scope="session")
def entries(good: Path) -> Entries:
    with zipfile.ZipFile(good) as archive:
        return {info.filename.removesuffix(".npy"): archive.read(info) for info in archive.infolist()}


@pytest.fixture
def hostile_logs() -> Mapping[str, Forge]:
    """All hostile logs by name."""
    return HOSTILE_LOGS


@pytest.fixture
def bombs_only() -> Mapping[str, Forge]:
    """Those that unfold into much."""
    return dict(bombs())


@pytest.fixture
def packed(entries: Entries) -> bytes:
    """An honest log, compressed."""
    return pack(entries, zipfile.ZIP_DEFLATED, compresslevel=1)
