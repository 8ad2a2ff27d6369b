//! The processor's vectors, chosen at run time.
#![expect(
    clippy::inline_always,
    reason = "what uses a vector unit must melt into the job that is compiled for it"
)]

/// What the meshers need of a vector unit beyond what the compiler finds by itself.
pub(crate) trait Unit: Copy {
    /// One bit a value above zero.
    fn positive(self, values: &[i16; 32]) -> u32;
}

/// Something to be compiled for the vectors of this processor.
pub(crate) trait Job {
    /// What it gives.
    type Output;
    /// To be marked `#[inline(always)]`, as all that it calls.
    fn run<U: Unit>(self, unit: U) -> Self::Output;
}

/// Any processor.
#[derive(Debug, Clone, Copy)]
struct Portable;

impl Unit for Portable {
    #[inline(always)]
    fn positive(self, values: &[i16; 32]) -> u32 {
        let bits = values.iter().rev();
        bits.fold(0, |mask, &v| mask << 1 | u32::from(v > 0))
    }
}

/// Runs a job with the widest vectors of this processor.
pub(crate) fn dispatch<J: Job>(job: J) -> J::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(unit) = pulp::x86::V4::try_new() {
            return unit.vectorize(x86::On(unit, job));
        }
        if let Some(unit) = pulp::x86::V3::try_new() {
            return unit.vectorize(x86::On(unit, job));
        }
    }
    job.run(Portable)
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Job, Unit};
    use core::arch::x86_64::{__m256i, __m512i};
    use pulp::NullaryFnOnce;
    use pulp::cast;
    use pulp::x86::{V3, V4};

    pub(super) struct On<U, J>(pub(super) U, pub(super) J);

    impl<U: Unit, J: Job> NullaryFnOnce for On<U, J> {
        type Output = J::Output;

        #[inline(always)]
        fn call(self) -> J::Output {
            self.1.run(self.0)
        }
    }

    impl Unit for V4 {
        #[inline(always)]
        fn positive(self, values: &[i16; 32]) -> u32 {
            let values: __m512i = cast(*values);
            let zero = self.avx512f._mm512_setzero_si512();
            self.avx512bw._mm512_cmpgt_epi16_mask(values, zero)
        }
    }

    impl Unit for V3 {
        #[inline(always)]
        fn positive(self, values: &[i16; 32]) -> u32 {
            let [a, b]: [__m256i; 2] = cast(*values);
            let zero = self.avx._mm256_setzero_si256();
            let (a, b) = (
                self.avx2._mm256_cmpgt_epi16(a, zero),
                self.avx2._mm256_cmpgt_epi16(b, zero),
            );
            // packed by halves of 128 bits: the middle quarters change places
            let packed = self.avx2._mm256_packs_epi16(a, b);
            let ordered = self.avx2._mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
            self.avx2._mm256_movemask_epi8(ordered).cast_unsigned()
        }
    }

    #[cfg(test)]
    mod tests {
        use super::super::{Portable, Unit as _};
        use super::{V3, V4};

        #[test]
        fn all_units_see_the_same_signs() {
            let mut seed = 7u32;
            for _ in 0..200 {
                let values = core::array::from_fn(|_| {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    [0, 1, -1, i16::MAX, -i16::MAX, i16::MIN][(seed >> 16) as usize % 6]
                });
                let expected = Portable.positive(&values);
                for (n, v) in values.iter().enumerate() {
                    assert_eq!(expected >> n & 1 == 1, *v > 0);
                }
                assert!(V3::try_new().is_none_or(|u| u.positive(&values) == expected));
                assert!(V4::try_new().is_none_or(|u| u.positive(&values) == expected));
            }
        }
    }
}
