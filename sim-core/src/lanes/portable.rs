//! Portable lanes: plain loops over arrays, which a compiler turns into whatever the target has.
#![expect(
    clippy::inline_always,
    reason = "lanes must melt into the job that uses them"
)]

use super::Lanes;

/// Arrays and loops.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn each<T: Copy, const N: usize>(a: [T; N], b: [T; N], f: impl Fn(T, T) -> T) -> [T; N] {
    let mut out = a;
    for n in 0..N {
        out[n] = f(a[n], b[n]);
    }
    out
}

// 1.5 · 2²³: adding it leaves the integer, rounded to nearest even, in the low bits
const MAGIC: f32 = 12_582_912.0;

#[inline(always)]
fn round_one(value: f32) -> i16 {
    let bounded = value.clamp(-32767.0, 32767.0);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the low 16 bits are the integer"
    )]
    let integer = (bounded + MAGIC).to_bits() as i16;
    integer
}

impl Lanes for Portable {
    type F = [f32; 16];
    type I = [i16; 32];
    type S = [i32; 16];

    #[inline(always)]
    fn splat(self, value: f32) -> Self::F {
        [value; 16]
    }
    #[inline(always)]
    fn load(self, values: &[f32; 16]) -> Self::F {
        *values
    }
    #[inline(always)]
    fn store(self, values: Self::F) -> [f32; 16] {
        values
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        each(a, a, |a, _| a.sqrt())
    }
    #[inline(always)]
    fn abs(self, a: Self::F) -> Self::F {
        each(a, a, |a, _| a.abs())
    }
    #[inline(always)]
    fn le(self, a: Self::F, b: Self::F) -> u16 {
        (0..16).fold(0, |mask, n| mask | u16::from(a[n] <= b[n]) << n)
    }
    #[inline(always)]
    fn round(self, low: Self::F, high: Self::F) -> Self::I {
        let mut out = [0; 32];
        for group in 0..4 {
            for n in 0..4 {
                out[8 * group + n] = round_one(low[4 * group + n]);
                out[8 * group + 4 + n] = round_one(high[4 * group + n]);
            }
        }
        out
    }

    #[inline(always)]
    fn splat_i(self, value: i16) -> Self::I {
        [value; 32]
    }
    #[inline(always)]
    fn load_i(self, values: &[i16; 32]) -> Self::I {
        *values
    }
    #[inline(always)]
    fn store_i(self, values: Self::I, to: &mut [i16; 32]) {
        *to = values;
    }
    #[inline(always)]
    fn min_i(self, a: Self::I, b: Self::I) -> Self::I {
        each(a, b, i16::min)
    }
    #[inline(always)]
    fn max_i(self, a: Self::I, b: Self::I) -> Self::I {
        each(a, b, i16::max)
    }
    #[inline(always)]
    fn sub_i(self, a: Self::I, b: Self::I) -> Self::I {
        each(a, b, i16::wrapping_sub)
    }
    #[inline(always)]
    fn note_difference(self, seen: Self::I, a: Self::I, b: Self::I) -> Self::I {
        each(seen, each(a, b, |a, b| a ^ b), |a, b| a | b)
    }
    #[inline(always)]
    fn any_less(self, a: Self::I, b: Self::I) -> bool {
        (0..32).fold(0, |any, n| any | u8::from(a[n] < b[n])) != 0
    }
    #[inline(always)]
    fn not_zero(self, a: Self::I) -> u32 {
        (0..32).fold(0, |mask, n| mask | u32::from(a[n] != 0) << n)
    }
    #[inline(always)]
    fn equal_bytes(self, bytes: &[u8; 32], byte: u8) -> u32 {
        (0..32).fold(0, |mask, n| mask | u32::from(bytes[n] == byte) << n)
    }
    #[inline(always)]
    fn keep(self, a: Self::I, mask: u32) -> Self::I {
        let mut out = a;
        for (n, lane) in out.iter_mut().enumerate() {
            if mask >> n & 1 == 0 {
                *lane = 0;
            }
        }
        out
    }

    #[inline(always)]
    fn no_sums(self) -> Self::S {
        [0; 16]
    }
    #[inline(always)]
    fn add_products(self, sums: Self::S, a: Self::I, b: Self::I) -> Self::S {
        let mut out = sums;
        for (n, sum) in out.iter_mut().enumerate() {
            let product = |n: usize| i32::from(a[n]) * i32::from(b[n]);
            *sum = sum
                .wrapping_add(product(2 * n))
                .wrapping_add(product(2 * n + 1));
        }
        out
    }
    #[inline(always)]
    fn total(self, sums: Self::S) -> i64 {
        sums.iter().map(|&s| i64::from(s)).sum()
    }
}
