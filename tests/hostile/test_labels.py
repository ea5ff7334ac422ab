"""Labels files that nobody should have to read, each with the words that say what is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from juicer.annotation.labels import read_labels
from juicer.errors import InvalidLabels

HEADER = b"recording,step,critical_state\n"
DEEP = 100_000


def _yaml(entry: bytes) -> bytes:
    return b"- {" + entry + b"}\n"


_BOMB = b"a: &a [1,1,1,1,1,1,1,1,1]\n" + b"".join(
    b"%c: &%c [*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c]\n" % (name, name, *[name - 1] * 8) for name in range(ord("b"), ord("j"))
)

HOSTILE_LABELS: Mapping[str, tuple[str, bytes, str]] = {
    "lines empty": (".jsonl", b"", "holds no label"),
    "lines text": (".jsonl", b"labels\n", "line 1: it is not JSON"),
    "lines number": (".jsonl", b"3\n", "line 1: expected the keys"),
    "lines list": (".jsonl", b'["recording"]\n', "line 1: expected the keys"),
    "lines key missing": (".jsonl", b'\n{"recording": "3", "step": 4}\n', "line 2: 'critical_state' is missing"),
    "lines key twice": (
        ".jsonl",
        b'{"recording": "3", "step": 4, "step": 5, "critical_state": 0}',
        "'step' is there twice",
    ),
    "lines key unknown": (".jsonl", b'{"recording": "3", "step": 4, "critical_stat": 0}', "did you mean"),
    "lines boolean": (".jsonl", b'{"recording": "3", "step": true, "critical_state": 0}', "'step' must be a text or"),
    "lines fraction": (".jsonl", b'{"recording": "3", "step": 1.5, "critical_state": 0}', "'step' must be a text or"),
    "lines object": (".jsonl", b'{"recording": {"a": 1}, "step": 1, "critical_state": 0}', "must be a text or"),
    "lines 5000 digits": (
        ".jsonl",
        b'{"recording": "3", "step": ' + b"9" * 5000 + b', "critical_state": 0}',
        "it has 5000 digits",
    ),
    "lines deep": (".jsonl", b"[" * DEEP, "it is not JSON"),
    "lines null character": (".jsonl", b"\x00", "it is not JSON"),
    # What a table editor, or nobody, makes of it.
    "csv empty": (".csv", b"", "holds no label"),
    "csv blank lines": (".csv", b"\n\n \n", "holds no label"),
    "csv header only": (".csv", HEADER, "holds no label"),
    "csv without header": (".csv", b"3,120,0\n4,77,0\n", "line 1: it must name the columns"),
    "csv without header, one line": (".csv", b"3,120,0", "line 1: it must name the columns"),
    "csv semicolons": (".csv", b"recording;step;critical_state\n3;120;0\n", "separated by semicolons"),
    "csv semicolons without header": (".csv", b"3;120;0\n", "separated by semicolons"),
    "csv tabs": (".csv", b"recording\tstep\tcritical_state\n3\t120\t0\n", "separated by tabs"),
    "csv column twice": (".csv", b"recording,step,step,critical_state\n3,1,2,0\n", "'step' is there twice"),
    "csv column too many": (".csv", b"recording,step,critical_state,note\n3,1,0,x\n", "unknown key 'note'"),
    "csv column misspelt": (".csv", b"recordings,step,critical_state\n3,1,0\n", "did you mean 'recording'"),
    "csv column missing": (".csv", b"recording,step\n3,1\n", "'critical_state' is missing"),
    "csv column without name": (".csv", b"recording,step,critical_state,\n3,1,0,\n", "unknown key ''"),
    "csv value too many": (".csv", HEADER + b"3,120,0,1\n", "line 2: 3 values are needed, got 4"),
    "csv value missing": (".csv", HEADER + b"3,120\n", "line 2: 3 values are needed, got 2"),
    "csv value empty": (".csv", HEADER + b"3,,0\n", "'step' must be a whole number, got ''"),
    "csv word": (".csv", HEADER + b"3,here,0\n", "got 'here'"),
    "csv fraction": (".csv", HEADER + b"3,1.5,0\n", "got '1.5'"),
    "csv whole fraction": (".csv", HEADER + b"3,1.0,0\n", "got '1.0'"),
    "csv exponent": (".csv", HEADER + b"3,1e3,0\n", "got '1e3'"),
    "csv hexadecimal": (".csv", HEADER + b"3,0x10,0\n", "got '0x10'"),
    "csv underscores": (".csv", HEADER + b"3,1_000,0\n", "got '1_000'"),
    "csv superscript": (".csv", HEADER + "3,1²,0\n".encode(), "got '1²'"),
    "csv negative": (".csv", HEADER + b"3,-4,0\n", "got '-4'"),
    "csv boolean": (".csv", HEADER + b"3,true,0\n", "got 'true'"),
    "csv infinite": (".csv", HEADER + b"3,inf,0\n", "got 'inf'"),
    "csv 5000 digits": (".csv", HEADER + b"3," + b"9" * 5000 + b",0\n", "it has 5000 digits"),
    "csv a number beyond 64 bits": (".csv", HEADER + b"3,99999999999999999999,0\n", "it has 20 digits"),
    "csv numbers of an earlier juicer": (
        ".csv",
        b"episode,step,critical_state\n3,120,0\n",
        "it numbers episodes, and a number means another demonstration once a log is added; `juicer labels EPISODES",
    ),
    "yaml numbers of an earlier juicer": (
        ".yaml",
        _yaml(b"episode: 3, step: 4, critical_state: 0"),
        "numbers episodes",
    ),
    "csv escape sequence": (".csv", HEADER + b"3,\x1b[31m,0\n", "got '\\x1b[31m'"),
    "csv null": (".csv", HEADER + b"3,\x00,0\n", "got '\\x00'"),
    "csv long text": (".csv", HEADER + b"3," + b"x" * 200_000 + b",0\n", "field larger than field limit"),
    "csv longish text": (".csv", HEADER + b"3," + b"x" * 100_000 + b",0\n", "must be a whole number, got 'xxx"),
    "csv quote without end": (".csv", HEADER + b'3,"12,0\n4,5,0\n', "cannot be read: unexpected end"),
    "csv text after a quote": (".csv", HEADER + b'3,"12"3,0\n', "cannot be read"),
    "csv name missing": (".csv", HEADER + b",4,0\n", "'recording' must name an episode or a log, got ''"),
    "csv name escape sequence": (".csv", HEADER + b"\x1b[31m,4,0\n", "must name an episode or a log, got '\\x1b[31m'"),
    "csv name too long": (".csv", HEADER + b"x" * 5000 + b",4,0\n", "must name an episode or a log, got 'xxx"),
    "csv label twice": (".csv", HEADER + b"3,4,0\n3,9,0\n", "already labelled at"),
    "csv UTF-16": (".csv", HEADER.decode().encode("utf-16"), "is not UTF-8 text"),
    "csv Latin-1": (".csv", HEADER + b"3,\xe4,0\n", "is not UTF-8 text"),
    "csv not text": (".csv", bytes(range(256)) * 16, "is not UTF-8 text"),
    "csv too large": (".csv", HEADER + b"3,4,0\n" * 100_000, "it is larger than 262,144 bytes"),
    "yaml empty": (".yaml", b"", "holds no label"),
    "yaml comment only": (".yaml", b"# nothing yet\n", "holds no label"),
    "yaml empty list": (".yaml", b"[]", "holds no label"),
    "yaml mapping": (".yaml", b"recording: 3\nstep: 4\ncritical_state: 0\n", "must hold a list of entries"),
    "yaml text": (".yaml", b"labels", "must hold a list of entries"),
    "yaml two documents": (".yaml", b"--- []\n--- []\n", "expected a single document"),
    "yaml number": (".yaml", b"- 3", "entry 1: expected the keys"),
    "yaml list in the list": (".yaml", b"- [3, 4, 0]", "got a seq"),
    "yaml nothing in the list": (".yaml", b"-\n", "entry 1: expected the keys"),
    "yaml key twice": (".yaml", _yaml(b"recording: 3, step: 4, step: 5, critical_state: 0"), "'step' is there twice"),
    "yaml key missing": (".yaml", _yaml(b"recording: 3, step: 4"), "'critical_state' is missing"),
    "yaml key unknown": (".yaml", _yaml(b"recording: 3, step: 4, critical_state: 0, who: me"), "unknown key 'who'"),
    "yaml key a list": (".yaml", b"- {[1]: 3}\n", "unknown key 'a seq'"),
    "yaml key merged": (".yaml", _yaml(b"<<: 3, recording: 3, step: 4, critical_state: 0"), "unknown key '<<'"),
    "yaml boolean": (".yaml", _yaml(b"recording: 3, step: true, critical_state: 0"), "got 'true'"),
    "yaml old boolean": (".yaml", _yaml(b"recording: 3, step: on, critical_state: 0"), "got 'on'"),
    "yaml nothing": (".yaml", _yaml(b"recording: 3, step: , critical_state: 0"), "got ''"),
    "yaml null": (".yaml", _yaml(b"recording: 3, step: null, critical_state: 0"), "got 'null'"),
    "yaml fraction": (".yaml", _yaml(b"recording: 3, step: 4.5, critical_state: 0"), "got '4.5'"),
    "yaml infinite": (".yaml", _yaml(b"recording: 3, step: .inf, critical_state: 0"), "got '.inf'"),
    "yaml sexagesimal": (".yaml", _yaml(b"recording: 3, step: '1:30', critical_state: 0"), "got '1:30'"),
    "yaml date": (".yaml", _yaml(b"recording: 3, step: 2024-13-45, critical_state: 0"), "got '2024-13-45'"),
    "yaml list": (
        ".yaml",
        _yaml(b"recording: [3], step: 4, critical_state: 0"),
        "every value must be a text or a number",
    ),
    "yaml 5000 digits": (".yaml", _yaml(b"recording: 3, step: " + b"9" * 5000 + b", critical_state: 0"), "5000 digits"),
    "yaml deep lists": (".yaml", b"[" * DEEP, "nested too deeply|cannot be read"),
    "yaml deep mappings": (".yaml", b"{a: " * (DEEP // 2), "nested too deeply|cannot be read"),
    "yaml deep dashes": (".yaml", b"- " * DEEP, "nested too deeply"),
    "yaml bomb": (".yaml", _BOMB, "refers to another part of itself"),
    "yaml in a circle": (".yaml", b"&a [*a]", "refers to another part of itself"),
    "yaml alias without anchor": (".yaml", b"- *a", "refers to another part of itself"),
    "yaml object": (".yaml", b"- !!python/object/apply:os.system ['true']", "entry 1: expected the keys"),
    "yaml unknown tag": (".yaml", _yaml(b"recording: !x 3, step: y, critical_state: 0"), "got 'y'"),
    "yaml tab": (".yaml", b"-\trecording: 3\n\tstep: 4", "cannot be read"),
    "yaml without end": (".yaml", b"[", "cannot be read"),
    "yaml directive": (".yaml", b"%YAML 99.9\n--- []\n", "cannot be read|holds no label"),
    "yaml null character": (".yaml", b"- \x00", "cannot be read"),
    "yaml escape sequence": (".yaml", _yaml(b'recording: "\\e[31m", step: 4, critical_state: 0'), "got '\\x1b[31m'"),
    "yaml not text": (".yaml", b"\xff\xfe\x00", "is not UTF-8 text"),
    "yaml too large": (".yaml", b"- {recording: 3, step: 4, critical_state: 0}\n" * 100_000, "it is larger than"),
}
"""By name: the ending of the file, its content, and words of the refusal (alternatives parted by ``|``)."""


@pytest.mark.parametrize(("ending", "content", "words"), HOSTILE_LABELS.values(), ids=list(HOSTILE_LABELS))
def test_hostile_labels_are_refused_in_one_short_sentence(tmp_path: Path, ending: str, content: bytes, words: str):
    path = tmp_path / f"labels{ending}"
    path.write_bytes(content)
    with pytest.raises(InvalidLabels) as refusal:
        read_labels(path)
    sentence = str(refusal.value)
    assert any(part in sentence for part in words.split("|")), sentence
    assert len(sentence) < 600
    assert sentence.isprintable()
