from threading import Event, Thread

import pytest
import torch

from juicer.policy.torch_settings import compute_settings, has_fast_bfloat16


def settings():
    return torch.get_num_threads(), torch.get_float32_matmul_precision()


def test_settings_hold_inside_and_are_put_back_even_after_an_error():
    before = settings()

    def fail_inside():
        with compute_settings(threads=1, matmul_precision="medium"):
            assert settings() == (1, "medium")
            raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fail_inside()
    assert settings() == before


def test_settings_within_settings_hold_and_those_around_them_return():
    with compute_settings(threads=1, matmul_precision="medium"):
        with compute_settings(threads=1, matmul_precision="highest"):
            assert torch.get_float32_matmul_precision() == "highest"
        assert torch.get_float32_matmul_precision() == "medium"


def test_settings_of_two_threads_neither_mix_nor_remain():
    before, found = settings(), []
    first_is_in, second_is_in = Event(), Event()

    def second():
        first_is_in.wait()
        with compute_settings(threads=1, matmul_precision="high"):
            second_is_in.set()
            found.append(torch.get_float32_matmul_precision())
            first.join()

    def first_of_both():
        with compute_settings(threads=1, matmul_precision="medium"):
            first_is_in.set()
            second_is_in.wait(0.2)
            found.append(torch.get_float32_matmul_precision())

    first, other = Thread(target=first_of_both), Thread(target=second)
    for thread in (first, other):
        thread.start()
    other.join()
    assert found == ["medium", "high"]
    assert settings() == before


def test_the_processor_is_asked_about_bfloat16():
    assert has_fast_bfloat16() in (True, False)
