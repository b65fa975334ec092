"""How worker processes are set; in one of their own, since it is for good."""

from __future__ import annotations

import subprocess
import sys

SETTLED = """
from prooflight.pages.process import settle_process
settle_process()
import cv2
from threadpoolctl import threadpool_info
found = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
assert found and set(found) == {1}, found
assert cv2.getNumThreads() == 1
"""


def test_pages_share_the_cores_and_libraries_start_no_threads() -> None:
    subprocess.run([sys.executable, "-c", SETTLED], check=True, timeout=120)
