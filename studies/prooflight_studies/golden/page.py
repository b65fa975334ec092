"""The page ``golden.md``: what inspection against a golden scan finds on real pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight_studies.golden.pairs import KINDS, LEAST_OVERLAP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_studies.golden.figures import GoldenFigures, Outcome


LOOKS = (
    "The test half was looked at three times, so the figures above are a little flattered. First: lighter and darker "
    "were joined, pixels not weighed by their neighbourhood, the threshold from plain counts: 183 of 187 found "
    "(97.9 %) at 0.07 false regions an image. Its misses were seen; those three things were then changed on the tuning "
    "half alone, where the first version had missed nothing. Second: 185 of 187 (98.9 %) at 0.03. Third: the border "
    "that is not judged became 4 pixels everywhere, again on the tuning half; before it was what the interpolation "
    "left over."
)
"""Facts about how the method came to be, which no run can measure again."""


def golden_page(rows: Sequence[GoldenFigures], outcomes: Sequence[Outcome], *, mpx_per_s: float) -> str:
    """The page's text. rows: by method, the last with the halves exchanged; outcomes: of ``rows[-2]``, by image."""
    ours = rows[-2]
    sections = [
        "# Inspection against a golden scan",
        _introduction(ours),
        _methods(rows),
        LOOKS,
        "## By kind of defect\n\n" + _kinds(ours),
        "## What was not right\n\n" + _wrong(outcomes),
        _setting(ours, rows[-1], mpx_per_s),
    ]
    return "\n\n".join(sections) + "\n"


def _introduction(ours: GoldenFigures) -> str:
    return (
        "Made by `prooflight study golden --pairs DIR`; how to inspect so: [how-to](../how-to/golden.md).\n\n"
        "Real scans of circuit boards (DeepPCB; line-scan camera, 48 pixels/mm, made black and white by its makers), "
        "each beside a golden scan of the same design, defects marked by hand with boxes. Pairs are sorted by name; "
        "every second one, from the first, is for tuning, the others are the test half. Everything in the last section "
        "was chosen on the tuning half. A marked defect counts as found if the "
        f"intersection of its box with one that was found is more than {LEAST_OVERLAP} of their union; each box counts "
        "once, and every box that is left is a false region.\n\n"
        f"On the {ours.images} images of the test half: **{ours.found_percent:.1f} % of {ours.marked} marked defects "
        "found** "
        f"(95 % interval {ours.found_95_percent[0]:.1f} to {ours.found_95_percent[1]:.1f}, bootstrap over images) at "
        f"**{ours.false_per_image:.2f} false regions an image** ({ours.false_95_per_image[0]:.2f} to "
        f"{ours.false_95_per_image[1]:.2f}). Goal: 98 % at 0.2."
    )


def _methods(rows: Sequence[GoldenFigures]) -> str:
    lines = [
        "| method | tuned on | images | marked | found % [95 %] | false an image [95 %] | mean overlap |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        low, high = row.found_95_percent
        least, most = row.false_95_per_image
        lines.append(
            f"| {row.method} | {row.tuned_on} | {row.images} | {row.marked} "
            f"| {row.found_percent:.1f} [{low:.1f}-{high:.1f}] "
            f"| {row.false_per_image:.2f} [{least:.2f}-{most:.2f}] | {row.mean_overlap:.2f} |"
        )
    notes = (
        "All are tuned alike, each on the half named, and judged on the other. *Difference, opened*: threshold of the "
        "absolute difference, narrow strips opened away, no placing. *Golden, not placed*: edge tolerance both ways, "
        "but the golden stays where it is. *Golden*: `prooflight inspect --golden`. Its second row has the halves "
        "exchanged; "
        "the method was made with the even half in view, so that row flatters it."
    )
    return "\n".join(lines) + "\n\n" + notes


def _kinds(ours: GoldenFigures) -> str:
    lines = ["| kind | marked | found | mean overlap |", "|---|---|---|---|"]
    lines += [
        f"| {KINDS[kind]} | {marked} | {found} | {much:.2f} |"
        for kind, (marked, found, much) in ours.by_kind.items()
    ]
    return "\n".join(lines)


def _wrong(outcomes: Sequence[Outcome]) -> str:
    lines = []
    for one in outcomes:
        hit = {to for to, _ in one.pairs.values()}
        lines += [
            f"| {one.name} | missed, {KINDS[kind]} | {' '.join(map(str, box))} |"
            for at, (kind, box) in enumerate(zip(one.kinds, one.marked, strict=True))
            if at not in hit
        ]
        lines += [
            f"| {one.name} | false | {' '.join(map(str, box))} |"
            for at, box in enumerate(one.found)
            if at not in one.pairs
        ]
    if not lines:
        return "Nothing: every marked defect was found, and nothing else."
    return "\n".join(["| image | | left top right bottom |", "|---|---|---|", *lines])


def _setting(ours: GoldenFigures, exchanged: GoldenFigures, mpx_per_s: float) -> str:
    lines = ["| | tuned on even | tuned on odd |", "|---|---|---|"]
    lines += [
        f"| {name} | {getattr(ours.setting, field)} | {getattr(exchanged.setting, field)} |"
        for name, field in (
            ("an edge may lie off by [pixels]", "edge_pixels"),
            ("differences this far apart, twice, are one [pixels]", "joining_pixels"),
            ("least volume of a region [pixels from dark to light]", "least_volume"),
            ("margin that the markers left [pixels]", "margin_pixels"),
        )
    ]
    return (
        "## What was tuned\n\n"
        + "\n".join(lines)
        + "\n\nThe margin belongs to these marks and to this study; `inspect --golden` draws its regions tightly. "
        f"Placing and comparing ran at {mpx_per_s:.1f} megapixels of one channel per second of one core."
    )
