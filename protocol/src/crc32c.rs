//! The two hashes of the wire: CRC-32C guards bytes, FNV-1a names a layout.

use crc::{CRC_32_ISCSI, Crc, Table};

// Sixteen tables (16 KiB) pay off on viewer messages; a microcontroller's flash is worth more.
#[cfg(feature = "std")]
type Lookup = Table<16>;
#[cfg(not(feature = "std"))]
type Lookup = Table<1>;

static CASTAGNOLI: Crc<u32, Lookup> = Crc::<u32, Lookup>::new(&CRC_32_ISCSI);

/// CRC-32C (Castagnoli: polynomial 0x1EDC6F41, reflected, initial value and final XOR all ones).
pub fn crc32c(bytes: &[u8]) -> u32 {
    CASTAGNOLI.checksum(bytes)
}

/// FNV-1a, 32 bits.
pub const fn fnv1a(bytes: &[u8]) -> u32 {
    let mut hash = 0x811C_9DC5_u32;
    let mut at = 0;
    while at < bytes.len() {
        hash = (hash ^ bytes[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    hash
}

#[cfg(test)]
#[expect(
    clippy::cast_possible_truncation,
    reason = "test patterns wrap on purpose"
)]
mod tests {
    use super::*;

    /// One bit at a time, from the definition: an oracle that shares nothing with the tables.
    fn bitwise(bytes: &[u8]) -> u32 {
        let mut crc = u32::MAX;
        for byte in bytes {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                // 0x82F63B78 is 0x1EDC6F41 with its bits in reverse order.
                crc = (crc >> 1) ^ (0x82F6_3B78 & (crc & 1).wrapping_neg());
            }
        }
        !crc
    }

    #[test]
    fn crc_meets_the_published_check_values() {
        assert_eq!(crc32c(b"123456789"), 0xE306_9283);
        // RFC 3720, B.4: 32 bytes of zeros, of ones, and counting up.
        assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
        assert_eq!(crc32c(&[0xFF; 32]), 0x62A8_AB43);
        let counting: [u8; 32] = core::array::from_fn(|n| n as u8);
        assert_eq!(crc32c(&counting), 0x46DD_794E);
    }

    #[test]
    fn crc_equals_the_bitwise_definition_at_every_length() {
        let bytes: [u8; 300] = core::array::from_fn(|n| (n * 7 + n / 5) as u8);
        for length in 0..bytes.len() {
            assert_eq!(crc32c(&bytes[..length]), bitwise(&bytes[..length]));
        }
    }

    #[test]
    fn fnv_meets_the_published_check_values() {
        assert_eq!(fnv1a(b""), 0x811C_9DC5);
        assert_eq!(fnv1a(b"a"), 0xE40C_292C);
        assert_eq!(fnv1a(b"foobar"), 0xBF9C_F968);
    }
}
