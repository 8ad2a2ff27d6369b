//! Tissue classes and the material law's density.

/// What a voxel is made of. The value is stored in a byte and sent on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Tissue {
    /// Not bone.
    Air = 0,
    /// Articular cartilage: below any bone threshold, so only the solid field knows its surface.
    Cartilage = 1,
    /// The hard plate under a joint face.
    Subchondral = 2,
    /// Soft spongy bone.
    Cancellous = 3,
    /// Hard outer shell away from the joint.
    Cortical = 4,
}

/// Length of tables indexed by tissue class (a power of two above the highest class).
pub const TISSUES: usize = 8;

impl Tissue {
    /// All classes in the order of their values.
    pub const ALL: [Self; 5] = [
        Self::Air,
        Self::Cartilage,
        Self::Subchondral,
        Self::Cancellous,
        Self::Cortical,
    ];

    /// The name used in reports and on the screen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Air => "air",
            Self::Cartilage => "cartilage",
            Self::Subchondral => "subchondral",
            Self::Cancellous => "cancellous",
            Self::Cortical => "cortical",
        }
    }
}

/// Slope of apparent density over CT number, g/cm³ per HU (Rho et al. 1995, as commonly cited;
/// scanner-dependent).
pub const DENSITY_PER_HU: f64 = 0.001_067;
/// Apparent density at 0 HU, g/cm³.
pub const DENSITY_AT_ZERO_HU: f64 = 0.131;

/// Apparent density in g/cm³ of a CT number in HU; never below 0.05.
pub fn density_g_cm3(hu: f64) -> f64 {
    (DENSITY_AT_ZERO_HU + DENSITY_PER_HU * hu).max(0.05)
}

/// The CT number, HU, that [`density_g_cm3`] maps to `density` g/cm³.
pub fn hu_of_density(density: f64) -> f64 {
    (density - DENSITY_AT_ZERO_HU) / DENSITY_PER_HU
}
