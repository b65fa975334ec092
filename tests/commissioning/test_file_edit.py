"""A press file with values written anew: byte for byte what it was, elsewhere."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.commissioning.file_edit import Edit, edited, write_edits
from prooflight.errors import PressFileError
from prooflight.press.press_file import TWO_SENSORS, PressFile

TEXT = PressFile.prototype().text
OWN = """\
# Press 3, hall B.  Ask Maria before you change anything!

[lens]      # the Rodagon, bought 2019
focal_length_mm   = 60.0
f_number=2.8   # engraved
object_distance_mm = 546.6\t# assumed: by eye

# --- what follows is of the chip ---
[[sensor]]
name = "left"
read_noise_e = 30.0                # measured 2024-03-01: +- 2
note = '''
[lens]
object_distance_mm = 1
'''

  [[sensor]]   # the second
  name = "right"
  read_noise_e = 31.0  # Maria: do not trust

# the end
"""


def edit(block: str, field: str, value: object, why: str = "measured: now", number: int = 0) -> Edit:
    return Edit(block=block, field=field, value=value, why=why, number=number)


def changed(before: str, after: str) -> list[tuple[str, str]]:
    """Pairs of lines that differ; as many lines before as after."""
    old, new = before.split("\n"), after.split("\n")
    assert len(old) == len(new)
    return [pair for pair in zip(old, new, strict=True) if pair[0] != pair[1]]


def test_only_the_lines_of_its_values_change() -> None:
    found = edited(
        OWN,
        [
            edit("lens", "object_distance_mm", 501.25),
            edit("sensor", "read_noise_e", 28.5),
            edit("sensor", "read_noise_e", 27.5, number=1),
            edit("lens", "f_number", 4.0),
        ],
    )
    assert changed(OWN, found) == [
        ("f_number=2.8   # engraved", "f_number=4.0   # engraved"),
        ("object_distance_mm = 546.6\t# assumed: by eye", "object_distance_mm = 501.25  # measured: now"),
        (
            "read_noise_e = 30.0                # measured 2024-03-01: +- 2",
            "read_noise_e = 28.5                # measured: now",
        ),
        ("  read_noise_e = 31.0  # Maria: do not trust", "  read_noise_e = 27.5  # Maria: do not trust"),
    ]


def test_what_a_user_wrote_stays_and_what_would_be_untrue_goes() -> None:
    found = edited(TEXT, [edit("sensor", "dsnu_e", 38.25, "measured: +- 0.5")])
    ((old, new),) = changed(TEXT, found)
    assert old == "dsnu_e = 40.0                      # assumed: the size of the read noise"
    assert new == "dsnu_e = 38.25                     # measured: +- 0.5"


def test_new_values_stand_below_their_heading_and_new_blocks_at_the_end() -> None:
    found = edited(
        OWN,
        [
            edit("sensor", "bits", 12, number=1),
            edit("lens", "transmittance", 0.9),
            edit("transport", "speed_mm_s", 292.0),
            edit("transport", "binning_along", 2),
        ],
    )
    lines = found.split("\n")
    assert (
        lines[lines.index("[lens]      # the Rodagon, bought 2019") + 1]
        == "transmittance = 0.9  # measured: now"
    )
    assert lines[lines.index("  [[sensor]]   # the second") + 1] == "bits = 12  # measured: now"
    assert found.endswith(
        "# the end\n\n[transport]\nbinning_along = 2  # measured: now\nspeed_mm_s = 292.0  # measured: now\n"
    )
    kept = [line for line in lines if line not in set(found.split("\n")) - set(OWN.split("\n"))]
    assert "\n".join(kept).startswith(OWN.rstrip("\n"))


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@given(
    value=st.floats(1e-3, 1e6, allow_nan=False),
    field=st.sampled_from(["read_noise_e", "dsnu_e", "prnu_percent", "black_level_dn"]),
    preset=st.sampled_from(["prototype.toml", TWO_SENSORS, "rgb-line.toml"]),
    last=st.booleans(),
)
def test_every_other_byte_of_a_press_file_stays(
    ending: str, value: float, field: str, preset: str, last: bool
) -> None:
    text = PressFile.preset(preset).text.replace("\n", ending)
    sensors = tomllib.loads(text)["sensor"]
    number = len(sensors) - 1 if last else 0
    found = edited(text, [edit("sensor", field, value, number=number)])
    old, new = text.split(ending), found.split(ending)
    assert len(old) == len(new)
    differ = [at for at, (one, other) in enumerate(zip(old, new, strict=True)) if one != other]
    assert len(differ) == (sensors[number][field] != value)
    for at in differ:
        assert new[at].startswith(f"{field} = ")
    wanted = tomllib.loads(text)
    wanted["sensor"][number][field] = value
    assert tomllib.loads(found) == wanted


def test_what_is_so_already_is_not_touched() -> None:
    assert edited(TEXT, [edit("sensor", "bits", 12)]) == TEXT


@pytest.mark.parametrize("text", ["lens = { f_number = 2.8 }\n", "lens.f_number = 2.8\n"])
def test_a_block_without_a_heading_can_be_changed_and_not_added_to(text: str) -> None:
    assert tomllib.loads(edited(text, [edit("lens", "f_number", 4.0)])) == {"lens": {"f_number": 4.0}}
    with pytest.raises(ValueError, match=r"lens\.focal_length_mm cannot be written where lens"):
        edited(text, [edit("lens", "focal_length_mm", 60.0)])


def test_a_sensor_that_is_not_there_is_none_to_write() -> None:
    with pytest.raises(ValueError, match=r"there is no sensor\.3"):
        edited(TEXT, [edit("sensor", "bits", 12, number=2)])


def test_a_file_is_written_whole_and_valid_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_bytes(TEXT.encode())
    after = write_edits(path, [edit("sensor", "read_noise_e", 12.5)])
    assert after.camera().sensors[0].read_noise_e == 12.5
    assert PressFile.read(path).text == after.text
    before = path.read_bytes()
    for bad in (
        edit("sensor", "read_noise_e", -1.0),
        edit("lens", "colour", 1),
        edit("lens", "object_distance_mm", 61.0),
    ):
        with pytest.raises(PressFileError, match=r"my\.toml: "):
            write_edits(path, [bad])
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["my.toml"]
