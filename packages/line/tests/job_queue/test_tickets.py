"""Tickets: what they say is read, and what is wrong is refused in one line that names file, line and element."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from prooflight.errors import InputError
from prooflight_line.job_queue.tickets.reading import read_ticket
from prooflight_line.job_queue.tickets.ticket import Ticket, layout_with

if TYPE_CHECKING:
    from pathlib import Path

XJDF = """<?xml version="1.0" encoding="UTF-8"?>
<XJDF xmlns="http://www.CIP4.org/JDFSchema_2_0" JobID="J-17" Types="Product" Version="2.1" DescriptiveName="Menu">
  <AuditPool><AuditCreated><Header DeviceID="office" Time="2026-11-27T10:00:00Z"/></AuditCreated></AuditPool>
  <GeneralID IDUsage="prooflight:layout" IDValue="gutter=4,pages-a-set=8"/>
  <GeneralID IDUsage="prooflight:keep" IDValue="all"/>
  <GeneralID IDUsage="prooflight:sample" IDValue="0.05"/>
  <GeneralID IDUsage="CostCentre" IDValue="12"/>
  <ProductList>
    <Product Amount="250" IsRoot="true">
      <Intent Name="LayoutIntent"><LayoutIntent Sides="TwoSidedHeadToHead" NumberUp="2 1"/></Intent>
    </Product>
  </ProductList>
  <ResourceSet Name="CustomerInfo"><Resource><CustomerInfo CustomerID="Bistro"/></Resource></ResourceSet>
  <ResourceSet Name="Media" Usage="Input">
    <Resource Brand="Gloss Art"><Media MediaType="Paper" Weight="135"/></Resource>
  </ResourceSet>
  <ResourceSet Name="RunList" Usage="Input">
    <Resource><RunList><FileSpec URL="menu%20of%20today.pdf"/></RunList></Resource>
  </ResourceSet>
</XJDF>
"""
JDF = """<JDF xmlns="http://www.CIP4.org/JDFSchema_1_1" ID="n1" JobID="J-17" Type="Combined" Status="Waiting"
    Version="1.7" DescriptiveName="Menu">
  <GeneralID IDUsage="prooflight:keep" IDValue="none"/>
  <ResourcePool>
    <CustomerInfo ID="r0" Class="Parameter" Status="Available" CustomerID="Bistro"/>
    <RunList ID="r1" Class="Parameter" Status="Available">
      <LayoutElement><FileSpec URL="menu.pdf"/></LayoutElement>
    </RunList>
    <LayoutPreparationParams ID="r2" Class="Parameter" Status="Available" NumberUp="2 2" Sides="TwoSidedFlipY"/>
    <Media ID="r3" Class="Consumable" Status="Available" MediaType="Paper" Brand="Gloss Art" Weight="135"/>
    <Component ID="r4" Class="Quantity" Status="Unavailable" ComponentType="FinalProduct"/>
  </ResourcePool>
  <ResourceLinkPool>
    <RunListLink rRef="r1" Usage="Input"/>
    <ComponentLink rRef="r4" Usage="Output" Amount="250"/>
  </ResourceLinkPool>
</JDF>
"""


def ticket(folder: Path, text: str | bytes, name: str = "order.xjdf") -> Ticket:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_ticket(path)


def test_xjdf_is_read(tmp_path: Path) -> None:
    assert ticket(tmp_path, XJDF) == Ticket(
        job_id="J-17",
        name="Menu",
        customer="Bistro",
        file="menu of today.pdf",
        copies=250,
        layout="sides=2,n-up=2x1,gutter=4,pages-a-set=8",
        brand="Gloss Art",
        weight_gsm=135.0,
        keep="all",
        sample=0.05,
    )


def test_jdf_is_read(tmp_path: Path) -> None:
    assert ticket(tmp_path, JDF, "order.jdf") == Ticket(
        job_id="J-17",
        name="Menu",
        customer="Bistro",
        file="menu.pdf",
        copies=250,
        layout="sides=2,n-up=2x2",
        brand="Gloss Art",
        weight_gsm=135.0,
        keep="none",
    )


def test_intents_of_jdf_state_values_in_elements(tmp_path: Path) -> None:
    intents = """<JDF xmlns="http://www.CIP4.org/JDFSchema_1_1" ID="n1" Type="Product" Status="Waiting" Version="1.4">
      <ResourcePool>
        <LayoutIntent ID="r1" Class="Intent" Status="Available" Sides="OneSided">
          <NumberUp Preferred="2 1"/>
        </LayoutIntent>
        <MediaIntent ID="r2" Class="Intent" Status="Available">
          <Weight Preferred="90" Actual="80"/><StockBrand Preferred="Plain"/>
        </MediaIntent>
      </ResourcePool></JDF>"""
    assert ticket(tmp_path, intents, "a.jdf") == Ticket(
        job_id="n1", layout="sides=1,n-up=2x1", brand="Plain", weight_gsm=80.0
    )


def test_encodings_and_a_prefix_are_read(tmp_path: Path) -> None:
    prefixed = (
        XJDF.replace("<", "<x:").replace("<x:/", "</x:").replace("<x:?", "<?").replace("xmlns=", "xmlns:x=")
    )
    assert ticket(tmp_path, prefixed) == ticket(tmp_path, XJDF)
    assert ticket(tmp_path, XJDF.replace("UTF-8", "UTF-16").encode("utf-16")) == ticket(tmp_path, XJDF)


@pytest.mark.parametrize(
    ("of", "old", "new", "said"),
    [
        (XJDF, 'JobID="J-17" ', "", "order.xjdf, line 2, XJDF: has no JobID; state its JobID"),
        (XJDF, 'Version="2.1"', 'Version="3.0"', "line 2, XJDF: is of version 3.0; send XJDF 2.x"),
        (XJDF, 'Amount="250"', 'Amount="ten"', "line 9, Product: Amount is 'ten'; give a whole number from 1"),
        (XJDF, 'Amount="250"', 'Amount="0"', "give a whole number from 1"),
        (XJDF, 'Amount="250"', 'Amount="1e3000"', "Amount is '1e3000'"),
        (XJDF, "TwoSidedHeadToHead", "OneSidedBack", "line 10, LayoutIntent: Sides is 'OneSidedBack'"),
        (XJDF, '"2 1"', '"two"', "NumberUp is 'two'; give columns and rows"),
        (XJDF, '"2 1"', '"0 1"', "layout: n-up is '0x1'; write n-up=2x1"),
        (XJDF, "gutter=4", "gutter=wide", "layout: gutter is 'wide'; write gutter=5 or 5x3"),
        (XJDF, "gutter=4", "sides=1", "prooflight:layout states sides=1, and the ticket sides=2; state it once"),
        (XJDF, "prooflight:keep", "prooflight:kepe", "prooflight:kepe is none of prooflight:layout"),
        (XJDF, 'IDValue="0.05"', 'IDValue="5 %"', "sample is '5 %'; give a share from 0 to 1"),
        (XJDF, 'Weight="135"', 'Weight="-1"', "Weight is '-1'; give 10 to 2000 g/m2"),
        (XJDF, "menu%20of%20today.pdf", "../other.pdf", "FileSpec: names ../other.pdf, outside this folder"),
        (XJDF, "menu%20of%20today.pdf", "file:///etc/passwd", "names file:///etc/passwd, outside"),
        (XJDF, "menu%20of%20today.pdf", "a%2F..%2F..%2Fb.pdf", "outside this folder"),
        (XJDF, "menu%20of%20today.pdf", "http://host/a.pdf", "outside this folder"),
        (XJDF, "menu%20of%20today.pdf", "order.xjdf", "which is a ticket"),
        (XJDF, '<Resource Brand="Gloss Art">', "<Resource><Part/><GeneralID/>", "line 15, GeneralID: has no IDUsage"),
        (XJDF, '<ResourceSet Name="Media"', '<ResourceSet Name="Layout"', "Media: is in Resource of Layout"),
        (XJDF, '<ProductList>', '<Product/><ProductList>', "Product: is not allowed in XJDF"),
        (XJDF, '  <ProductList>', '<ResourceSet Name="A"/><ProductList>', "ProductList: comes after ResourceSet"),
        (XJDF, "</XJDF>", "", "is not XML"),
        (XJDF, "JDFSchema_2_0", "JDFSchema_9", "is not a ticket: http://www.CIP4.org/JDFSchema_9"),
        (JDF, 'ID="n1" ', "", "JDF: has no ID"),
        (JDF, 'Version="1.7"', "", "is of version none; send JDF 1.x"),
        (JDF, 'rRef="r1"', 'rRef="r9"', "RunListLink: refers to r9, which does not exist"),
        (JDF, 'Class="Consumable" ', "", "Media: has no Class"),
        (JDF, 'NumberUp="2 2"', 'PageDistributionScheme="Saddle"', "distributes pages by Saddle"),
        (JDF, '<LayoutElement>', '<LayoutElement><FileSpec URL="b.pdf"/>', "states file menu.pdf, and line 7 b.pdf"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_in_one_line(tmp_path: Path, of: str, old: str, new: str, said: str) -> None:
    assert old in of
    with pytest.raises(InputError) as refused:
        ticket(tmp_path, of.replace(old, new, 1))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith("order.xjdf")


def test_imposition_that_is_not_read_is_refused_unless_ours_stands_beside_it(tmp_path: Path) -> None:
    imposed = XJDF.replace("</XJDF>", '<ResourceSet Name="BinderySignature"/></XJDF>')
    assert ticket(tmp_path, imposed).layout.startswith("sides=2")
    with pytest.raises(InputError, match="imposes pages by BinderySignature"):
        ticket(tmp_path, imposed.replace('IDUsage="prooflight:layout"', 'IDUsage="Other"'))


def test_nothing_is_loaded_and_nothing_grows(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    for doctype in (
        '<!DOCTYPE XJDF [<!ENTITY a SYSTEM "secret">]>',
        '<!DOCTYPE XJDF SYSTEM "http://127.0.0.1:9/xjdf.dtd">',
        '<!DOCTYPE XJDF [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    ):
        text = XJDF.replace("<XJDF", f"{doctype}<XJDF", 1).replace("J-17", "&a;")
        for data in (text.encode(), text.replace("UTF-8", "UTF-16").encode("utf-16")):
            with pytest.raises(InputError, match="declares a document type"):
                ticket(tmp_path, data)
    with pytest.raises(InputError, match="larger than 2 MB"):
        ticket(tmp_path, XJDF + " " * 2_000_000)
    with pytest.raises(InputError, match="more than 20000 elements"):
        ticket(tmp_path, XJDF.replace("<ProductList>", "<ProductList>" + "<Product/>" * 20_000))
    deep = XJDF.replace("<Resource>", "<Resource>" + "<a>" * 5000, 1)
    with pytest.raises(InputError, match="is not XML"):
        ticket(tmp_path, deep)


def test_a_file_may_be_named_by_its_whole_path(tmp_path: Path) -> None:
    whole = XJDF.replace("menu%20of%20today.pdf", (tmp_path / "menu.pdf").as_uri())
    assert ticket(tmp_path, whole).file == "menu.pdf"


def test_the_ticket_s_words_count_before_the_press_s() -> None:
    assert layout_with("", None) is None
    assert layout_with("", "sides=2,order=loop:4") == "sides=2,order=loop:4"
    assert layout_with("sides=2,n-up=2x1", None) == "sides=2,n-up=2x1"
    assert layout_with("sides=1", "sides=2,order=loop:4,backs=turned,gutter=3") == "sides=1,gutter=3"
