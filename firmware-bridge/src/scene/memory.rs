//! How much memory there is.

/// Most bytes that a voxel takes on the way to a bone: CT number, field and distance at 4 and label
/// at 1 while the surface is found, later 8 in the dense arrays beside 6 in the chunks; and some room.
const BYTES_PER_VOXEL: u64 = 16;

/// Bytes that a volume needs and that there are, where the latter are too few. `available` stands
/// for what the system says.
pub(super) fn shortage(voxels: usize, available: Option<u64>) -> Option<(u64, u64)> {
    let need = (voxels as u64).saturating_mul(BYTES_PER_VOXEL);
    let available = available.or_else(available_bytes)?;
    (need > available).then_some((need, available))
}

/// Bytes that can be allocated without driving the machine into its swap; `None` where the system
/// does not say (it does under `/proc/meminfo` on Linux).
fn available_bytes() -> Option<u64> {
    from_meminfo(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

fn from_meminfo(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_available_memory_is_read() {
        let text = "MemTotal:       24000000 kB\nMemAvailable:   16000001 kB\n";
        assert_eq!(from_meminfo(text), Some(16_000_001 * 1024));
        assert_eq!(from_meminfo("MemTotal: 1 kB\n"), None);
        assert_eq!(from_meminfo("MemAvailable: much kB\n"), None);
        assert_eq!(shortage(100, Some(1599)), Some((1600, 1599)));
        assert_eq!(shortage(100, Some(1600)), None);
        #[cfg(target_os = "linux")]
        assert!(available_bytes().is_some_and(|bytes| bytes > 1 << 20));
    }
}
