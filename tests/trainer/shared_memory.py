"""A3C's workers share their weights in /dev/shm, which a container may keep from them."""

import os

import pytest

needs_shared_memory = pytest.mark.skipif(
    not os.access("/dev/shm", os.W_OK),
    reason="A3C shares weights in /dev/shm, which cannot be written to here",
)
A3C_PARAM = pytest.param("a3c", marks=needs_shared_memory)
