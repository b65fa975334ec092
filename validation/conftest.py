"""What is checked against others' numbers needs of the tests' fixtures."""

from tests.conftest import isetcam_camera, oracle, prototype, shared
from tests.pages.conftest import write_pdf

__all__ = ["isetcam_camera", "oracle", "prototype", "shared", "write_pdf"]
