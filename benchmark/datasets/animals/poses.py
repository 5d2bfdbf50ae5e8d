"""Poses of the six animals, as data: directions of the bones of each part.

Angles are in degrees in the sagittal plane of the world: 0 forward, 90 up, 180 (or -180) backward, -90 down. A pair
adds the outward angle, positive to the animal's left on the midline and away from the body on a limb. With ``FOLLOW``,
a bone follows its parent; ``None`` for a whole part keeps its rest directions. Parts missing from a pose follow.

Chains: trunk = pelvis, loin, back, chest; fore = scapula, upper arm, forearm, paw, toes; hind = thigh, shank, foot,
toes; hoofed animals have cannon, pastern and hoof instead of paw and toes. Gorilla: trunk = pelvis, belly, ribs; leg =
thigh, shank, foot, toes. Centaur: torso = belly, waist, ribs. Both: arm = clavicle, upper arm, forearm, hand (fingers).
"""

from __future__ import annotations

from benchmark.datasets.animals.skeleton import Pose

FOLLOW = None

_SITTING: Pose = {
    "trunk": (52, 44, 33, 25),
    "neck": (65,),
    "head": (-12,),
    "fore": (-62, -118, -88, -80, -8),
    "hind": ((18, 14), (-150, 6), -4, -6),
    "tail": ((182, 0), (186, 25), (182, 60), (180, 85)),
}

_LYING: Pose = {
    "trunk": (0, -4, 0, 8),
    "neck": (55,),
    "head": (-12,),
    "fore": (-40, -165, -6, -2, -2),
    "hind": ((8, 16), (-150, 8), -4, -4),
    "tail": ((200, 0), (190, 30), (180, 60), (180, 80)),
}

_BEGGING: Pose = {
    "trunk": (66, 72, 78, 78),
    "neck": (80,),
    "head": (5,),
    "fore": (-20, -75, 20, -30, -60),
    "hind": ((-20, 10), -145, -70, -8),
    "tail": (215, 195, 170, 150),
}

_LEAPING: Pose = {
    "trunk": (34, 32, 28, 26),
    "neck": (40,),
    "head": (5,),
    "fore.left": (FOLLOW, -88, -18, -5, -15),
    "fore.right": (FOLLOW, -80, -5, -20, -45),
    "hind.left": (-98, -148, -112, -105),
    "hind.right": (-88, -152, -122, -120),
    "tail": (188, 180, 170, 160),
}

_GALLOP_STRETCHED: Pose = {
    "trunk": (-8, -2, 4, 8),
    "neck": (28,),
    "head": (-8,),
    "fore.left": (-38, -88, -35, -28, -25),
    "fore.right": (-34, -80, -20, -15, -20),
    "hind.left": (-98, -160, -126, -135),
    "hind.right": (-88, -152, -115, -120),
    "tail": (168, 172, 180, 185),
}

_GALLOP_GATHERED: Pose = {
    "trunk": (28, 14, -10, -22),
    "neck": (18,),
    "head": (-15,),
    "fore.left": (-80, -165, -128, -150, -165),
    "fore.right": (-70, -150, -105, -140, -160),
    "hind.left": (-5, -118, -32, -10),
    "hind.right": (5, -128, -45, -20),
    "tail": (200, 195, 185, 175),
}

_WALKING: Pose = {
    "trunk": (-2, 0, 2, 2),
    "fore.left": (-35, -105, -62, -62, 0),
    "fore.right": (-58, -148, -106, -108, -60),
    "hind.left": (-82, -158, -98, -55),
    "hind.right": (-38, -126, -52, -6),
}

_BOWING: Pose = {
    "trunk": (-24, -32, -30, -18),
    "neck": (15,),
    "head": (5,),
    "fore": (-30, -125, -8, -4, -4),
    "hind": None,
    "tail": (140, 120, 105, 95),
}

CAT: dict[str, Pose] = {
    "standing": {},
    "walking-tail-up": {**_WALKING, "neck": (48,), "tail": (115, 95, 85, 110)},
    "sitting": _SITTING,
    "licking-a-paw": {
        **_SITTING,
        "trunk": (58, 48, 28, 8),
        "neck": ((5, 8),),
        "head": ((-62, 10),),
        "fore.left": ((-50, 5), (-95, 12), (38, -8), (60, -30), (20, -40)),
        "tail": (182, 186, 182, 178),
    },
    "begging": {**_BEGGING, "fore.left": (0, -40, 48, 40, 0), "fore.right": (-10, -60, 25, 10, -40)},
    "pouncing": _LEAPING,
    "running": {**_GALLOP_STRETCHED, "tail": (165, 160, 175, 195)},
    "arched-back": {
        "trunk": (54, 30, -28, -56),
        "neck": (-10,),
        "head": (-35,),
        "fore": (-72, -118, -92, -86, -10),
        "hind": (-54, -128, -78, -8),
        "tail": (110, 92, 80, 95),
    },
    "stretching": _BOWING,
    "lying": _LYING,
    "stalking": {
        "trunk": (4, -2, -6, -2),
        "neck": (8,),
        "head": (-8,),
        "fore.left": (-25, -125, -40, -50, -5),
        "fore.right": (-60, -178, -72, -80, -8),
        "hind.left": (-12, -152, -48, -8),
        "hind.right": (-30, -162, -62, -10),
        "tail": (200, 185, 165, 140),
    },
}

DOG: dict[str, Pose] = {
    "standing": {},
    "sitting": {**_SITTING, "trunk": (66, 60, 52, 44), "tail": (186, 186, 180, 178)},
    "howling": {
        **_SITTING,
        "trunk": (68, 63, 56, 48),
        "neck": (85,),
        "head": (68,),
        "tail": (184, 186, (182, 20), (180, 40)),
    },
    "leaping": _LEAPING,
    "galloping-gathered": _GALLOP_GATHERED,
    "galloping-stretched": _GALLOP_STRETCHED,
    "lying": {**_LYING, "trunk": (-4, -7, -3, 6), "tail": (200, 190, 184, 180)},
    "bowing-to-play": {**_BOWING, "trunk": (-34, -42, -40, -26)},
    "sniffing": {
        **_WALKING,
        "trunk": (-3, -5, -6, -10),
        "neck": (-38,),
        "head": (-62,),
        "tail": (150, 140, 130, 125),
    },
}

WOLF: dict[str, Pose] = {
    "standing": {},
    "howling": {
        **_SITTING,
        "trunk": (54, 47, 38, 32),
        "neck": (80,),
        "head": (66,),
        "tail": (186, 188, 182, 180),
    },
    "trotting-head-turned": {
        "trunk": (-2, 0, 2, (2, 5)),
        "neck": ((28, 28),),
        "head": ((-14, 52),),
        "fore.left": (-25, -95, -48, -70, -30),
        "fore.right": (-60, -150, -110, -112, -70),
        "hind.left": (-85, -162, -104, -75),
        "hind.right": (-28, -120, -50, -10),
        "tail": (195, 190, 185, 180),
    },
}

HORSE: dict[str, Pose] = {
    "standing": {},
    "grazing": {
        "trunk": (6, 2, -8, -22),
        "neck": ((-24, -4), (-54, -8), (-70, -8)),
        "head": ((-84, -6),),
        "fore.left": (FOLLOW, -122, -52, -62, -50, -55),
        "fore.right": (FOLLOW, -150, -112, -116, -85, -75),
        "hind": None,
    },
    "walking": {
        "neck": (38, 40, 44),
        "head": (-55,),
        "fore.left": (-40, -110, -60, -64, -45, -50),
        "fore.right": (-56, -146, -102, -112, -80, -75),
        "hind.left": (-82, -155, -102, -85, -80),
        "hind.right": (-45, -124, -66, -45, -50),
        "tail": (240, 262, 268, 270),
    },
    "prancing": {
        "trunk": (1, -2, -3, 0),
        "neck": (56, 66, 50),
        "head": (-82,),
        "fore.left": (-40, -95, -14, -62, -75, -80),
        "fore.right": None,
        "hind.left": (-32, -118, -85, -110, -120),
        "hind.right": (-62, -142, -86, -62, -62),
        "tail": (160, 200, 245, 265),
    },
    "rearing": {
        "trunk": (48, 52, 56, 58),
        "neck": (64, 74, 74),
        "head": (-10,),
        "fore.left": (FOLLOW, -78, -8, -95, -120, -120),
        "fore.right": (FOLLOW, -88, -34, -120, -140, -140),
        "hind.left": (-40, -128, -68, -58, -60),
        "hind.right": (-55, -138, -80, -60, -60),
        "tail": (225, 250, 265, 270),
    },
    "galloping": {
        "trunk": (-4, 0, 4, 6),
        "neck": (28, 30, 32),
        "head": (-38,),
        "fore.left": (-38, -92, -32, -34, -38, -40),
        "fore.right": (-42, -102, -50, -80, -110, -120),
        "hind.left": (-88, -152, -120, -130, -135),
        "hind.right": (-78, -146, -105, -108, -115),
        "tail": (165, 180, 190, 195),
    },
    "kicking": {
        "trunk": (-26, -30, -28, -22),
        "neck": (0, 4, 0),
        "head": (-60,),
        "fore": (-55, -120, -84, -92, -66, -63),
        "hind.left": (-128, -172, 178, 172, 170),
        "hind.right": (-118, -165, -178, -170, -165),
        "tail": (120, 140, 190, 230),
    },
    "jumping-head-turned": {
        "trunk": (26, 24, 20, (18, 4)),
        "neck": ((36, 10), (40, 24), (38, 36)),
        "head": ((-30, 44),),
        "fore.left": (FOLLOW, -85, -2, -100, -140, -140),
        "fore.right": (FOLLOW, -92, -12, -115, -150, -150),
        "hind.left": (-88, -145, -110, -108, -112),
        "hind.right": (-84, -140, -104, -102, -106),
        "tail": (170, 195, 225, 240),
    },
}

CENTAUR: dict[str, Pose] = {
    "standing": {},
    "rearing-arms-raised": {
        "trunk": (42, 46, 50, 52),
        "torso": (92, 95),
        "neck": (90,),
        "head": (90,),
        "fore.left": (FOLLOW, -78, -4, -95, -120, -120),
        "fore.right": (FOLLOW, -88, -34, -120, -140, -140),
        "hind.left": (-42, -128, -68, -58, -60),
        "hind.right": (-58, -138, -80, -60, -60),
        "arm": (FOLLOW, (70, 35), (75, 15), (75, 15)),
        "tail": (225, 250, 265, 270),
    },
    "drawing-a-bow": {
        "trunk": (2, 0, 2, 2),
        "torso": (94, 96),
        "arm.left": (FOLLOW, (5, 20), (5, 10), (5, 10)),
        "arm.right": (FOLLOW, (180, 70), (5, -35), (5, -30)),
        "head": ((85, 8),),
        "fore.left": (-40, -110, -60, -64, -45, -50),
        "fore.right": None,
        "hind": None,
    },
    "galloping": {
        "trunk": (-4, 0, 4, 6),
        "torso": (70, 68),
        "neck": (72,),
        "head": (84,),
        "fore.left": (-38, -92, -32, -34, -38, -40),
        "fore.right": (-42, -102, -50, -80, -110, -120),
        "hind.left": (-88, -152, -120, -130, -135),
        "hind.right": (-78, -146, -105, -108, -115),
        "arm.left": (FOLLOW, (-60, 15), (15, 0), (20, -5)),
        "arm.right": (FOLLOW, (-125, 20), (-45, 5), (-40, 0)),
        "tail": (160, 175, 190, 200),
    },
    "bowing": {
        "trunk": (-12, -14, -14, -12),
        "torso": (48, 25),
        "neck": (15,),
        "head": (20,),
        "fore.left": (-40, -110, -25, -28, -35, -45),
        "fore.right": (-62, -150, -70, -140, -150, -160),
        "hind": None,
        "arm": (FOLLOW, (-60, 25), (-35, 0), (-30, -10)),
        "tail": (235, 255, 265, 268),
    },
    "bucking": {
        "trunk": (-34, -38, -36, -30),
        "torso": (75, 85),
        "neck": (88,),
        "head": (88,),
        "fore": (-70, -120, -84, -92, -66, -63),
        "hind.left": (-132, -176, 174, 168, 165),
        "hind.right": (-122, -168, -178, -175, -170),
        "arm": (FOLLOW, (-70, 60), (30, 50), (40, 40)),
        "tail": (110, 130, 180, 220),
    },
}

GORILLA: dict[str, Pose] = {
    "standing": {},
    "knuckle-walking": {
        "trunk": (32, 28, 26),
        "neck": (40,),
        "head": (70,),
        "arm.left": (FOLLOW, (-74, 10), (-80, 2), (-95, 2), (-160, 0)),
        "arm.right": (FOLLOW, (-92, 10), (-98, 2), (-110, 2), (-170, 0)),
        "leg.left": ((-45, 12), -112, -25, -5),
        "leg.right": ((-85, 10), -128, -30, -5),
    },
    "sitting": {
        "trunk": (92, 88, 80),
        "neck": (65,),
        "head": (80,),
        "leg": ((12, 28), (-38, 10), (25, 14), (40, 14)),
        "arm": (FOLLOW, (-58, 22), (-15, -5), (-35, -12), (-60, -12)),
    },
    "beating-the-chest": {
        "trunk": (84, 88, 94),
        "neck": (80,),
        "head": (95,),
        "leg": ((-70, 22), (-104, 10), (-22, 18), (-5, 18)),
        "arm.left": (FOLLOW, (-40, 50), (25, -25), (30, -45), (60, -60)),
        "arm.right": (FOLLOW, (-10, 62), (60, -20), (60, -40), (80, -55)),
    },
}

POSES: dict[str, dict[str, Pose]] = {
    "cat": CAT,
    "centaur": CENTAUR,
    "dog": DOG,
    "gorilla": GORILLA,
    "horse": HORSE,
    "wolf": WOLF,
}
"""Poses of each class by name; the first is the canonical pose."""
