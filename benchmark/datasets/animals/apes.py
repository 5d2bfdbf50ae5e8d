"""Proportions of the gorilla, as data; see :data:`.generate.SPECIES`."""

from __future__ import annotations

from benchmark.datasets.animals.anatomy import Species, tube

GORILLA = Species(
    "gorilla",
    (
        tube(
            "trunk",
            "",
            ("pelvis", -1, 64, 0, 15, 18),
            ("", 3, 74, 0, 19, 21),
            ("belly", 6, 85, 0, 22, 24),
            ("ribs", 4, 100, 0, 20.5, 24.5),
            ("", 1, 114, 0, 18.5, 26),
            ("", -2, 126, 0, 15.5, 23),
            ("", -2, 136, 0, 11, 16),
            blend=8,
        ),
        tube("pectoral", "ribs", ("", 14, 116, 8.5, 7, 10), ("", 10, 121, 19, 6.5, 8), blend=4, paired=True),
        tube("neck", "ribs", ("neck", -1, 134, 0, 14, 14), ("", 3, 146, 0, 12.5, 11.5), blend=9),
        tube(
            "head", "neck", ("head", 4, 147, 0, 11.5, 11), ("", 5, 156, 0, 11, 10.5), ("", 0, 164, 0, 8.5, 7), blend=5
        ),
        tube("brow", "head", ("", 13.5, 159.5, 5, 3, 4.5), ("", 14, 158.5, 1, 3, 3.5), blend=2.5, paired=True),
        tube("muzzle", "head", ("", 10, 148, 0, 9, 9), ("", 17.5, 146.5, 0, 7, 7.5), blend=3.5),
        tube(
            "eye", "head", ("", 18, 154.5, 5.5, 2.6, 3), ("", 17, 154.5, 8, 2.6, 3), blend=1, paired=True, hollow=True
        ),
        tube("nose", "head", ("", 16.5, 154.5, 0, 2.2, 2.6), ("", 19.5, 151.5, 0, 2.6, 4), blend=2.5),
        tube("ear", "head", ("", 3, 153.5, 11, 3, 1.6), ("", 2.5, 156.5, 11.6, 2.6, 1.5), blend=1, paired=True),
        tube(
            "arm",
            "ribs",
            ("clavicle", -1, 128, 12, 14, 12),
            ("upper_arm", -1, 126.5, 27, 13.5, 13.5),
            ("", -1, 119, 39, 11, 11),
            ("forearm", -1, 106.5, 57, 8.6, 8.6),
            ("", 0, 100, 66, 9.6, 9),
            ("hand", 1, 88, 83, 5.8, 5),
            ("", 2, 83, 90, 7.4, 4.2),
            ("fingers", 2, 80, 94.5, 7.2, 3.8),
            ("", 2, 74, 103, 6, 3),
            blend=9,
            paired=True,
            flat=(0.55, 0.0, 0.83),
        ),
        tube("thumb", "hand", ("", 6.5, 86, 85.5, 2.8, 2.8), ("", 13, 81.5, 91, 2.2, 2.2), blend=2, paired=True),
        tube(
            "leg",
            "pelvis",
            ("thigh", -1, 64, 11.5, 15, 13),
            ("", 1, 52, 14, 13.5, 12.5),
            ("shank", 4, 37, 16, 10, 9.8),
            ("", 1, 26, 16.5, 9.4, 8.8),
            ("foot", -3, 11, 16.5, 6.4, 6),
            ("", 4, 6, 17, 5.4, 6.6),
            ("toes", 12, 4, 17.5, 4.4, 7.6),
            ("", 23, 2.6, 18.5, 3.4, 7),
            blend=7,
            paired=True,
        ),
        tube("heel", "foot", ("", -7, 5, 16.5, 5.4, 5.4), ("", -1, 4.5, 16.5, 5, 5.4), blend=3, paired=True),
        tube("great_toe", "toes", ("", 11, 3.5, 11.5, 3.2, 3), ("", 18, 2.5, 9.5, 2.8, 2.6), blend=2, paired=True),
    ),
)
