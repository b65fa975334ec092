"""What is checked against others' numbers needs of the tests' fixtures."""

from tests.pages.conftest import write_pdf

__all__ = ["write_pdf"]
