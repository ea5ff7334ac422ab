import pytest
import torch

from juicer.policy.torch_settings import compute_settings, has_fast_bfloat16


def test_settings_hold_inside_and_are_put_back_even_after_an_error():
    before = torch.get_num_threads(), torch.get_float32_matmul_precision()

    def fail_inside():
        with compute_settings(threads=1, matmul_precision="medium"):
            assert (torch.get_num_threads(), torch.get_float32_matmul_precision()) == (1, "medium")
            raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fail_inside()
    assert (torch.get_num_threads(), torch.get_float32_matmul_precision()) == before


def test_the_processor_is_asked_about_bfloat16():
    assert has_fast_bfloat16() in (True, False)
