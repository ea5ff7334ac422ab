"""Room for images is taken before they are written, or none of it."""

from __future__ import annotations

import errno
import os

import numpy as np
import pytest

from juicer.errors import StoreNotWritable
from juicer.storage.room import new_images


def test_a_new_file_has_its_room_and_holds_what_is_written(tmp_path):
    images = new_images(tmp_path / "images", (3, 1000, 1000))
    assert (tmp_path / "images").stat().st_blocks * 512 >= 3_000_000
    images[:] = 7
    images.flush()
    np.testing.assert_array_equal(np.fromfile(tmp_path / "images", np.uint8), 7)


def test_a_full_disk_is_told_before_anything_is_written(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(StoreNotWritable, match=r"images' of 60\.0 MB cannot be written: No space .*; make room there"):
        new_images(tmp_path / "images", (60, 1000, 1000))
    assert not list(tmp_path.iterdir())
