import re
from base64 import b64decode
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from prooflight.inks.chart import Chart
from prooflight.inks.selection import choose, cross_validate
from prooflight.reporting.chart_report import histogram, write_chart_report


class Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]


def test_the_report_is_one_file_with_its_figures(built_in_chart: Chart, tmp_path: Path) -> None:
    choice = choose(built_in_chart, folds=3)
    path = tmp_path / "report.html"
    write_chart_report(path, built_in_chart, choice.best, scores=choice.scores, why=choice.why)
    html = path.read_text(encoding="utf-8")
    assert choice.why in html
    assert "102 patches of 100 recipes" in html
    for name, score in choice.scores.items():
        assert re.search(rf"<td>{name}</td>\s*<td>{score.median_delta_e00:.3f}</td>", html)
    reader = Links()
    reader.feed(html)
    assert len(reader.links) == 3
    for link in reader.links:
        head, data = link.split(",", 1)
        assert head == "data:image/png;base64"  # nothing is fetched from elsewhere
        picture = np.asarray(Image.open(BytesIO(b64decode(data))).convert("L"))
        assert picture.std() > 10  # something is drawn
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_file_says_does_not_become_markup(built_in_chart: Chart, tmp_path: Path) -> None:
    trial = cross_validate(built_in_chart, "log-linear", folds=3)
    scores = {trial.model: trial.score}
    write_chart_report(
        tmp_path / "r.html", built_in_chart, trial, scores=scores, why="<script>alert(1)</script>"
    )
    assert "<script>" not in (tmp_path / "r.html").read_text()


def test_the_histogram_counts_every_patch() -> None:
    difference = np.array([0.0, 0.01, 0.01, 0.5, 3.0])
    (axes,) = histogram(difference).axes
    assert sum(bar.get_height() for bar in axes.patches) == 100.0
