"""The words of the sample job's book; markup is reportlab's (``<i>``, ``<super>``)."""

from __future__ import annotations

from dataclasses import dataclass

TITLE = "Ink, Light & Paper"
SUBTITLE = "How a picture gets onto a page"
SERIES = "Press-room readers, number four"
IMPRINT = "Lantern Press"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """One chapter of the book."""

    number: str
    title: str
    summary: str
    """One line for the table of contents."""
    paragraphs: tuple[str, ...]
    note: str
    """The footnote of its first page."""


LIGHT = Chapter(
    number="One",
    title="What paper does with light",
    summary="White, and why no printer owns any",
    paragraphs=(
        "Hold a sheet of good paper up to a window and you will see that it is not white at all. It is a felt of "
        "pale, hollow, nearly transparent fibres, pressed flat while wet and left to dry in one another’s arms. "
        "White is something the sheet does, not something it is. Light enters between the fibres, is bent and "
        "thrown back at every wall it meets, and after a hundred such meetings it has forgotten where it came "
        "from. What leaves the sheet again leaves in every direction at once, and carries all the colours it "
        "arrived with in nearly the old proportions. That is what we call white: light returned in full and "
        "without an address.",
        "Snow, milk, salt and clouds manage it in the same way. None of them contains anything white. Each is a "
        "crowd of small clear things with many surfaces, and it is the crowd that scatters. Pour oil on paper and "
        "the trick fails: the oil fills the gaps, light no longer bends at the walls, and the sheet turns as grey "
        "and glassy as a kitchen window. Papermakers spend their working lives on the opposite of that stain. "
        "They add chalk and clay, whose grains are about as large as a wavelength of light and scatter it best; "
        "they add dyes that swallow a little ultraviolet and give it back as blue, so that the sheet seems "
        "brighter than the lamp above it ought to allow.<super>1</super>",
        "A printer cares about this because nobody prints in white. Every light part of a printed picture is bare "
        "paper, and every colour on the page is what remains of the paper’s own light after ink has taken "
        "something away. The ink film is thin, about a thousandth of a millimetre, a hundredth of the sheet "
        "beneath it. It works as a stained-glass window does: light falls through it, wanders in the paper, and "
        "falls through it again on the way out. The ink is seen twice in one glance. A film that lets half of the "
        "red light pass will let a quarter of it return.",
        "Wandering has a price. A ray that goes in beside a dot of ink may well come out beneath it, a tenth of a "
        "millimetre away, and pay the toll only once. So the edge of a dot is never as hard as the plate that "
        "made it; around each there is a penumbra, a shadow inside the paper, and the tint looks darker than its "
        "area says it should. The effect was given a formula in 1951 by J. A. C. Yule and W. J. Nielsen, and it "
        "still makes up a good part of what press crews call dot gain. The rest of it is simpler: ink is wet, and "
        "when it is squeezed it spreads.",
        "The eye is kind to all this. It has some six million cones in three sorts, and each sort reports only "
        "how much, never which. Set before it a spectrum with hundreds of steps that an instrument could tell "
        "apart, and the cones still send three numbers for each place in the field of view. Everything that "
        "printing has ever achieved with colour rests on that poverty. If three numbers are enough to describe a "
        "colour to the brain, then a handful of inks may be enough to imitate it, and the imitation need not be "
        "like the thing itself at a single wavelength. A printed lemon and a real one reflect different light. "
        "They merely agree about three sums.",
        "There is a limit, and it is set by the darkest and the lightest thing that the sheet can be. Outdoors, on "
        "a clear day, the brightest patch in view may send ten thousand times the light of the deepest shadow. "
        "The best coated paper under the best black ink manages two hundred to one; a newspaper, perhaps twenty. A "
        "photograph on paper is therefore never a copy of a scene but an abridgement of it, and whoever prepares "
        "it must decide, as an editor does, which passages to shorten. That the result can move us at all is the "
        "oldest wonder of the trade.",
    ),
    note="<super>1</super> Under a lamp without ultraviolet the same sheet looks yellowish, which is how two people "
    "can quarrel honestly about a proof at the window and agree about it in the cellar.",
)

INKS = Chapter(
    number="Two",
    title="Four inks",
    summary="Three to make every colour, one to put the shadows right",
    paragraphs=(
        "Early in the eighteenth century Jacob Christoph Le Blon, a painter from Frankfurt who had settled in "
        "Amsterdam, set himself to print pictures from three plates: a blue one, a yellow one and a red one. He "
        "worked in mezzotint, scraping each plate by hand, and he had to guess, tint by tint, how much of each "
        "colour would be wanted when all three lay on top of one another. His best sheets are astonishing. He also "
        "found, as everyone has found since, that three inks make a sorry sort of black, and he took a fourth "
        "plate to put the shadows right. Three and one: the arithmetic has not changed in three centuries, though "
        "his company was ruined by it and his method, for a time, lost.",
        "The modern names are more exact than his. <i>Cyan</i> takes red out of white light and leaves the rest; "
        "<i>magenta</i> takes out green; <i>yellow</i> takes out blue. Lay cyan over yellow, and red and blue are "
        "both gone: green is what survives. Lay all three together and, with inks that exist only in theory, "
        "nothing at all would survive. Real inks are untidy. Magenta steals a good deal of blue along with its "
        "green, cyan some of both, and the sum of the three is a muddy brown that takes hours to dry. So the grey "
        "that all three have in common is lifted out and printed with black instead. Printers call the black plate "
        "the key, because the others are lined up with it; the K in CMYK remembers that.<super>2</super>",
        "A press has no half measures. At any one spot there is ink or there is none, and a pale tint has to be "
        "broken up into dots too small to be noticed. The dots of the four inks are laid at four different "
        "angles. If they were not, the slightest tremor of the sheet would bring them in and out of step, and "
        "broad, slow waves of false colour would wander over the page like the bands in watered silk. Thirty "
        "degrees apart is the distance at which the waves are shortest and least seen. The yellow, which no one "
        "sees sharply anyway, is given the bad seat in between.",
        "None of this belongs to one country, and the words show how it travelled. A French printer puts "
        "<i>encre</i> on <i>papier</i>, a Spanish one <i>tinta</i> on <i>papel</i>; in Prague they say <i>tiskařská "
        "barva</i>, in Warsaw <i>światło</i> is light, in Budapest it is <i>fény</i>, in Reykjavík <i>ljós</i>; "
        "Copenhagen has <i>blæk</i> and Istanbul lays <i>mürekkep</i> on <i>kâğıt</i>. The Greeks are the elders "
        "of the company: χάρτης, a leaf of papyrus, gave us <i>chart</i> and <i>card</i>; μέλαν, “the black”, was "
        "simply ink; and φως is in every φωτογραφία, which is nothing but writing with light. In Russian the craft "
        "is печать, a seal; the sheet is бумага, the ink краска, the light свет. A Bulgarian says хартия, having "
        "the word from the Greeks, a Ukrainian папір, having it from Poland.",
        "When a colour must be exact, and a house’s own orange must, the four are not enough, and a fifth ink is "
        "mixed in a tin and poured into a unit of its own: a spot colour. Where black lettering crosses it, the "
        "black is overprinted, laid on top without a hole cut beneath it, because a hole would have to meet the "
        "letter to within a few hundredths of a millimetre, and paper, which swells when it is damp and stretches "
        "when it is pulled, keeps no such promise. Much of a printer’s craft is the art of hiding small errors "
        "before they occur.",
    ),
    note="<super>2</super> It is also said to keep K from being taken for B, which a hurried compositor might read "
    "as blue. Both stories are told in good faith.",
)

RUN = Chapter(
    number="Three",
    title="A run of one",
    summary="What becomes of proofreading when no two sheets are alike",
    paragraphs=(
        "For five hundred years printing meant repetition. The first copy was dear and all the others were nearly "
        "free, and so the first copy was looked at with great care. Somebody pulled it from the press, carried it "
        "to the light, put it beside the proof and went over it with a glass. If it was good, so were the ten "
        "thousand behind it; from then on it was enough to take out a sheet now and again and see that nothing "
        "had drifted. One sheet that everyone agreed on, signed, dated and kept in a drawer, stood for the whole "
        "edition.",
        "A digital press has no plate. The image is made afresh for every turn of the drum, from numbers, and may "
        "be different each time. That opened doors: a school book in four hundred copies and then forty more, an "
        "album for one grandmother, an invoice with your name on it, a catalogue that knows what you bought last "
        "year. It also closed one. If no two sheets are alike, there is no good sheet to hold the others against. "
        "The proof has gone. What is left is the list of numbers from which the page was made.<super>3</super>",
        "Suppose, then, that somebody learns the press by heart: how each mixture of its inks looks on this paper, "
        "under that lamp, through such a lens, and how widely the readings scatter when nothing at all is wrong. "
        "From the numbers of the page one can then say, before the sheet has been printed, what a camera over the "
        "paper path ought to see at every point, and how sure one is of it. The sheet comes by at the pace of a "
        "brisk walk, the camera reads it line by line, and what it reads is set against what was foretold. Where "
        "the two disagree by more than the noise can excuse, something has happened to the page.",
        "Most of what can happen is undramatic. A nozzle dries, and leaves a pale scratch a hair’s breadth wide "
        "from the top of the sheet to the bottom. A drop of something falls. One ink runs low, and the faces in a "
        "wedding album turn faintly green over the course of an hour. A belt slips, and a colour lands a fifth of "
        "a millimetre from where it should. A lump of toner, a fold, a thread, a page that belongs to someone "
        "else’s letter. The machine minds none of these, and the customer minds them all.",
        "So the question is never only whether a page is faulty. It is what to do when one is not certain. Throw "
        "away too many good pages and the press earns nothing; let too many bad ones go and, sooner or later, a "
        "bank statement reaches the wrong door. The two mistakes have different prices, and the prices change with "
        "the job. A careful inspector, human or otherwise, weighs them both, says what was decided, and says how "
        "doubtful the decision was. By then the next sheet is already under the lens.",
        "There is one more thing to be said for looking closely. If you have a magnifying glass, put it on the "
        "picture on the cover. The galaxies dissolve. What remains is a meadow of cyan, magenta, yellow and black, "
        "no two flowers quite alike, laid down in a fraction of a second by a machine that had never seen them "
        "before and will not see them again. Take the glass away, and the sky comes back. Nobody put it there but "
        "you.",
    ),
    note="<super>3</super> Numbers do not fade, which the sheet in the drawer always did, from the edges inwards.",
)

CHAPTERS = (LIGHT, INKS, RUN)

GLOSSARY: tuple[tuple[str, str], ...] = (
    (
        "Banding",
        "Stripes across the travel of the sheet where a smooth tint was meant, from a drum, a gear or a row "
        "of nozzles that does not keep time. The eye is cruel to stripes and finds one part in two hundred.",
    ),
    (
        "Bleed",
        "Picture that runs over the edge of the finished page, so that a careless knife leaves no white line.",
    ),
    (
        "Cockle",
        "Paper that has taken up water unevenly and lies in small waves. A camera sees the waves as light and "
        "shade and may take them for ink.",
    ),
    (
        "Coverage",
        "The part of the paper that a dot pattern hides, in per cent. Four full inks on one spot would make "
        "400; few sheets stay dry above 320.",
    ),
    (
        "Density",
        "The logarithm of the light withheld. A density of one sends back a tenth, of two a hundredth. Inks "
        "add in density, very nearly, which is why printers think in it.",
    ),
    (
        "Dot gain",
        "The difference between the tint that was asked for and the one that is seen; greatest in the middle "
        "tones, where dots have the most edge.",
    ),
    (
        "Drum",
        "The roller that carries the sheet. On some presses it is the only part that knows exactly where the "
        "sheet is.",
    ),
    (
        "Full black",
        "Black with other inks beneath it, deeper than black alone and slower to dry. Used under large "
        "flats; a mistake under small type.",
    ),
    ("Ghost", "A faint second image, left by a roller that remembers the turn before."),
    (
        "Gloss",
        "Light thrown back by the surface before it has met any ink. It carries no colour, and a lamp is put "
        "where the camera does not see it.",
    ),
    (
        "Grey balance",
        "The recipe of cyan, magenta and yellow that looks neutral. Cyan must lead; equal parts make "
        "brown. The first thing to go when one ink is short.",
    ),
    (
        "Halftone",
        "A picture broken into dots of one strength and many sizes, or of one size and many spacings.",
    ),
    ("Key", "The black plate."),
    (
        "Knock-out",
        "A hole left in one ink in the shape of another, so that the two do not mix. It asks for good "
        "register.",
    ),
    (
        "Line camera",
        "A camera one line tall. The motion of the paper supplies the second dimension of the picture, "
        "and any unevenness of that motion as well.",
    ),
    ("Metamers", "Two colours that match under one lamp and part company under another."),
    (
        "Moiré",
        "The slow pattern that two fine patterns make together. On a page it is a fault; on silk one pays for "
        "it.",
    ),
    (
        "Noise",
        "The part of a measurement that would be different if it were made again. It has no cause worth "
        "repairing, only a size worth knowing.",
    ),
    ("Overprint", "To lay one ink on another without a hole between them."),
    (
        "Proof",
        "A sheet made to be agreed on. It proves what the maker meant; the press must still prove that it can "
        "follow.",
    ),
    (
        "Register",
        "The agreement of the inks about where the page is. A tenth of a millimetre is respectable, a fifth "
        "is visible, a half is a refund.",
    ),
    ("Screen angle", "The direction in which the dots of one ink march."),
    ("Set-off", "Wet ink that a sheet leaves on the back of the one above it. It is always somebody’s face."),
    (
        "Show-through",
        "Print on the other side, seen through the paper. Opacity costs weight, and weight costs postage.",
    ),
    ("Spot colour", "An ink mixed to be one colour and no other, printed from a unit of its own."),
    (
        "Streak",
        "A line along the travel of the sheet, dark or pale, that stays in its place from page to page. The "
        "signature of one nozzle, one scratch or one speck of dust.",
    ),
    ("Substrate", "What one prints on, said at the price of paper plus ten per cent."),
    (
        "Trap",
        "A hair’s breadth of overlap between two neighbours, so that a small slip shows as a dark line and not "
        "as a white one.",
    ),
    ("Void", "A place that should have taken ink and did not: a grain of dust, a dent, a drop that missed."),
)

COLOPHON = (
    "Set in STIX General, which the STIX Project published under the SIL Open Font License, with DejaVu Sans for "
    "tables and labels. Printed in four process colours, and on one page a fifth, from pages that were never proofed: "
    "each was foretold from its own numbers and compared as it passed.",
    "Photographs: eXtreme Deep Field and portrait of Eileen Collins, NASA; rocket with DSCOVR, SpaceX; coffee, Rachel "
    "Michetti; cat and clock, Stefan van der Walt; photographer, Lav Varshney; retina, Mikael Häggström; coins from "
    "Pompeii, Brooklyn Museum; brick and gravel, CC0Textures; grass, linolafett. All are in the public domain, under "
    "CC0 or without known restrictions, and come with scikit-image.",
    "The people, firms, prices and accounts in the commercial pages of this job are invented. No account can be paid "
    "into and no bean can be bought.",
)
