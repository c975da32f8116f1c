"""What the newspaper says: invented places, people and events, in the manner of about 1920."""

from __future__ import annotations

TITLES = ("The Morning Courier", "The Evening Post", "The Harbour Times", "The Daily Record")
DATES = ("TUESDAY, MARCH 9, 1926", "SATURDAY, OCTOBER 14, 1922", "THURSDAY, JUNE 21, 1928", "MONDAY, JANUARY 5, 1920")

# Headline, second line, paragraphs.
STORIES: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (
        "HARBOUR LAMP LIT BY A SWITCH",
        "Keeper of Eleven Winters Has Charge of the New Current",
        (
            "The lamp at the end of the long mole, which for eleven winters was lit by hand, was lit on "
            "Tuesday from the office of the harbour master, and no one who stood on the quay could say "
            "that it burned the worse for it.",
            "Mr. Alderson, the keeper, has been given the care of the switch. He told the council that he "
            "would still walk out at dusk, since a lamp which nobody looks at is soon a lamp that nobody "
            "trusts.",
            "The cable was laid in October by the tender Gannet, in nineteen hours and a flat calm. Its "
            "cost, which was put at four thousand, is to be met out of the dues on coal.",
            "Masters of the herring fleet report that the light is whiter than the old one, and that it "
            "can be made out from the Ridge bank in any weather short of snow.",
        ),
    ),
    (
        "RIVER FALLS AFTER FIVE DAYS",
        "Mill Lane Open Again; Loss of Grain Is Small",
        (
            "The river fell eleven inches in the night, and by noon the carts were going down Mill Lane as"
            " if nothing had been the matter. The mark on the bridge now stands at nine feet, which is two"
            " above the common.",
            "At the lower granary forty sacks were spoiled. The rest had been carried to the loft on "
            "Sunday by the pupils of the school, who were let off their lessons for the purpose and have "
            "asked when the next flood may be looked for.",
            "The engineer of the county has been to see the piers. He found them sound, but he would have "
            "the willows cut above the weir, where they hold back whatever floats.",
        ),
    ),
    (
        "NEW ENGINE CLIMBS THE PASS",
        "Eight Coaches Drawn to the Summit in Forty Minutes",
        (
            "With eight coaches behind her, and a wet rail under her, the new engine of the Northern line "
            "went up to the summit on Friday in forty minutes and a half. The best that had been done "
            "before was fifty-two.",
            "She was built at the works in Castle Street, and is the first of six. The driver, whose name "
            "is Harrow, said that she rode like a boat and wanted only a better seat.",
            "From May there is to be a third train in each direction. It will leave the coast at seven in "
            "the morning, and will stop at every station as far as Lindow.",
            "The directors were carried in the last coach, with a luncheon, and returned by the ordinary train.",
        ),
    ),
    (
        "BREAD TO BE A PENNY LESS",
        "Bakers Agree After a Long Sitting",
        (
            "The master bakers sat until past eleven on Wednesday, and rose with the loaf a penny cheaper."
            " The price of flour has fallen since the harvest by more than a tenth, and it was felt that "
            "the town knew as much.",
            "One member held that the price should wait upon that of coal. He was asked how often it had "
            "waited when it was going up, and the question was then put.",
            "The new price holds from Monday. Rolls and seed cake are to remain as they are.",
        ),
    ),
    (
        "COMET SEEN BEFORE DAWN",
        "Visible Low in the East Until the End of the Month",
        (
            "A comet may be seen low in the east for an hour before sunrise, by anyone who has a clear "
            "horizon and the will to leave his bed. Its tail is about as long as the breadth of three "
            "fingers at the length of the arm.",
            "It was first noted by Miss Ekdahl of the observatory, upon a plate which had been exposed for"
            " quite another object. It will be nearest to us on the twentieth, when it will be some forty "
            "million miles away, and no cause for alarm.",
            "The observatory will be open to visitors on both Saturdays from five in the morning. They are"
            " begged to bring no lanterns.",
        ),
    ),
    (
        "THE MATCH ON THE COMMON",
        "Visitors Beaten by Two Wickets in the Last Light",
        (
            "There were eleven minutes left and nine runs to be made when the last pair but one came "
            "together, and most of those who had a train to catch had given it up.",
            "Fenwick, who had not been thought of as a batsman, struck the third ball over the chestnut "
            "tree and the fifth into the pond, where it remains. The rest were got in singles, with the "
            "fielders on all sides of him.",
            "The score of the visitors, 187, had seemed enough for the ground. Their captain said "
            "afterwards that he had never lost a match by so little, nor enjoyed one so well.",
        ),
    ),
    (
        "BIG STEAMER PUTS IN FOR COAL",
        "Two Thousand on Board; Townsfolk Row Out to See Her",
        (
            "The largest vessel that has ever lain in the roads came in on Thursday for coal, and a "
            "quarter of the town went out to look at her in whatever would float.",
            "She is bound for the south with mails and two thousand souls. Her captain, who served his "
            "time in the schooners of this coast, had himself put ashore, and walked up to the school to "
            "see whether his name was still cut in the bench. It was.",
            "Nine hundred tons were taken on in fourteen hours. The lighters worked by the light of her "
            "own lamps, and she was gone with the morning tide.",
        ),
    ),
    (
        "THREE BALLOONS CROSS THE HILLS",
        "One Comes Down in a Field of Turnips",
        (
            "Three balloons which had left the capital on Saturday passed over the hills on Sunday before "
            "church, at no great height, and their crews could be heard asking the way.",
            "Two held on towards the sea. The third came down beyond Orchard Farm in a field of turnips, "
            "without hurt to anyone, and was rolled up and carried to the station on a hay cart by four "
            "o'clock.",
            "The farmer has asked for eleven shillings on account of his turnips, and has had twenty. He "
            "says that they may come again.",
        ),
    ),
)

CAPTIONS = {
    "lighthouse": "The light on the outer rock, as it was seen from the pilot boat on Tuesday last.",
    "steamer": "The steamer in the roads on Thursday, taking the pilot on board before the turn of the tide.",
    "balloons": "The balloons above the hills, shortly before the wind took them to the north.",
    "bridge": "The great bridge in the haze of the morning. It has been open to carts since Monday.",
}
CREDIT = "Photo: Courier"
