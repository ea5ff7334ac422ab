"""Create the S3 buckets named on the command line, unless they are there."""

from __future__ import annotations

import sys

import s3fs


def main(names: list[str]) -> None:
    """Create each bucket; the address and the keys come from AWS's own environment variables."""
    storage = s3fs.S3FileSystem()
    for name in names:
        if not storage.exists(name):
            storage.mkdir(name)


if __name__ == "__main__":
    main(sys.argv[1:])
