//! Every vector unit against portable code, and that against plain arithmetic.

use super::*;

const TIES: [f32; 16] = [
    -40_000.0, -32_767.5, -3.5, -2.5, -1.5, -0.5, -0.49, 0.0, 0.49, 0.5, 1.5, 2.5, 32_766.5,
    32_767.4, 40_000.0, 1.0e9,
];

/// Runs every operation once over inputs made from `seed` and gives all results as bytes.
struct Everything(u64);

impl Everything {
    fn random(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    #[expect(clippy::cast_possible_truncation, reason = "random bits")]
    fn integers(&mut self) -> [i16; 32] {
        core::array::from_fn(|n| if n % 7 == 0 { 0 } else { self.random() as i16 })
    }

    fn floats(&mut self) -> [f32; 16] {
        core::array::from_fn(|_| (self.random() as f32 - 1.0e9) * 1.0e-4)
    }
}

impl Job for Everything {
    type Output = Vec<u8>;

    #[expect(clippy::inline_always, reason = "a job melts into its unit")]
    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) -> Vec<u8> {
        let mut out = Vec::new();
        for round in 0..50 {
            let (fa, fb) = (self.floats(), if round == 0 { TIES } else { self.floats() });
            let (a, b) = (l.load(&fa), l.load(&fb));
            let square = l.mul(a, a);
            for v in [
                l.add(a, b),
                l.sub(a, b),
                l.mul(a, b),
                l.div(a, b),
                l.min(a, b),
                l.max(a, b),
                l.sqrt(square),
                l.abs(a),
                l.splat(3.0),
            ] {
                out.extend(l.store(v).iter().flat_map(|v| v.to_bits().to_le_bytes()));
            }
            out.extend(l.le(a, b).to_le_bytes());
            let (ia, ib) = (self.integers(), self.integers());
            let (x, y) = (l.load_i(&ia), l.load_i(&ib));
            let mask = u32::try_from(self.random()).unwrap_or(0x5a5a_1234);
            for v in [
                l.round(a, b),
                l.min_i(x, y),
                l.max_i(x, y),
                l.sub_i(x, y),
                l.keep(x, mask),
                l.note_difference(l.splat_i(2), x, y),
                l.splat_i(-7),
            ] {
                let mut to = [0; 32];
                l.store_i(v, &mut to);
                out.extend(to.iter().flat_map(|v| v.to_le_bytes()));
            }
            out.push(u8::from(l.any_less(x, y)));
            out.push(u8::from(l.any_less(x, l.min_i(x, y))));
            out.extend(l.not_zero(x).to_le_bytes());
            let bytes = ia.map(|v| v.to_le_bytes()[0] & 3);
            out.extend(l.equal_bytes(&bytes, 2).to_le_bytes());
            let (small, one) = (l.keep(x, 0x0f0f_0f0f), l.splat_i(1));
            let sums = l.add_products(l.no_sums(), small, one);
            out.extend(l.total(l.add_products(sums, y, one)).to_le_bytes());
        }
        out
    }
}

#[test]
fn every_unit_gives_the_bits_of_portable_code() {
    let portable = dispatch(Isa::Portable, Everything(9));
    let mut compared = 0;
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        assert!(dispatch(isa, Everything(9)) == portable, "{}", isa.name());
        compared += 1;
    }
    assert!(compared >= 1 && Isa::best().is_available());
}

#[test]
fn rounding_is_to_even_and_saturates() {
    struct Rounded;
    impl Job for Rounded {
        type Output = [i16; 32];
        #[expect(clippy::inline_always, reason = "a job melts into its unit")]
        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> [i16; 32] {
            let mut to = [0; 32];
            l.store_i(l.round(l.load(&TIES), l.splat(8.0)), &mut to);
            to
        }
    }
    let expected = [
        -32767, -32767, -4, -2, -2, 0, 0, 0, 0, 0, 2, 2, 32766, 32767, 32767, 32767,
    ];
    for isa in Isa::ALL {
        let got = dispatch(isa, Rounded);
        for (n, want) in expected.into_iter().enumerate() {
            assert_eq!(got[n / 4 * 8 + n % 4], want, "{} lane {n}", isa.name());
            assert_eq!(got[n / 4 * 8 + 4 + n % 4], 8);
        }
    }
}
