//! Vector units chosen at run time: one source, the same bits on all of them.
//!
//! A line of voxels is 32 stored distances (`i16`) and 2 × 16 distances (`f32`). [`Lanes`] is what the
//! carving kernel needs of a vector unit; every operation is exact or correctly rounded, none is fused,
//! so that portable code, AVX2 and AVX-512 give the same bits. [`dispatch`] runs a job with the
//! unit's instructions enabled (by `pulp`, which holds the `unsafe` that this takes).

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use portable::Portable;

/// An instruction set that the carving kernel can run on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// What every processor of this architecture has.
    Portable,
    /// 256-bit vectors (x86-64-v3).
    Avx2,
    /// 512-bit vectors with 16-bit lanes (x86-64-v4).
    Avx512,
}

impl Isa {
    /// All, the narrowest first.
    pub const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// Whether this processor has it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => pulp::x86::V3::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => pulp::x86::V4::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// The widest that this processor has.
    pub fn best() -> Self {
        let available = Self::ALL.into_iter().rev().find(|isa| isa.is_available());
        available.unwrap_or(Self::Portable)
    }

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

/// A vector unit. Values of 16 `f32` ([`Self::F`]), 32 `i16` ([`Self::I`]) and 16 sums in `i32`
/// ([`Self::S`]). All of it must be inlined into a job.
pub(crate) trait Lanes: Copy {
    /// 16 `f32`.
    type F: Copy;
    /// 32 `i16`.
    type I: Copy;
    /// Sums in `i32`; only their total has a meaning.
    type S: Copy;

    fn splat(self, value: f32) -> Self::F;
    fn load(self, values: &[f32; 16]) -> Self::F;
    fn store(self, values: Self::F) -> [f32; 16];
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    fn sqrt(self, a: Self::F) -> Self::F;
    fn abs(self, a: Self::F) -> Self::F;
    /// One bit a lane, set where `a ≤ b`.
    fn le(self, a: Self::F, b: Self::F) -> u16;
    /// Rounds to the nearest integer (ties to even), clamped to ±32767; groups of four from `low` and
    /// `high` in turn (`|values| < 2³¹`).
    fn round(self, low: Self::F, high: Self::F) -> Self::I;

    fn splat_i(self, value: i16) -> Self::I;
    fn load_i(self, values: &[i16; 32]) -> Self::I;
    fn store_i(self, values: Self::I, to: &mut [i16; 32]);
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I;
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// Wrapping difference.
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I;
    /// `seen` with further bits wherever `a` and `b` differ.
    fn note_difference(self, seen: Self::I, a: Self::I, b: Self::I) -> Self::I;
    /// Whether any lane of `a` is less than that of `b`.
    fn any_less(self, a: Self::I, b: Self::I) -> bool;
    /// One bit a lane that is not zero.
    fn not_zero(self, a: Self::I) -> u32;
    /// One bit a byte that equals `byte`.
    fn equal_bytes(self, bytes: &[u8; 32], byte: u8) -> u32;
    /// Lanes without their bit in `mask` become zero.
    fn keep(self, a: Self::I, mask: u32) -> Self::I;

    fn no_sums(self) -> Self::S;
    /// `sums` + products of lanes (their pairs fit an `i32`).
    fn add_products(self, sums: Self::S, a: Self::I, b: Self::I) -> Self::S;
    fn total(self, sums: Self::S) -> i64;
}

/// Something to be run on a vector unit.
pub(crate) trait Job {
    /// What it gives.
    type Output;
    /// To be marked `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Runs a job on `isa`, or on portable code where the processor lacks it.
pub(crate) fn dispatch<J: Job>(isa: Isa, job: J) -> J::Output {
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => match pulp::x86::V4::try_new() {
            Some(unit) => x86::run_wide(unit, job),
            None => job.run(Portable),
        },
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => match pulp::x86::V3::try_new() {
            Some(unit) => x86::run(unit, job),
            None => job.run(Portable),
        },
        _ => job.run(Portable),
    }
}

#[cfg(test)]
mod tests;
