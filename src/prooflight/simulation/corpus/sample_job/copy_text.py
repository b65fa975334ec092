"""Captions, articles and advertising copy of the pages that are not the book."""

from __future__ import annotations

from prooflight.simulation.corpus.sample_job import inks, quay

RETINA = (
    "A healthy left eye, seen through its own pupil. The pale disc is where a million fibres leave for the brain, "
    "carrying the three sums of every place in view; the darker patch to the side of it holds the fovea, a third of a "
    "millimetre across, with which you are reading this line. Everything a press does is done for the "
    "benefit of an area that would fit on a comma."
)

CAT_CAPTION = "Chelsea, by Stefan van der Walt. The whiskers are about one halftone dot wide."

CAT = (
    "Give a new press a chart of twelve hundred colour patches and it will tell you a great deal about itself. Give "
    "it a cat and you will find out whether it can print. Fur is the least forgiving of ordinary subjects. It has no "
    "flat areas for the eye to rest on and no outlines for it to forgive; it is nothing but edges, each with a light "
    "side and a dark one, and most of them narrower than the dots that have to draw them.",
    "Look at the bridge of the nose. The hairs there are short, they all point one way, and they change from ginger to "
    "cream within a finger’s width. If cyan sits a tenth of a millimetre too low, the cream goes faintly green on one "
    "side of every stripe and faintly pink on the other. Nobody will say that the register is out. They will say that "
    "the cat looks unwell.",
    "Then the eyes. An iris is a smooth bowl of yellow and green that darkens towards its rim, and a smooth bowl is "
    "where a press shows its steps. A blocked nozzle that would pass unseen in the fur draws a line through it as "
    "straight as a ruled margin. The bright spot in the pupil is the window of the room, and it is bare paper: the "
    "only place in the picture where nothing has been printed, and the place one looks at first.",
    "The ginger itself is a memory colour. Like skin, grass and sky it is not compared with anything on the page, "
    "because the reader brings the original along. A grey curtain may drift by three or four units and remain a grey "
    "curtain. Let the coat of a cat drift by two, towards red, and there is a fox on the sofa.",
    "Last come the whiskers, white hairs on a shaded ground, thin enough to fall between two rows of the screen. On a "
    "good day they run from the lip to the edge of the frame without a break. On a poor one they turn into a row of "
    "dashes, and the number of dashes is as honest a figure of merit as anything that is measured with a lamp. Press "
    "crews have been known to count them. The chart stays in its drawer; the cat goes up on the wall.",
)

BROCHURE = (
    (
        "From the hill",
        "We buy forty lots a year from nine countries and know the altitude of each. The sacks come by sea, because "
        "beans are patient, and are weighed on the quay by people who are not.",
    ),
    (
        "By the drum",
        "Every roast is twelve kilos, every drum is watched, and nobody answers the telephone between first crack and "
        "the cooling tray. It is the reason we are hard to reach before noon.",
    ),
    (
        "To the cup",
        "Drink it between day four and day forty. Before that it is still settling an argument with its own gas; "
        "afterwards it agrees with everything you say, which is worse.",
    ),
)

OFFERS = (
    ("House blend", "Brazil and Peru. Hazelnut, dark honey, no sharp corners.", "£7.20", quay.BEAN),
    (
        "Lantern filter",
        "Washed Ethiopia. Bergamot, apricot, a clean finish.",
        "£9.80",
        inks.percent(0, 58, 88, 4),
    ),
    ("Night watch", "Decaffeinated with water. Cocoa and toast until late.", "£8.10", quay.TEAL),
)

LAUNCH = (
    "Photographs of rockets are photographs of light sources, and a light source is what paper does worst. The "
    "floodlights round this one were some thousands of times brighter than the sky behind it. On the page they are "
    "clean paper, and the sky has been pushed down, ink upon ink, until the paper seems to burn by comparison.",
    "Small type on such a ground is a test of nerve. Each letter is a hole in three inks at once, and the holes must "
    "fall on top of one another; a slip of a tenth of a millimetre closes the eye of every e. We have set the whole of "
    "this notice that way, on purpose, and shall know by morning whether it was wise.",
    "The lecture begins at half past seven. Doors are shut before the countdown and stay shut until the second stage "
    "has separated. Children are welcome and will be asked to help with the arithmetic.",
)

LECTURES = (
    ("TUESDAY 4 MARCH", "Eleven minutes to orbit. Old Customs Hall, upstairs."),
    ("TUESDAY 11 MARCH", "How to photograph what cannot be seen. Same place."),
    ("TUESDAY 18 MARCH", "Maps of the sky, and who paid for them. Bring a coat."),
)

LETTER = (
    "Dear Ms Okonkwo-Hale,",
    "Thank you for your letter about the parcel of the ninth. You are quite right: the bag marked <i>El Mirador</i> "
    "held something else. We have compared the roasting book with the packing list, and it was the San Telmo, which "
    "stood next to it on the bench and looks, in a brown bag, exactly like everything else we make.",
    "A fresh kilo of the right coffee left us this morning. Please keep the other one. If you have been drinking it "
    "and found it rounder than you remembered, with something of plum in it, then your palate is in good order and "
    "our labels were not.",
    "We have since bought a machine that prints each label from the roasting book itself, so that no two are alike, "
    "and a second machine that looks at what the first one has printed. We are told that between them they leave us "
    "nothing to get wrong. I shall be surprised, but I shall write and tell you.",
    "With kind regards,",
)

RICH = (
    "This half of the page is printed in all four inks: 60 parts of cyan, 40 of magenta, 40 of yellow, under a full "
    "black. It swallows nearly everything. Tilt the page and it looks the same, because there is little light left to "
    "shine. It takes its time to dry, and if one of the four inks lies a little to the side, every letter in it grows "
    "a coloured hem."
)

ALONE = (
    "This half is black ink and nothing else. By itself you would call it black without a second thought. Beside its "
    "neighbour it turns out to have been a very dark grey all along. It dries fast, its letters are clean, and on its "
    "own it can never be out of register with anything. Most of what you have read in your life was printed this way."
)

SPOT = (
    "Three tins of Lantern Orange are on the shelf. It is not made of dots: where the whole of it is wanted, the whole "
    "surface is covered, and the colour is the same at the edge of a letter as in the middle of a wall. What you see "
    "if your press has only four inks is the nearest that magenta and yellow can come."
)

OVERPRINTED = "Black over the orange: no hole, nothing to miss."
KNOCKED_OUT = "Black in a hole in the orange: clean, if it hits."
