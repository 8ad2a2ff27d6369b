//! A vector whose first value lies on a cache line, so that no line of voxels straddles two.

/// Bytes of a cache line.
const CACHE_LINE: usize = 64;

/// Values in one run that begins on a cache line.
#[derive(Default)]
pub(crate) struct Aligned<T> {
    raw: Vec<T>,
    // values before the first one that lies on a cache line
    skip: usize,
}

impl<T: Copy + Default> Aligned<T> {
    /// `len` times `value`.
    pub(crate) fn filled(value: T, len: usize) -> Self {
        let mut all = Self::with_capacity(len);
        all.raw.resize(all.skip + len, value);
        all
    }

    fn with_capacity(len: usize) -> Self {
        // a cache line's values of slack, whatever the size of one
        let mut raw: Vec<T> = Vec::with_capacity(len + CACHE_LINE);
        let skip = raw.as_ptr().align_offset(CACHE_LINE).min(CACHE_LINE);
        raw.resize(skip, T::default());
        Self { raw, skip }
    }

    /// Adds values at the end; moves all of them where there is no room.
    pub(crate) fn extend(&mut self, values: &[T]) {
        if self.raw.len() + values.len() > self.raw.capacity() {
            let mut bigger = Self::with_capacity(2 * self.len() + values.len());
            bigger.raw.extend_from_slice(self);
            *self = bigger;
        }
        self.raw.extend_from_slice(values);
    }
}

impl<T: core::fmt::Debug> core::fmt::Debug for Aligned<T> {
    // where the values lie is no part of them
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: Copy + Default> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::with_capacity(self.len());
        copy.raw.extend_from_slice(self);
        copy
    }
}

impl<T> core::ops::Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.raw[self.skip..]
    }
}

impl<T> core::ops::DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.raw[self.skip..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_a_line<T>(values: &[T]) -> bool {
        values.as_ptr().align_offset(CACHE_LINE) == 0
    }

    #[test]
    fn filled_grown_and_copied_runs_begin_on_a_cache_line() {
        let mut grown = Aligned::<i16>::default();
        let mut bytes = Aligned::<u8>::default();
        for n in 0..40i16 {
            grown.extend(&[n; 700]);
            bytes.extend(&[1; 33]);
            assert!(on_a_line(&grown) && on_a_line(&bytes));
        }
        assert_eq!(grown.len(), 28_000);
        assert!(grown.chunks(700).zip(0..).all(|(c, n)| c == [n; 700]));
        let copy = grown.clone();
        assert!(on_a_line(&copy) && copy[..] == grown[..]);
        assert!(on_a_line(&Aligned::filled(7i16, 100)));
    }
}
