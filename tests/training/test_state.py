import pytest
import torch

from juicer.training.state import STATE_FILE, TrainingState, load_state, save_state, training_identity

STATE = TrainingState(identity="abc", step=7, tensors={"a": torch.randn(3), "b": torch.zeros(())})


def test_a_state_comes_back_as_it_was(tmp_path):
    save_state(tmp_path / "new", STATE)
    loaded = load_state(tmp_path / "new", "abc")
    assert (loaded.identity, loaded.step) == ("abc", 7)
    assert all(torch.equal(loaded.tensors[name], value) for name, value in STATE.tensors.items())


def test_there_is_no_state_in_an_empty_folder(tmp_path):
    assert load_state(tmp_path, "abc") is None


def test_a_kill_while_saving_leaves_the_state_before(tmp_path, monkeypatch):
    def interrupt(descriptor):
        raise KeyboardInterrupt

    save_state(tmp_path, STATE)
    monkeypatch.setattr("juicer.training.state.os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_state(tmp_path, TrainingState(identity="abc", step=8, tensors=STATE.tensors))
    assert load_state(tmp_path, "abc").step == 7


@pytest.mark.parametrize("keep", [0, 5, 100])
def test_a_truncated_state_is_passed_over_with_a_warning(tmp_path, caplog, keep):
    save_state(tmp_path, STATE)
    whole = (tmp_path / STATE_FILE).read_bytes()
    (tmp_path / STATE_FILE).write_bytes(whole[:keep])
    assert load_state(tmp_path, "abc") is None
    assert "starts afresh" in caplog.text


def test_the_identity_follows_every_number_and_every_setting(episodes):
    data, settings = episodes(), {"steps": 5}
    identity = training_identity(data, settings)
    assert identity == training_identity(episodes(), {"steps": 5})
    assert identity != training_identity(data, {"steps": 6})
    data.actions[3, 2] += 1e-6
    assert identity != training_identity(data, settings)
