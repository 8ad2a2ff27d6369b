//! A seeded source of numbers (`SplitMix64`): the same on every machine.

/// The source.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// A source from a seed; seeds next to each other give unlike numbers.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number in `0..below`; 0 where `below` is 0.
    pub fn below(&mut self, below: usize) -> usize {
        #[expect(clippy::cast_possible_truncation, reason = "smaller than `below`")]
        let n = (self.bits() % (below.max(1) as u64)) as usize;
        n
    }

    /// One of `0..3`: a joint.
    pub fn joint(&mut self) -> usize {
        self.below(3)
    }

    /// A number in `lo..=hi`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "small ranges"
    )]
    pub fn within(&mut self, lo: i32, hi: i32) -> i32 {
        lo + self.below((hi - lo + 1).max(1) as usize) as i32
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Normal with mean 0 and deviation 1: the sum of twelve uniform numbers less six.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}
