"""The charts of the tests of inks."""

from tests.inks.conftest import built_in_chart, chart_text, measured_chart, offset_chart, recipes_100

__all__ = ["built_in_chart", "chart_text", "measured_chart", "offset_chart", "recipes_100"]
