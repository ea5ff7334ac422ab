"""Configurations as strangers and slips of the keyboard write them: one sentence each, at once, nothing is built."""

from __future__ import annotations

import os
import subprocess
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import pytest

from flows.runs import load_runs, parse_runs
from juicer.errors import ConfigError

BOMB = "a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 12)
)
MAPPING_BOMB = "a0: &a0 {x: 1, y: 2, z: 3}\n" + "".join(
    f"a{level}: &a{level} {{x: *a{level - 1}, y: *a{level - 1}, z: *a{level - 1}}}\n" for level in range(1, 30)
)

TEXTS: dict[str, str] = {
    "duplicate section": "evaluate: {episodes: 3}\nevaluate: {episodes: 4}\n",
    "duplicate key in a section": "evaluate:\n  episodes: 3\n  episodes: 4\n",
    "duplicate base": "base: laptop\nbase: paper\n",
    "duplicate task": "tasks: {lamp: {}, lamp: {}}\n",
    "task listed twice": "tasks: [lamp, lamp]\n",
    "task unknown": "tasks: [lmap]\n",
    "task that is a list": "task: [lamp]\n",
    "task that is null": "task: null\n",
    "task of a section": "task: lamp\nrecord: {task: one_leg}\n",
    "task of a section that is the same": "task: lamp\nevaluate: {task: lamp}\n",
    "task of a task": "tasks: {lamp: {task: one_leg}}\n",
    "tasks of a task": "tasks: {lamp: {tasks: [one_leg]}}\n",
    "flow of a task": "tasks: {lamp: {flow: study}}\n",
    "section of a task with a task": "tasks: {lamp: {record: {task: one_leg}}}\n",
    "mix": "mix: {lamp: {task: one_leg}}\n",
    "task with an escape sequence": 'task: "\\e[2Jlamp"\n',
    "endless task": f"task: {'lamp' * 20_000}\n",
    "deep lists": "[" * 100_000,
    "deep mappings": "{a: " * 100_000,
    "deep and closed": "a: " + "[" * 100_000 + "]" * 100_000,
    "dashes": "- " * 100_000,
    "question marks": "? " * 100_000,
    "bomb": BOMB,
    "bomb of mappings": MAPPING_BOMB,
    "bomb of merges": "a: &a {x: 1}\nb: {<<: [" + "*a, " * 30_000 + "]}\n",
    "anchor in itself": "record: &r {seed: *r}\n",
    "anchor unknown": "record: *r\n",
    "thousands of values": "seeds: [" + "1, " * 50_000 + "]\n",
    "thousands of keys": "".join(f"k{index}: 1\n" for index in range(30_000)),
    "a megabyte": "name: " + "a" * 1_000_000 + "\n",
    "a megabyte of comment": "#" * 1_000_000,
    "digits": "seed: " + "9" * 5000 + "\n",
    "digits of a fraction": "augment: {min_confidence: 0." + "9" * 5000 + "e9}\n",
    "version of thousands of digits": "%YAML 1." + "9" * 5000 + "\n---\nseed: 1\n",
    "two documents": "seed: 1\n---\nseed: 2\n",
    "python object": "seed: !!python/object/apply:os.system ['true']\n",
    "python name": "name: !!python/name:os.system\n",
    "tag of a set": "seeds: !!set {1, 2}\n",
    "tag of binary": "name: !!binary aGk=\n",
    "own tag": "!juicer seed: 1\n",
    "null character": "name: a\0b\n",
    "null character escaped": 'name: "a\\0b"\n',
    "null character in a path": 'logs: "a\\0b"\n',
    "null character in a base": 'base: "a\\0b.yaml"\n',
    "tab": "record:\n\tseed: 1\n",
    "escape sequence as a key": '"a\\e[2J": 1\n',
    "line break as a key": '"a\\nb": 1\n',
    "right to left": '"a\\u202Eb": 1\n',
    "number as a key": "1: 2\n",
    "truth as a key": "true: 2\n",
    "nothing as a key": "null: 2\n",
    "list as a key": "? [a, b]\n: 1\n",
    "mapping as a key": "? {a: b}\n: 1\n",
    "list": "- 1\n",
    "text": "just text\n",
    "number": "5\n",
    "unclosed": "seeds: [1, 2\n",
    "unclosed text": "name: 'a\n",
    "wrong indent": "record:\n  seed: 1\n first: 2\n",
    "colon twice": "name: a: b\n",
    "flow unknown": "flow: studdy\n",
    "flow as a list": "flow: [study]\n",
    "flow as nothing": "flow:\n",
    "endless flow": f"flow: {'study' * 20_000}\n",
    "date as a seed": "seed: 2024-13-45\n",
    "time as a seed": "seed: 1:30\n",
    "octal seed": "seed: 007\n",
    "hexadecimal seed": "seed: 0x10\n",
    "seed as text": "seed: '1'\n",
    "seed as a fraction": "seed: 1.0\n",
    "seed that is true": "seed: true\n",
    "seed that is yes": "seed: yes\n",
    "seed below zero": "seed: -1\n",
    "seed too large": "seed: 10000000000\n",
    "seeds of truth": "flow: study\nseeds: [true]\n",
    "seeds as a number": "flow: study\nseeds: 1\n",
    "seeds as text": "flow: study\nseeds: '01'\n",
    "no seeds": "flow: study\nseeds: []\n",
    "the same seed twice": "flow: study\nseeds: [1, 1]\n",
    "thousands of seeds": "flow: study\nconditions: [bc]\nseeds: [" + ", ".join(map(str, range(2000))) + "]\n",
    "condition unknown": "condition: tai\n",
    "condition as a list": "condition: [bc]\n",
    "conditions as text": "flow: study\nconditions: bc\n",
    "the same condition twice": "flow: study\nconditions: [bc, bc]\n",
    "no conditions": "flow: study\nconditions: []\n",
    "multitask alone": "condition: multitask\n",
    "randomness unknown": "randomness: lo\n",
    "randomness of a section unknown": "evaluate: {randomness: none}\n",
    "name with a slash": "name: a/../../b\n",
    "name with a dot first": "name: .hidden\n",
    "name with a line break": 'name: "a\\nb"\n',
    "endless name": f"name: {'a' * 1000}\n",
    "name as a number": "name: 5\n",
    "name as a number of tasks": "name: 5\ntasks: [lamp]\n",
    "name that is empty": "name: ''\n",
    "rounds without end": "rounds: 1000000\n",
    "logs as a list": "logs: [a, b]\n",
    "logs as a number": "logs: 3\n",
    "logs of nobody": "logs: ~nobody-here/logs\n",
    "logs without a name": "logs: ''\n",
    "endless logs": f"logs: {'a' * 10_000}\n",
    "logs with too long a name": f"logs: /{'a' * 300}\n",
    "logs that no file system can name": 'logs: "\\uD800"\n',
    "base that no file system can name": 'base: "./\\uD800"\n',
    "base of nobody": "base: ~nobody-here/x.yaml\n",
    "base unknown": "base: labtop\n",
    "base that is not there": "base: ./gone.yaml\n",
    "base that is a folder": "base: ./\n",
    "base that never ends": "base: /dev/zero\n",
    "base as a list": "base: [laptop, paper]\n",
    "endless base": f"base: ./{'a' * 5000}.yaml\n",
    "base of its own": "base: ./run.yaml\n",
    "section as a number": "record: 3\n",
    "section as a list": "record: [1]\n",
    "section as nothing": "record:\n",
    "unknown section": "recrod: {}\n",
    "unknown key": "record: {demonstration: 3}\n",
    "unknown key far within": "policies: {diffusion: {policy: {head: {denoiser: {widht: 3}}}}}\n",
    "head of an unknown kind": "policies: {mlp_chunked: {policy: {head: {kind: diffusing}}}}\n",
    "policy misspelt": "policies: {difusion: {training: {steps: 3}}}\n",
    "policy that is nothing": "policies: {diffusion: }\n",
    "policies as a list": "policies: [difusion]\n",
    "policies as nothing": "policies:\n",
    "policy without a base": "policies: {mine: {base: difusion}}\n",
    "policy on a list": "policies: {mine: {base: [diffusion]}}\n",
    "policy on itself": "policies: {mine: {base: mine}}\n",
    "policies in a circle": "policies: {a: {base: b}, b: {base: a}}\n",
    "policy with a strange name": 'policies: {"a\\e[2Jb": {base: diffusion}}\n',
    "policy with a dot": "policies: {a.b: {base: diffusion}}\n",
    "policy with an endless name": f"policies: {{{'a' * 150}: {{base: diffusion}}}}\n",
    "thousands of policies": "policies: {" + ", ".join(f"p{i}: {{base: diffusion}}" for i in range(4000)) + "}\n",
    "policy of a task only": "tasks: {lamp: {policies: {difusion: {training: {steps: 3}}}}, one_leg: {}}\n",
    "key of yesterday": "train: {diffusion: {training: {steps: 3}}}\n",
    "key of yesterday in a task": "tasks: {lamp: {train: {diffusion: {training: {steps: 3}}}}}\n",
    "condition misspelt": "flow: study\nconditions: {ta_cii: {}}\n",
    "condition with an unknown policy": "flow: study\nconditions: {mine: {policy: difusion}}\n",
    "condition with an unknown key": "flow: study\nconditions: {mine: {agument: true}}\n",
    "condition that is a number": "flow: study\nconditions: {mine: 3}\n",
    "condition with a strange name": 'flow: study\nconditions: {"a\\nb": {augment: true}}\n',
    "condition with a strange title": 'flow: study\nconditions: {mine: {title: "a\\e[2J|b"}}\n',
    "condition that replays and collects": "flow: study\nconditions: {mine: {replay: true, collect: true}}\n",
    "condition with rounds for nothing": "flow: study\nconditions: {mine: {rounds: 2}}\n",
    "condition with endless rounds": "flow: study\nconditions: {mine: {collect: true, rounds: 1000000}}\n",
    "conditions of one model": "conditions: [bc]\n",
    "conditions of one model that is not said": "conditions: {mine: {augment: true}}\n",
    "thousands of conditions": "flow: study\nconditions: {"
    + ", ".join(f"c{i}: {{augment: true}}" for i in range(4000))
    + "}\n",
    "head without a kind": "policies: {diffusion: {policy: {head: {widht: 3}}}}\n",
    "mix without policies": "condition: multitask\n"
    "mix: {lamp: {task: lamp, policies: {}}, one_leg: {task: one_leg, policies: {}}}\n",
    "demonstrations beyond their states": "record: {first: 999999}\n",
    "evaluation beyond its states": "evaluate: {first: 999999}\n",
    "collection beyond its states": "collect: {max_episodes: 1000001}\n",
    "lower above upper": "augment: {departures: {a: {lift_m: [2, 1], distance_m: [0, 1], polar_deg: [0, 1], "
    "rotation_deg: 1, step_m: [0, 1], step_deg: [0, 1]}}}\n",
    "no departures": "augment: {departures: {}}\n",
    "thousands of scales": "policies: {diffusion: {policy: {observation: {state: {kind: features, fine_scales_m: ["
    + "0.1, " * 1000
    + "]}}}}}\n",
    "widest U-Net": "policies: {diffusion: {policy: {head: {denoiser: {kind: unet, "
    "channels: [16384, 16384, 16384]}}}}}\n",
}

FLOATS = {
    "augment.min_confidence": "augment: {min_confidence: VALUE}\n",
    "augment.tolerance.position_m": "augment: {tolerance: {position_m: VALUE}}\n",
    "annotate.clearance_m": "annotate: {clearance_m: VALUE}\n",
    "ingest.max_gap_s": "ingest: {max_gap_s: VALUE}\n",
    "select.longest": "select: {longest: VALUE}\n",
    "state_noise.position_m": "state_noise: {kind: physical, position_m: VALUE}\n",
    "learning_rate": "policies: {diffusion: {training: {learning_rate: VALUE}}}\n",
    "weight_decay": "policies: {diffusion: {training: {weight_decay: VALUE}}}\n",
    "ema_decay": "policies: {diffusion: {training: {ema_decay: VALUE}}}\n",
    "clip": "policies: {diffusion: {policy: {observation: {state: {kind: features, clip: VALUE}}}}}\n",
    "fine_scales_m": "policies: {diffusion: {policy: {observation: {state: {kind: features, "
    "fine_scales_m: [0.1, VALUE]}}}}}\n",
    "dropout": "policies: {mlp_chunked: {policy: {head: {kind: mlp, dropout: VALUE}}}}\n",
}
NO_NUMBERS = (".inf", "-.inf", ".nan", "1e999", "1e300", "true", "yes", "'0.1'", "[0.1]", "-1")
COUNTS = {
    "record.demonstrations": "record: {demonstrations: VALUE}\n",
    "record.seed": "record: {seed: VALUE}\n",
    "ingest.min_steps": "ingest: {min_steps: VALUE}\n",
    "augment.num_snippets": "augment: {num_snippets: VALUE}\n",
    "collect.max_steps": "collect: {max_steps: VALUE}\n",
    "select.max_episodes": "select: {max_episodes: VALUE}\n",
    "evaluate.episodes": "evaluate: {episodes: VALUE}\n",
    "training.steps": "policies: {diffusion: {training: {steps: VALUE}}}\n",
    "training.batch_size": "policies: {diffusion: {training: {batch_size: VALUE}}}\n",
    "training.threads": "policies: {diffusion: {training: {threads: VALUE}}}\n",
    "horizons.pred": "policies: {diffusion: {policy: {horizons: {pred: VALUE}}}}\n",
    "blocks": "policies: {mlp_chunked: {policy: {head: {kind: mlp, blocks: VALUE}}}}\n",
    "width": "policies: {mlp_chunked: {policy: {head: {kind: mlp, width: VALUE}}}}\n",
    "channels": "policies: {diffusion: {policy: {head: {denoiser: {kind: unet, channels: [8, 8, VALUE]}}}}}\n",
    "train_timesteps": "policies: {diffusion: {policy: {head: {kind: diffusion, train_timesteps: VALUE}}}}\n",
    "inference_steps": "policies: {diffusion: {policy: {head: {kind: diffusion, inference_steps: VALUE}}}}\n",
    "flow.inference_steps": "policies: {diffusion: {policy: {head: {kind: flow, inference_steps: VALUE}}}}\n",
    "task_embedding": "policies: {diffusion: {policy: {task_embedding: VALUE}}}\n",
}
NO_COUNTS = ("1000000000000", "-1", "true", "1.0", "1e3", "'3'", ".inf", "3:00")

ASSIGNMENTS = {
    "nothing": "",
    "no key": "=3",
    "no value": "seed",
    "empty part": "record..seed=1",
    "dots": "." * 1000 + "=1",
    "a thousand parts": ".".join(["a"] * 1000) + "=1",
    "digits": "seed=" + "9" * 5000,
    "deep": "seed=" + "[" * 100_000,
    "bomb": "seeds=" + BOMB.replace("\n", ", "),
    "tag": "seed=!!python/object/apply:os.system ['true']",
    "truth": "seed=true",
    "infinity": "policies.diffusion.training.learning_rate=.inf",
    "null character": "name=a\0b",
    "escape sequence": "\x1b[2Jseed=1",
    "escape sequence in a value": "name=\x1b[2J",
    "two documents": "seed=1\n---\n2",
    "endless": "name=" + "a" * 1_000_000,
    "into a value": "seed.x=1",
    "path of nobody": "logs=~nobody-here/x",
    "path that is none": "logs=''",
    "unknown": "sede=1",
}


def cases() -> Iterator[tuple[str, str]]:
    yield from TEXTS.items()
    for name, text in FLOATS.items():
        for value in NO_NUMBERS:
            yield f"{name} {value}", text.replace("VALUE", value)
    for name, text in COUNTS.items():
        for value in NO_COUNTS:
            yield f"{name} {value}", text.replace("VALUE", value)


CASES = dict(cases())
# Every kind of mistake and every field once; the rest of the table with -m slow.
QUICK = {*TEXTS, *(f"{name} .nan" for name in FLOATS), *(f"{name} 1000000000000" for name in COUNTS)}


def check_sentence(text: str) -> None:
    assert len(text) < 1200, text[:2000]
    assert not any(unicodedata.category(letter).startswith("C") for letter in text.replace("\x1b", "")), text
    assert "Input should" not in text


def test_there_are_enough_of_them():
    assert len(CASES) + len(ASSIGNMENTS) >= 147


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_hostile_configuration_is_refused_in_a_sentence(name, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text(CASES[name])
    with pytest.raises(ConfigError) as caught:
        load_runs(path)
    check_sentence(str(caught.value))


@pytest.mark.parametrize("name", ASSIGNMENTS)
def test_hostile_assignment_is_refused_in_a_sentence(name):
    with pytest.raises(ConfigError) as caught:
        load_runs("laptop", [ASSIGNMENTS[name]])
    check_sentence(str(caught.value))


def pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize("place", ["run", "base"])
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (pipe, "it is not a plain file"),
        (lambda path: path.symlink_to("/dev/zero"), "it is not a plain file"),
        (lambda path: path.mkdir(), "it is not a plain file"),
        (lambda path: path.symlink_to(path), "cannot be read"),
        (lambda path: path.write_bytes(b"\xff\xfe" + "seed: 1".encode("utf-16-le")), "not UTF-8 text"),
        (lambda path: path.write_bytes(b"name: \xe9"), "not UTF-8 text"),
        (lambda path: path.write_bytes(b"#" * 2_000_000), "larger than"),
        (lambda path: path.open("wb").truncate(2**40), "larger than"),
    ],
)
def test_what_is_no_file_of_text_is_refused_at_once(tmp_path, make, message, place):
    path = tmp_path / "run.yaml"
    if place == "base":
        path.write_text("base: ./base.yaml\n")
        make(tmp_path / "base.yaml")
    else:
        make(path)
    with pytest.raises(ConfigError, match=message) as caught:
        load_runs(path)
    check_sentence(str(caught.value))


def test_content_of_a_form_has_the_same_bounds():
    deep: object = 1
    for _ in range(100_000):
        deep = [deep]
    for content in (
        {"record": {"seed": deep}},
        {"seeds": list(range(100_000))},
        {"record": {1: 2}},
        {"seed": 10**5000},
    ):
        with pytest.raises(ConfigError) as caught:
            parse_runs(content, "the form")
        check_sentence(str(caught.value))


def test_bombs_are_refused_within_400_megabytes(tmp_path):
    for name in ("bomb", "bomb of mappings", "bomb of merges", "deep lists", "thousands of keys", "widest U-Net"):
        (tmp_path / f"{name}.yaml").write_text(TEXTS[name])
    program = (
        "import resource, sys\n"
        "from flows.runs import load_runs\n"
        "from juicer.errors import ConfigError\n"
        "used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()\n"
        "resource.setrlimit(resource.RLIMIT_AS, (used + 400 * 2**20,) * 2)\n"
        "for path in sys.argv[1:]:\n"
        "    try:\n"
        "        load_runs(path)\n"
        "        raise SystemExit(path)\n"
        "    except ConfigError:\n"
        "        pass\n"
    )
    paths = sorted(map(str, tmp_path.glob("*.yaml")))
    result = subprocess.run([sys.executable, "-c", program, *paths], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("text", ["", "# nothing\n", "seed: 3\n", "\ufeffseed: 3\n"])
def test_what_is_harmless_passes(tmp_path, text):
    path = tmp_path / "run.yaml"
    path.write_text(text)
    assert load_runs(path)
