"""What colour jitter and blur of training images cost: on the training device, and in OpenCV as workers would do it.

Both do the same: a matrix on the colours, then a blur with a kernel of 5, each with a draw a sample. OpenCV is no
dependency; where it is not installed (``pip install opencv-python-headless``), only ours is measured.

    python benchmarks/image_augmentation.py [--device cpu] [--batch 64]
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable
from statistics import median

import numpy as np
import torch

from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.policy.image_augmentation.network import augmented

SIZES = (96, 128, 224)
REPETITIONS = 9


def milliseconds_an_image(work: Callable[[], object], images: int, device: str) -> float:
    """Median time of one image: of the processor, which other programs do not lengthen, or of the device."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    times = []
    for _ in range(REPETITIONS):
        started = clock()
        work()
        if device != "cpu":
            torch.cuda.synchronize()
        times.append(clock() - started)
    return 1e3 * median(times) / images


def by_opencv(images: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """The same with OpenCV, image by image: to one thread what a worker is."""
    cv2 = importlib.import_module("cv2")
    cv2.setNumThreads(1)
    changed = []
    for image in images:
        matrix = np.column_stack([np.eye(3) + 0.1 * rng.standard_normal((3, 3)), 0.1 * image.mean(axis=(0, 1))])
        changed.append(cv2.GaussianBlur(cv2.transform(image, matrix), (5, 5), rng.uniform(0.1, 5)))
    return changed


def main() -> None:
    """Print a line for each size of image."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--batch", type=int, default=64)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    config, rng = ImageAugmentation(), np.random.default_rng(0)
    print("ms an image, one thread of a processor")
    for size in SIZES:
        images = rng.integers(0, 256, size=(arguments.batch, size, size, 3), dtype=np.uint8)
        batch = torch.from_numpy(images)[:, None].to(arguments.device)
        ours = milliseconds_an_image(lambda batch=batch: augmented(batch, config), arguments.batch, arguments.device)
        print(f"{size:4} px  torch on {arguments.device}: {ours:.3f}", end="")
        try:
            theirs = milliseconds_an_image(lambda images=images: by_opencv(images, rng), arguments.batch, "cpu")
            print(f"   OpenCV: {theirs:.3f}")
        except ImportError:
            print("   OpenCV: not installed")


if __name__ == "__main__":
    main()
