//! The thesis's scan of a 32³ chunk in wide registers; the same voxels as the scalar form.
#![cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "loads, gathers and stores of std::arch, and the call of a function for a wider machine"
    )
)]

use super::place::Cells;
use super::thesis;

/// Instructions that a scan runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512 F and BW: 32 voxels are loaded, 16 transformed at a time.
    Avx512,
    /// AVX2: 8 voxels at a time.
    Avx2,
    /// One voxel at a time.
    Scalar,
}

impl Isa {
    /// The widest that this machine has.
    pub fn best() -> Self {
        [Self::Avx512, Self::Avx2]
            .into_iter()
            .find(|isa| isa.is_here())
            .unwrap_or(Self::Scalar)
    }

    /// Whether this machine has it.
    pub fn is_here(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return match self {
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw")
            }
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            Self::Scalar => true,
        };
        #[cfg(not(target_arch = "x86_64"))]
        return self == Self::Scalar;
    }
}

/// The scan of a 32³ chunk (x fastest) whose lowest voxel is `first`: sets active voxels in solid
/// cells to 0 and returns their number. The tool's grid comes as one bit a cell and as densities. An
/// `isa` that this machine lacks runs scalar.
pub(super) fn scan(
    isa: Isa,
    values: &mut [i16],
    first: [usize; 3],
    cells: &Cells,
    (bits, solid): (&[u32], &[i16]),
) -> u64 {
    wide_scan(isa, values, first, cells, bits)
        .unwrap_or_else(|| thesis::scalar::<32>(values, first, cells, solid))
}

#[cfg(target_arch = "x86_64")]
fn wide_scan(
    isa: Isa,
    values: &mut [i16],
    first: [usize; 3],
    cells: &Cells,
    bits: &[u32],
) -> Option<u64> {
    let [dx, dy, dz] = cells.dims;
    let fits = dx * dy * dz <= 32 * bits.len() && i32::try_from(dx * dy * dz).is_ok();
    if !fits || !isa.is_here() {
        return None;
    }
    match isa {
        // SAFETY: the machine has the instructions, and the bits hold every cell of the grid.
        Isa::Avx512 => Some(unsafe { wide::scan_avx512(values, first, cells, bits) }),
        // SAFETY: as above.
        Isa::Avx2 => Some(unsafe { wide::scan_avx2(values, first, cells, bits) }),
        Isa::Scalar => None,
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn wide_scan(_: Isa, _: &mut [i16], _: [usize; 3], _: &Cells, _: &[u32]) -> Option<u64> {
    None
}

#[cfg(target_arch = "x86_64")]
mod wide {
    #![expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "the caller has checked that every cell's index fits in an i32; masks are halved"
    )]

    use super::Cells;
    use core::arch::x86_64::{
        __m256, __m256i, __m512, __m512i, __mmask16, _CMP_GE_OQ, _CMP_LT_OQ, _mm_loadu_si128,
        _mm_testz_si128, _mm256_add_epi32, _mm256_add_ps, _mm256_and_ps, _mm256_and_si256,
        _mm256_castps_si256, _mm256_castsi256_ps, _mm256_cmp_ps, _mm256_cmpgt_epi32,
        _mm256_cvtepi16_epi32, _mm256_cvttps_epi32, _mm256_loadu_ps, _mm256_mask_i32gather_epi32,
        _mm256_movemask_ps, _mm256_mullo_epi32, _mm256_set1_epi32, _mm256_set1_ps,
        _mm256_setzero_ps, _mm256_setzero_si256, _mm256_sllv_epi32, _mm256_srli_epi32,
        _mm256_sub_epi32, _mm512_add_epi32, _mm512_add_ps, _mm512_and_si512, _mm512_cvttps_epi32,
        _mm512_loadu_epi16, _mm512_loadu_ps, _mm512_mask_cmp_ps_mask, _mm512_mask_i32gather_epi32,
        _mm512_mask_storeu_epi16, _mm512_mask_test_epi32_mask, _mm512_mullo_epi32,
        _mm512_set1_epi32, _mm512_set1_ps, _mm512_setzero_ps, _mm512_setzero_si512,
        _mm512_sllv_epi32, _mm512_srli_epi32, _mm512_test_epi16_mask,
    };

    /// A voxel's offset from its row's start, for 16 (8) voxels in a row: x, y, z in cells.
    fn offsets<const W: usize>(cells: &Cells, first_x: usize) -> [[f32; W]; 3] {
        let along: [[f32; 3]; W] = core::array::from_fn(|x| cells.along(first_x + x));
        core::array::from_fn(|a| along.map(|v| v[a]))
    }

    /// The tool's grid in registers of 16 lanes.
    struct Grid16 {
        words: *const i32,
        limit: [__m512; 3],
        dx: __m512i,
        dy: __m512i,
    }

    impl Grid16 {
        /// Which of the lanes in `active` lie in a solid cell.
        ///
        /// # Safety
        ///
        /// `words` holds a bit for every cell of the grid that `limit`, `dx` and `dy` describe.
        #[inline]
        #[target_feature(enable = "avx512f")]
        unsafe fn hits(&self, active: __mmask16, row: &[f32; 3], offset: &[__m512; 3]) -> u16 {
            let mut inside = active;
            let mut cell = [_mm512_setzero_si512(); 3];
            for a in 0..3 {
                let t = _mm512_add_ps(_mm512_set1_ps(row[a]), offset[a]);
                let zero = _mm512_setzero_ps();
                inside = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(inside, t, zero);
                inside = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(inside, t, self.limit[a]);
                cell[a] = _mm512_cvttps_epi32(t);
            }
            if inside == 0 {
                return 0;
            }
            let plane = _mm512_add_epi32(_mm512_mullo_epi32(cell[2], self.dy), cell[1]);
            let index = _mm512_add_epi32(_mm512_mullo_epi32(plane, self.dx), cell[0]);
            let word_index = _mm512_srli_epi32::<5>(index);
            let none = _mm512_setzero_si512();
            // SAFETY: only lanes inside the grid are read, and the words hold all its cells.
            let word =
                unsafe { _mm512_mask_i32gather_epi32::<4>(none, inside, word_index, self.words) };
            let bit = _mm512_and_si512(index, _mm512_set1_epi32(31));
            let bit = _mm512_sllv_epi32(_mm512_set1_epi32(1), bit);
            _mm512_mask_test_epi32_mask(inside, word, bit)
        }
    }

    /// # Safety
    ///
    /// The machine has AVX-512 F and BW; `bits` holds a bit for every cell of the grid, and a cell's
    /// index fits in an `i32`.
    #[target_feature(enable = "avx512f,avx512bw")]
    pub(super) unsafe fn scan_avx512(
        values: &mut [i16],
        first: [usize; 3],
        cells: &Cells,
        bits: &[u32],
    ) -> u64 {
        let grid = Grid16 {
            words: bits.as_ptr().cast(),
            limit: cells.dims.map(|n| _mm512_set1_ps(n as f32)),
            dx: _mm512_set1_epi32(cells.dims[0] as i32),
            dy: _mm512_set1_epi32(cells.dims[1] as i32),
        };
        let load = |o: [f32; 16]| {
            // SAFETY: an array of 16 values is read.
            unsafe { _mm512_loadu_ps(o.as_ptr()) }
        };
        let low = offsets::<16>(cells, first[0]).map(load);
        let high = offsets::<16>(cells, first[0] + 16).map(load);
        let mut removed = 0;
        for (n, row) in values.as_chunks_mut::<32>().0.iter_mut().enumerate() {
            // SAFETY: an array of 32 values is read.
            let density = unsafe { _mm512_loadu_epi16(row.as_ptr()) };
            let active = _mm512_test_epi16_mask(density, density);
            if active == 0 {
                continue;
            }
            let at = cells.row(first[1] + n % 32, first[2] + n / 32);
            // SAFETY: the words are those of this grid, by this function's own contract.
            let lower = unsafe { grid.hits(active as u16, &at, &low) };
            // SAFETY: as above.
            let upper = unsafe { grid.hits((active >> 16) as u16, &at, &high) };
            let hits = u32::from(lower) | u32::from(upper) << 16;
            if hits != 0 {
                let none = _mm512_setzero_si512();
                // SAFETY: at most the 32 values of the array are written.
                unsafe { _mm512_mask_storeu_epi16(row.as_mut_ptr(), hits, none) };
                removed += u64::from(hits.count_ones());
            }
        }
        removed
    }

    /// The tool's grid in registers of 8 lanes.
    struct Grid8 {
        words: *const i32,
        limit: [__m256; 3],
        dx: __m256i,
        dy: __m256i,
    }

    impl Grid8 {
        /// Which of the lanes in `active` (all bits of a lane, or none) lie in a solid cell; one bit
        /// a lane.
        ///
        /// # Safety
        ///
        /// `words` holds a bit for every cell of the grid that `limit`, `dx` and `dy` describe.
        #[inline]
        #[target_feature(enable = "avx2")]
        unsafe fn hits(&self, active: __m256i, row: &[f32; 3], offset: &[__m256; 3]) -> u32 {
            let mut inside = _mm256_castsi256_ps(active);
            let mut cell = [_mm256_setzero_si256(); 3];
            for a in 0..3 {
                let t = _mm256_add_ps(_mm256_set1_ps(row[a]), offset[a]);
                let from = _mm256_cmp_ps::<_CMP_GE_OQ>(t, _mm256_setzero_ps());
                let to = _mm256_cmp_ps::<_CMP_LT_OQ>(t, self.limit[a]);
                inside = _mm256_and_ps(inside, _mm256_and_ps(from, to));
                cell[a] = _mm256_cvttps_epi32(t);
            }
            if _mm256_movemask_ps(inside) == 0 {
                return 0;
            }
            let plane = _mm256_add_epi32(_mm256_mullo_epi32(cell[2], self.dy), cell[1]);
            let index = _mm256_add_epi32(_mm256_mullo_epi32(plane, self.dx), cell[0]);
            let word_index = _mm256_srli_epi32::<5>(index);
            let none = _mm256_setzero_si256();
            let mask = _mm256_castps_si256(inside);
            // SAFETY: only lanes inside the grid are read, and the words hold all its cells.
            let word =
                unsafe { _mm256_mask_i32gather_epi32::<4>(none, self.words, word_index, mask) };
            // the cell's bit to the lane's sign
            let bit = _mm256_and_si256(index, _mm256_set1_epi32(31));
            let sign = _mm256_sllv_epi32(word, _mm256_sub_epi32(_mm256_set1_epi32(31), bit));
            _mm256_movemask_ps(_mm256_castsi256_ps(sign)).cast_unsigned()
        }
    }

    /// # Safety
    ///
    /// The machine has AVX2; `bits` holds a bit for every cell of the grid, and a cell's index fits
    /// in an `i32`.
    #[target_feature(enable = "avx2")]
    pub(super) unsafe fn scan_avx2(
        values: &mut [i16],
        first: [usize; 3],
        cells: &Cells,
        bits: &[u32],
    ) -> u64 {
        let grid = Grid8 {
            words: bits.as_ptr().cast(),
            limit: cells.dims.map(|n| _mm256_set1_ps(n as f32)),
            dx: _mm256_set1_epi32(cells.dims[0] as i32),
            dy: _mm256_set1_epi32(cells.dims[1] as i32),
        };
        let load = |o: [f32; 8]| {
            // SAFETY: an array of 8 values is read.
            unsafe { _mm256_loadu_ps(o.as_ptr()) }
        };
        let offset: [[__m256; 3]; 4] =
            core::array::from_fn(|part| offsets::<8>(cells, first[0] + 8 * part).map(load));
        let mut removed = 0;
        for (n, eight) in values.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            // SAFETY: an array of 8 values is read.
            let density = unsafe { _mm_loadu_si128(eight.as_ptr().cast()) };
            if _mm_testz_si128(density, density) == 1 {
                continue;
            }
            let density = _mm256_cvtepi16_epi32(density);
            // densities are never negative
            let active = _mm256_cmpgt_epi32(density, _mm256_setzero_si256());
            let at = cells.row(first[1] + n / 4 % 32, first[2] + n / 128);
            // SAFETY: the words are those of this grid, by this function's own contract.
            let hits = unsafe { grid.hits(active, &at, &offset[n % 4]) };
            for (lane, value) in eight.iter_mut().enumerate() {
                if hits >> lane & 1 != 0 {
                    *value = 0;
                }
            }
            removed += u64::from(hits.count_ones());
        }
        removed
    }
}
