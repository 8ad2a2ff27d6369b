//! AVX2 and AVX-512 lanes.
#![expect(
    clippy::inline_always,
    reason = "lanes must melt into the job that uses them"
)]

use super::{Job, Lanes};
use core::arch::x86_64::{__m256, __m256i, __m512, __m512i, _CMP_LE_OQ as LESS_OR_EQUAL};
use pulp::NullaryFnOnce;
use pulp::cast;
use pulp::x86::{V3, V4};

struct On<L, J>(L, J);

impl<L: Lanes, J: Job> NullaryFnOnce for On<L, J> {
    type Output = J::Output;

    #[inline(always)]
    fn call(self) -> J::Output {
        self.1.run(self.0)
    }
}

/// Runs a job with AVX2.
pub(super) fn run<J: Job>(unit: V3, job: J) -> J::Output {
    unit.vectorize(On(unit, job))
}

/// Runs a job with AVX-512.
pub(super) fn run_wide<J: Job>(unit: V4, job: J) -> J::Output {
    unit.vectorize(On(unit, job))
}

impl Lanes for V4 {
    type F = __m512;
    type I = __m512i;
    type S = __m512i;

    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        self.avx512f._mm512_set1_ps(value)
    }
    #[inline(always)]
    fn load(self, values: &[f32; 16]) -> Self::F {
        cast(*values)
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; 16] {
        cast(values)
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_add_ps(a, b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_sub_ps(a, b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_mul_ps(a, b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_div_ps(a, b)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_min_ps(a, b)
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        self.avx512f._mm512_max_ps(a, b)
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        self.avx512f._mm512_sqrt_ps(a)
    }
    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        self.avx512f._mm512_abs_ps(a)
    }
    #[inline(always)]
    fn le(self, a: Self::F, b: Self::F) -> u16 {
        self.avx512f._mm512_cmp_ps_mask::<LESS_OR_EQUAL>(a, b)
    }
    #[inline(always)]
    fn round(self, low: Self::F, high: Self::F) -> Self::I {
        let low = self.avx512f._mm512_cvtps_epi32(low);
        let high = self.avx512f._mm512_cvtps_epi32(high);
        let packed = self.avx512bw._mm512_packs_epi32(low, high);
        self.max_i(packed, self.splat_i(-i16::MAX))
    }

    #[inline(always)]
    fn splat_i(self, value: i16) -> Self::I {
        self.avx512f._mm512_set1_epi16(value)
    }
    #[inline(always)]
    fn load_i(self, values: &[i16; 32]) -> Self::I {
        cast(*values)
    }
    #[inline(always)]
    fn store_i(self, values: Self::I, to: &mut [i16; 32]) {
        *to = cast(values);
    }
    #[inline(always)]
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I {
        self.avx512bw._mm512_min_epi16(a, b)
    }
    #[inline(always)]
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I {
        self.avx512bw._mm512_max_epi16(a, b)
    }
    #[inline(always)]
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I {
        self.avx512bw._mm512_sub_epi16(a, b)
    }
    #[inline(always)]
    fn note_difference(self, seen: Self::I, a: Self::I, b: Self::I) -> Self::I {
        // seen | (a ^ b)
        self.avx512f
            ._mm512_ternarylogic_epi32::<0b1111_0110>(seen, a, b)
    }
    #[inline(always)]
    fn any_less(self, a: Self::I, b: Self::I) -> bool {
        self.avx512bw._mm512_cmplt_epi16_mask(a, b) != 0
    }
    #[inline(always)]
    fn not_zero(self, a: Self::I) -> u32 {
        self.avx512bw._mm512_test_epi16_mask(a, a)
    }
    #[inline(always)]
    fn equal_bytes(self, bytes: &[u8; 32], byte: u8) -> u32 {
        let wanted: __m256i = cast([byte; 32]);
        self.avx512bw._mm256_cmpeq_epi8_mask(cast(*bytes), wanted)
    }
    #[inline(always)]
    fn keep(self, a: Self::I, mask: u32) -> Self::I {
        self.avx512bw._mm512_maskz_mov_epi16(mask, a)
    }

    #[inline(always)]
    fn no_sums(self) -> Self::S {
        cast([0i32; 16])
    }
    #[inline(always)]
    fn add_products(self, sums: Self::S, a: Self::I, b: Self::I) -> Self::S {
        let products = self.avx512bw._mm512_madd_epi16(a, b);
        self.avx512f._mm512_add_epi32(sums, products)
    }
    #[inline(always)]
    fn total(self, sums: Self::S) -> i64 {
        let lanes: [i32; 16] = cast(sums);
        lanes.iter().map(|&s| i64::from(s)).sum()
    }
}

/// Both halves of 16 lanes.
#[inline(always)]
fn both<T: Copy>(a: [T; 2], b: [T; 2], f: impl Fn(T, T) -> T) -> [T; 2] {
    [f(a[0], b[0]), f(a[1], b[1])]
}

impl Lanes for V3 {
    type F = [__m256; 2];
    type I = [__m256i; 2];
    type S = [__m256i; 2];

    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        [self.avx._mm256_set1_ps(value); 2]
    }
    #[inline(always)]
    fn load(self, values: &[f32; 16]) -> Self::F {
        cast(*values)
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; 16] {
        cast(values)
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_add_ps(a, b))
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_sub_ps(a, b))
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_mul_ps(a, b))
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_div_ps(a, b))
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_min_ps(a, b))
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        both(a, b, |a, b| self.avx._mm256_max_ps(a, b))
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        [self.avx._mm256_sqrt_ps(a[0]), self.avx._mm256_sqrt_ps(a[1])]
    }
    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        let sign = self.splat(-0.0);
        [
            self.avx._mm256_andnot_ps(sign[0], a[0]),
            self.avx._mm256_andnot_ps(sign[1], a[1]),
        ]
    }
    #[inline(always)]
    fn le(self, a: Self::F, b: Self::F) -> u16 {
        let half = |n: usize| {
            let less = self.avx._mm256_cmp_ps::<LESS_OR_EQUAL>(a[n], b[n]);
            self.avx._mm256_movemask_ps(less)
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "sixteen bits"
        )]
        let mask = (half(0) | half(1) << 8) as u16;
        mask
    }
    #[inline(always)]
    fn round(self, low: Self::F, high: Self::F) -> Self::I {
        let half = |n: usize| {
            let low = self.avx._mm256_cvtps_epi32(low[n]);
            let high = self.avx._mm256_cvtps_epi32(high[n]);
            self.avx2._mm256_packs_epi32(low, high)
        };
        self.max_i([half(0), half(1)], self.splat_i(-i16::MAX))
    }

    #[inline(always)]
    fn splat_i(self, value: i16) -> Self::I {
        [self.avx._mm256_set1_epi16(value); 2]
    }
    #[inline(always)]
    fn load_i(self, values: &[i16; 32]) -> Self::I {
        cast(*values)
    }
    #[inline(always)]
    fn store_i(self, values: Self::I, to: &mut [i16; 32]) {
        *to = cast(values);
    }
    #[inline(always)]
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I {
        both(a, b, |a, b| self.avx2._mm256_min_epi16(a, b))
    }
    #[inline(always)]
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I {
        both(a, b, |a, b| self.avx2._mm256_max_epi16(a, b))
    }
    #[inline(always)]
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I {
        both(a, b, |a, b| self.avx2._mm256_sub_epi16(a, b))
    }
    #[inline(always)]
    fn note_difference(self, seen: Self::I, a: Self::I, b: Self::I) -> Self::I {
        let differ = both(a, b, |a, b| self.avx2._mm256_xor_si256(a, b));
        both(seen, differ, |a, b| self.avx2._mm256_or_si256(a, b))
    }
    #[inline(always)]
    fn any_less(self, a: Self::I, b: Self::I) -> bool {
        let less = both(a, b, |a, b| self.avx2._mm256_cmpgt_epi16(b, a));
        let any = self.avx2._mm256_or_si256(less[0], less[1]);
        self.avx2._mm256_movemask_epi8(any) != 0
    }
    #[inline(always)]
    fn not_zero(self, a: Self::I) -> u32 {
        let zero: __m256i = cast([0i16; 16]);
        let equal = a.map(|a| self.avx2._mm256_cmpeq_epi16(a, zero));
        // to one byte a lane, back in order
        let bytes = self.avx2._mm256_packs_epi16(equal[0], equal[1]);
        let ordered = self.avx2._mm256_permute4x64_epi64::<0b11_01_10_00>(bytes);
        #[expect(clippy::cast_sign_loss, reason = "a mask")]
        let mask = !self.avx2._mm256_movemask_epi8(ordered) as u32;
        mask
    }
    #[inline(always)]
    fn equal_bytes(self, bytes: &[u8; 32], byte: u8) -> u32 {
        let equal = self.avx2._mm256_cmpeq_epi8(cast(*bytes), cast([byte; 32]));
        #[expect(clippy::cast_sign_loss, reason = "a mask")]
        let mask = self.avx2._mm256_movemask_epi8(equal) as u32;
        mask
    }
    #[inline(always)]
    fn keep(self, a: Self::I, mask: u32) -> Self::I {
        let bits: __m256i = cast([
            1u16, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768,
        ]);
        let half = |a: __m256i, mask: u32| {
            #[expect(clippy::cast_possible_truncation, reason = "sixteen bits")]
            let spread = self.avx._mm256_set1_epi16(mask as i16);
            let own = self.avx2._mm256_and_si256(spread, bits);
            let wanted = self.avx2._mm256_cmpeq_epi16(own, bits);
            self.avx2._mm256_and_si256(a, wanted)
        };
        [half(a[0], mask & 0xffff), half(a[1], mask >> 16)]
    }

    #[inline(always)]
    fn no_sums(self) -> Self::S {
        cast([0i32; 16])
    }
    #[inline(always)]
    fn add_products(self, sums: Self::S, a: Self::I, b: Self::I) -> Self::S {
        let products = both(a, b, |a, b| self.avx2._mm256_madd_epi16(a, b));
        both(sums, products, |a, b| self.avx2._mm256_add_epi32(a, b))
    }
    #[inline(always)]
    fn total(self, sums: Self::S) -> i64 {
        let lanes: [i32; 16] = cast(sums);
        lanes.iter().map(|&s| i64::from(s)).sum()
    }
}
