//! Figures as the thesis prints them.

/// Table 3.3, reamer: chunks collided, ms a chunk, ms in all; for chunks of 16³, 32³, 64³.
pub(super) const REAMER: [[f64; 3]; 3] = [
    [84.0, 0.012, 1.024],
    [18.0, 0.055, 0.970],
    [5.0, 0.405, 2.023],
];

/// Table 3.4, peg-hole cylinder: the same.
pub(super) const PEG: [[f64; 3]; 3] = [
    [80.0, 0.012, 0.964],
    [18.0, 0.065, 1.172],
    [8.0, 0.405, 3.234],
];

/// Tables 3.1 and 3.2: model, voxel, lattice, voxels, dense MB, chunks, active chunks, active MB. Voxels
/// and dense memory are table 3.1's, before chunks.
pub(super) const MODELS: [[&str; 8]; 5] = [
    [
        "cellular foam 1",
        "0.032",
        "314 × 320 × 604",
        "60689920",
        "121.4",
        "1900",
        "1669",
        "109.4",
    ],
    [
        "trabecular 2",
        "0.032",
        "314 × 316 × 360",
        "35720640",
        "71.4",
        "1200",
        "1060",
        "69.5",
    ],
    [
        "trabecular 1",
        "0.032",
        "156 × 156 × 313",
        "7617168",
        "15.2",
        "250",
        "250",
        "16.4",
    ],
    [
        "scapula",
        "0.47, 0.47, 1",
        "256 × 234 × 201",
        "12040704",
        "24.1",
        "896",
        "202",
        "13.2",
    ],
    [
        "glenoid",
        "0.47, 0.47, 1",
        "49 × 81 × 41",
        "162729",
        "0.3",
        "18",
        "18",
        "1.2",
    ],
];
