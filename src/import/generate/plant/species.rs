//! The table of species. Growth is the same for all; only these numbers differ. They hold at 25,000 triangles.

/// Arrangement of stems or leaves on a stem. Angles are in degrees.
#[derive(Debug, Clone, Copy)]
pub struct Phyllotaxis {
    /// Begin of the attached range, as a fraction of the parent's length.
    pub from: f64,
    /// End of the range.
    pub to: f64,
    /// Number at each node.
    pub whorl: u32,
    /// Turn about the parent from one node to the next; 180 gives two level rows.
    pub turn: f64,
    /// Angles from the parent's direction, at the begin and the end of the range.
    pub angle: [f64; 2],
    /// Random deviation of the turn, and twice that of the angle.
    pub jitter: f64,
}

/// Stems of one level. Lengths are in lengths of the parent; that of trunks, and their spread, in heights of the plant.
#[derive(Debug, Clone, Copy)]
pub struct Branching {
    /// Number of stems, on average for each parent.
    pub count: f64,
    /// The total number of stems of the level is in proportion to the number of triangles to the power of `growth` / 4.
    pub growth: u32,
    /// Where they are.
    pub at: Phyllotaxis,
    /// Length.
    pub length: f64,
    /// Factors to the length, equally spaced from the begin to the end of the range: the shape of the crown.
    pub shape: [f64; 4],
    /// Radius, in radii of the parent at the joint; that of trunks in heights of the plant.
    pub radius: f64,
    /// Share of the radius that is lost up to the tip.
    pub taper: f64,
    /// Sum of the upward vector that bends the unit direction along the stem: to the light above 0, by weight below.
    pub lift: f64,
    /// Size of random bends.
    pub wobble: f64,
    /// Height of knots over the radius, one on each second ring; 0 for none.
    pub knots: f64,
    /// Additional radius at the foot, in radii.
    pub flare: f64,
    /// Number of sides of the tube.
    pub sides: u32,
    /// Number of segments.
    pub segments: u32,
    /// True for stems that grow from the ground.
    pub is_trunk: bool,
}

/// Leaves on the stems of the last level. They take the triangles that the stems leave over.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    /// Where they are.
    pub at: Phyllotaxis,
    /// Length in metres.
    pub length: f64,
    /// Largest width, in lengths.
    pub width: f64,
    /// Fraction of the length at which it is widest.
    pub widest: f64,
    /// Number of inner stations, with four triangles each; 0 for a kite of two triangles.
    pub stations: u32,
    /// Rise of the edges above the middle, over half of the width.
    pub fold: f64,
    /// Upward vector that bends the unit direction along the leaf.
    pub bend: f64,
    /// Largest random turn about the leaf's axis, in degrees.
    pub roll: f64,
}

impl Leaf {
    /// Returns the number of triangles of a leaf.
    pub fn triangles(&self) -> u64 {
        if self.stations == 0 { 2 } else { 4 * u64::from(self.stations) }
    }
}

/// One species.
#[derive(Debug, Clone, Copy)]
pub struct Species {
    /// Name.
    pub name: &'static str,
    /// Least and largest height in metres.
    pub height: [f64; 2],
    /// Radius of the disc on which several trunks stand.
    pub spread: f64,
    /// Angle by which the outermost trunks lean outward, in degrees.
    pub lean: f64,
    /// Levels of stems, trunks first.
    pub stems: &'static [Branching],
    /// Leaves, if any.
    pub leaf: Option<Leaf>,
    /// Linear colours of bark, twigs and leaves.
    pub colours: [[f32; 3]; 3],
}

const SPIRAL: Phyllotaxis =
    Phyllotaxis { from: 0.2, to: 1.0, whorl: 1, turn: 137.5, angle: [60.0, 40.0], jitter: 15.0 };
const ROWS: Phyllotaxis = Phyllotaxis { turn: 180.0, jitter: 6.0, ..SPIRAL };

const TRUNK: Branching = Branching {
    count: 1.0,
    growth: 0,
    at: SPIRAL,
    length: 1.0,
    shape: [1.0; 4],
    radius: 0.015,
    taper: 0.93,
    lift: 0.3,
    wobble: 0.1,
    knots: 0.0,
    flare: 0.4,
    sides: 10,
    segments: 12,
    is_trunk: true,
};
const LIMB: Branching = Branching {
    growth: 1,
    shape: [1.0, 0.9, 0.7, 0.4],
    radius: 0.6,
    taper: 0.85,
    lift: 0.3,
    wobble: 0.3,
    flare: 0.0,
    sides: 6,
    segments: 6,
    is_trunk: false,
    ..TRUNK
};
const BRANCH: Branching = Branching { growth: 2, length: 0.5, sides: 4, segments: 4, ..LIMB };
const TWIG: Branching = Branching { growth: 3, length: 0.4, sides: 3, segments: 2, ..LIMB };

const LEAF: Leaf = Leaf {
    at: Phyllotaxis { to: 1.0, angle: [55.0, 30.0], jitter: 25.0, ..SPIRAL },
    length: 0.2,
    width: 0.6,
    widest: 0.45,
    stations: 0,
    fold: 0.3,
    bend: -0.3,
    roll: 40.0,
};

/// The species, by number.
pub const SPECIES: [Species; 13] = [
    Species {
        name: "spruce",
        height: [18.0, 30.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { radius: 0.011, wobble: 0.02, ..TRUNK },
            Branching {
                count: 80.0,
                growth: 2,
                at: Phyllotaxis { from: 0.06, to: 0.985, whorl: 5, turn: 36.0, angle: [108.0, 50.0], jitter: 12.0 },
                length: 0.22,
                shape: [1.0, 0.74, 0.42, 0.07],
                radius: 0.3,
                lift: 0.45,
                wobble: 0.12,
                sides: 4,
                segments: 5,
                ..LIMB
            },
            Branching {
                count: 11.0,
                at: Phyllotaxis { from: 0.12, angle: [65.0, 40.0], ..ROWS },
                length: 0.42,
                shape: [0.8, 0.9, 0.65, 0.3],
                lift: -0.35,
                wobble: 0.1,
                ..TWIG
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.02, angle: [50.0, 35.0], ..LEAF.at },
            length: 0.5,
            width: 0.44,
            bend: -0.1,
            ..LEAF
        }),
        colours: [[0.13, 0.08, 0.055], [0.12, 0.075, 0.04], [0.025, 0.085, 0.04]],
    },
    Species {
        name: "pine",
        height: [15.0, 25.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { radius: 0.015, wobble: 0.09, taper: 0.8, ..TRUNK },
            Branching {
                count: 24.0,
                at: Phyllotaxis { from: 0.52, to: 0.99, angle: [88.0, 35.0], ..SPIRAL },
                length: 0.28,
                shape: [0.75, 1.0, 0.9, 0.45],
                radius: 0.42,
                wobble: 0.4,
                sides: 5,
                ..LIMB
            },
            Branching { count: 5.5, at: Phyllotaxis { from: 0.35, ..SPIRAL }, wobble: 0.35, segments: 3, ..BRANCH },
            Branching { count: 5.0, length: 0.45, lift: 0.5, ..TWIG },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.35, angle: [75.0, 20.0], ..LEAF.at },
            length: 0.55,
            width: 0.2,
            bend: 0.0,
            roll: 90.0,
            ..LEAF
        }),
        colours: [[0.28, 0.12, 0.055], [0.2, 0.1, 0.05], [0.05, 0.12, 0.05]],
    },
    Species {
        name: "cypress",
        height: [10.0, 18.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { radius: 0.012, wobble: 0.03, ..TRUNK },
            Branching {
                count: 150.0,
                growth: 2,
                at: Phyllotaxis { from: 0.04, to: 0.98, angle: [30.0, 15.0], ..SPIRAL },
                length: 0.17,
                shape: [0.75, 1.0, 0.8, 0.3],
                radius: 0.3,
                wobble: 0.15,
                sides: 4,
                segments: 3,
                ..LIMB
            },
            Branching { count: 5.5, at: Phyllotaxis { angle: [35.0, 25.0], ..SPIRAL }, ..TWIG },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.0, angle: [40.0, 20.0], ..LEAF.at },
            length: 0.24,
            width: 0.36,
            bend: 0.2,
            roll: 90.0,
            ..LEAF
        }),
        colours: [[0.16, 0.11, 0.08], [0.14, 0.1, 0.06], [0.02, 0.065, 0.025]],
    },
    Species {
        name: "oak",
        height: [14.0, 22.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.6, radius: 0.03, taper: 0.7, wobble: 0.22, flare: 0.6, ..TRUNK },
            Branching {
                count: 14.0,
                at: Phyllotaxis { from: 0.38, angle: [85.0, 25.0], ..SPIRAL },
                length: 0.85,
                shape: [0.8, 1.0, 0.95, 0.75],
                radius: 0.55,
                wobble: 0.5,
                ..LIMB
            },
            Branching { count: 9.0, at: Phyllotaxis { angle: [70.0, 40.0], ..SPIRAL }, wobble: 0.5, ..BRANCH },
            Branching { count: 8.0, wobble: 0.4, ..TWIG },
        ],
        leaf: Some(Leaf { length: 0.42, width: 0.62, widest: 0.6, ..LEAF }),
        colours: [[0.14, 0.105, 0.075], [0.13, 0.095, 0.06], [0.065, 0.15, 0.025]],
    },
    Species {
        name: "birch",
        height: [15.0, 24.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.95, radius: 0.0095, wobble: 0.12, flare: 0.2, ..TRUNK },
            Branching {
                count: 36.0,
                at: Phyllotaxis { from: 0.28, to: 0.99, angle: [55.0, 25.0], ..SPIRAL },
                length: 0.3,
                shape: [0.75, 1.0, 0.7, 0.3],
                radius: 0.4,
                wobble: 0.25,
                sides: 4,
                segments: 5,
                ..LIMB
            },
            Branching { count: 4.0, lift: -0.5, segments: 3, ..BRANCH },
            Branching { count: 5.0, length: 0.75, lift: -2.0, shape: [1.0, 1.0, 0.9, 0.7], segments: 3, ..TWIG },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.05, ..LEAF.at },
            length: 0.32,
            width: 0.75,
            widest: 0.35,
            bend: -0.8,
            ..LEAF
        }),
        colours: [[0.7, 0.69, 0.65], [0.16, 0.09, 0.06], [0.13, 0.24, 0.035]],
    },
    Species {
        name: "poplar",
        height: [20.0, 30.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { radius: 0.013, wobble: 0.04, ..TRUNK },
            Branching {
                count: 64.0,
                growth: 2,
                at: Phyllotaxis { from: 0.1, to: 0.97, angle: [38.0, 22.0], ..SPIRAL },
                length: 0.24,
                shape: [0.7, 1.0, 0.85, 0.3],
                radius: 0.4,
                lift: 0.6,
                wobble: 0.15,
                sides: 4,
                ..LIMB
            },
            Branching { count: 12.0, at: Phyllotaxis { angle: [45.0, 30.0], ..SPIRAL }, length: 0.26, ..TWIG },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.1, ..LEAF.at },
            length: 0.3,
            width: 0.85,
            widest: 0.3,
            bend: -0.6,
            ..LEAF
        }),
        colours: [[0.26, 0.24, 0.2], [0.2, 0.16, 0.1], [0.09, 0.2, 0.03]],
    },
    Species {
        name: "willow",
        height: [9.0, 14.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.5, radius: 0.035, taper: 0.6, wobble: 0.25, ..TRUNK },
            Branching {
                count: 11.0,
                at: Phyllotaxis { from: 0.5, angle: [60.0, 15.0], ..SPIRAL },
                length: 0.95,
                shape: [0.85, 1.0, 1.0, 0.9],
                radius: 0.5,
                lift: 0.4,
                wobble: 0.35,
                ..LIMB
            },
            Branching { count: 5.0, at: Phyllotaxis { from: 0.35, ..SPIRAL }, length: 0.5, lift: 0.2, ..BRANCH },
            Branching {
                count: 8.0,
                length: 1.7,
                shape: [1.0, 1.1, 1.0, 0.8],
                lift: -7.0,
                wobble: 0.12,
                segments: 4,
                ..TWIG
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.08, angle: [40.0, 25.0], ..LEAF.at },
            length: 0.36,
            width: 0.22,
            bend: -0.7,
            ..LEAF
        }),
        colours: [[0.17, 0.13, 0.09], [0.28, 0.24, 0.07], [0.14, 0.22, 0.05]],
    },
    Species {
        name: "palm",
        height: [8.0, 15.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching {
                length: 0.85,
                radius: 0.016,
                taper: 0.35,
                wobble: 0.12,
                knots: 0.14,
                flare: 0.7,
                sides: 8,
                segments: 32,
                ..TRUNK
            },
            Branching {
                count: 30.0,
                at: Phyllotaxis { from: 0.965, to: 0.995, angle: [120.0, 12.0], jitter: 12.0, ..SPIRAL },
                length: 0.38,
                shape: [0.75, 1.0, 1.0, 0.8],
                radius: 0.22,
                lift: -1.1,
                wobble: 0.06,
                sides: 4,
                segments: 8,
                ..LIMB
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.14, angle: [75.0, 25.0], ..ROWS },
            length: 0.85,
            width: 0.075,
            widest: 0.3,
            stations: 2,
            bend: -0.7,
            roll: 12.0,
            ..LEAF
        }),
        colours: [[0.26, 0.19, 0.13], [0.3, 0.28, 0.08], [0.07, 0.17, 0.03]],
    },
    Species {
        name: "shrub",
        height: [1.2, 2.4],
        spread: 0.08,
        lean: 45.0,
        stems: &[
            Branching {
                count: 12.0,
                growth: 1,
                radius: 0.013,
                wobble: 0.3,
                flare: 0.0,
                sides: 5,
                segments: 6,
                ..TRUNK
            },
            Branching { count: 5.0, at: Phyllotaxis { from: 0.15, ..SPIRAL }, segments: 3, ..BRANCH },
            Branching { count: 13.0, length: 0.42, shape: [1.0, 0.95, 0.85, 0.6], ..TWIG },
        ],
        leaf: Some(Leaf { length: 0.085, width: 0.6, roll: 60.0, ..LEAF }),
        colours: [[0.16, 0.11, 0.07], [0.17, 0.13, 0.06], [0.055, 0.13, 0.035]],
    },
    Species {
        name: "fern",
        height: [0.6, 1.2],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.04, radius: 0.02, taper: 0.4, flare: 0.3, segments: 3, ..TRUNK },
            Branching {
                count: 18.0,
                at: Phyllotaxis { from: 0.5, angle: [50.0, 12.0], ..SPIRAL },
                length: 26.0,
                shape: [0.85, 1.0, 1.0, 0.8],
                radius: 0.25,
                lift: -1.0,
                wobble: 0.08,
                sides: 4,
                segments: 8,
                ..LIMB
            },
            Branching {
                count: 42.0,
                at: Phyllotaxis { from: 0.14, angle: [82.0, 50.0], ..ROWS },
                length: 0.24,
                shape: [0.75, 1.0, 0.65, 0.12],
                lift: -0.25,
                wobble: 0.05,
                ..TWIG
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.02, angle: [80.0, 45.0], ..ROWS },
            length: 0.06,
            width: 0.7,
            roll: 8.0,
            bend: -0.2,
            fold: 0.15,
            ..LEAF
        }),
        colours: [[0.1, 0.065, 0.03], [0.13, 0.16, 0.04], [0.075, 0.21, 0.03]],
    },
    Species {
        name: "grass",
        height: [0.5, 1.1],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.04, radius: 0.05, taper: 0.5, segments: 3, ..TRUNK },
            Branching {
                count: 120.0,
                growth: 2,
                at: Phyllotaxis { from: 0.1, to: 0.9, angle: [34.0, 3.0], ..SPIRAL },
                length: 22.0,
                shape: [0.8, 0.95, 1.0, 1.0],
                radius: 0.04,
                lift: -0.2,
                wobble: 0.08,
                sides: 3,
                segments: 4,
                ..LIMB
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.01, to: 0.4, angle: [32.0, 14.0], ..LEAF.at },
            length: 0.48,
            width: 0.022,
            widest: 0.25,
            stations: 3,
            bend: -1.9,
            roll: 30.0,
            ..LEAF
        }),
        colours: [[0.13, 0.1, 0.05], [0.34, 0.28, 0.1], [0.12, 0.23, 0.035]],
    },
    Species {
        name: "dead tree",
        height: [8.0, 16.0],
        spread: 0.0,
        lean: 0.0,
        stems: &[
            Branching { length: 0.8, radius: 0.026, taper: 0.85, wobble: 0.35, flare: 0.8, ..TRUNK },
            Branching {
                count: 13.0,
                at: Phyllotaxis { from: 0.25, angle: [80.0, 30.0], ..SPIRAL },
                length: 0.6,
                shape: [0.9, 1.0, 0.8, 0.45],
                radius: 0.5,
                lift: 0.2,
                wobble: 0.75,
                segments: 8,
                ..LIMB
            },
            Branching { count: 8.0, wobble: 0.7, lift: 0.1, segments: 5, ..BRANCH },
            Branching { count: 11.0, length: 0.45, wobble: 0.6, segments: 3, ..TWIG },
        ],
        leaf: None,
        colours: [[0.27, 0.25, 0.23], [0.23, 0.2, 0.18], [0.0; 3]],
    },
    Species {
        name: "bamboo",
        height: [8.0, 14.0],
        spread: 0.11,
        lean: 9.0,
        stems: &[
            Branching {
                count: 30.0,
                growth: 2,
                radius: 0.0046,
                taper: 0.55,
                lift: -0.3,
                wobble: 0.05,
                knots: 0.16,
                flare: 0.0,
                sides: 5,
                segments: 22,
                ..TRUNK
            },
            Branching {
                count: 24.0,
                at: Phyllotaxis { from: 0.35, whorl: 2, turn: 180.0, angle: [55.0, 30.0], ..SPIRAL },
                length: 0.12,
                shape: [0.7, 1.0, 1.0, 0.6],
                radius: 0.3,
                lift: -0.3,
                ..TWIG
            },
        ],
        leaf: Some(Leaf {
            at: Phyllotaxis { from: 0.15, angle: [50.0, 20.0], ..LEAF.at },
            length: 0.34,
            width: 0.15,
            widest: 0.3,
            bend: -0.8,
            ..LEAF
        }),
        colours: [[0.19, 0.26, 0.045], [0.22, 0.25, 0.06], [0.1, 0.24, 0.03]],
    },
];
