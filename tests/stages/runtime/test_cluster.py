"""A stage call travels to a worker as data, and makes there what it would have made here."""

from __future__ import annotations

import pickle
import threading
from dataclasses import replace

import pytest

from juicer.errors import ForeignCode
from stages.runtime.cluster import Order
from stages.runtime.context import SilentDisplay, StageInterrupted


def travelled(toys, session, call):
    """An order as a worker gets it."""
    return pickle.loads(pickle.dumps(Order(call, session, toys.open_store)))


def execute(order, stop=None):
    return order.execute(SilentDisplay(), stop or threading.Event())


def test_what_travels_is_small_and_holds_no_session(toys, session):
    order = Order(toys.write.prepare(session, config=toys.ToyConfig()), session, toys.open_store)
    assert len(pickle.dumps(order)) < 20_000
    assert "stage" not in vars(pickle.loads(pickle.dumps(order)).call)


def test_a_worker_makes_the_artifact_in_the_store_of_the_run(toys, session, store):
    call = toys.write.prepare(session, config=toys.ToyConfig(words=3))
    made = execute(travelled(toys, session, call))
    assert (made.ref, made.reused) == (call.recipe.ref, False)
    assert store.manifest(made.ref).summary["words"] == 3
    assert toys.write(session, config=toys.ToyConfig(words=3)) == made.ref


def test_a_stage_that_is_forced_here_is_forced_there(toys, session, store):
    ref = toys.write(session, config=toys.ToyConfig())
    before = store.manifest(ref)
    call = toys.write.prepare(session, config=toys.ToyConfig())
    assert execute(travelled(toys, session, call)).reused
    forced = replace(session, forced=frozenset({"write"}), fresh=set())
    assert not execute(travelled(toys, forced, call)).reused
    assert store.manifest(ref) != before


def test_a_worker_with_other_code_refuses(toys, session, store):
    call = toys.write.prepare(session, config=toys.ToyConfig())
    call.recipe.modules["toys.simple"] = "of yesterday"
    with pytest.raises(ForeignCode, match=r"stage 'write' would run other code"):
        execute(travelled(toys, session, call))
    assert store.refs() == []


def test_an_error_comes_back_even_if_it_cannot_be_pickled(toys, session):
    call = toys.crash.prepare(session, config=toys.ToyConfig())
    with pytest.raises(RuntimeError, match=r"(?s)ValueError\('odd'\).*In the process of stage 'crash'") as caught:
        execute(travelled(toys, session, call))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    assert caught.value.__context__ is None


def test_a_worker_that_is_told_to_stop_leaves_nothing(toys, session, store):
    stop = threading.Event()
    threading.Timer(0.5, stop.set).start()
    with pytest.raises(StageInterrupted):
        execute(travelled(toys, session, toys.dawdle.prepare(session, config=toys.ToyConfig())), stop)
    assert store.refs() == []
