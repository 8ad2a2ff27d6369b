//! What the viewer remembers from one session to the next: how the bone was shown and which panels
//! were open.

use crate::panels::plots::Quantity;
use crate::render::look::ViewChoice;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The choices that are kept.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Remembered {
    /// How the bone was shown.
    pub(crate) view: ViewChoice,
    /// Whether the CT slices were open.
    pub(crate) slices: bool,
    /// Whether the plots were open.
    pub(crate) plots: bool,
    /// What they showed, left and right.
    pub(crate) quantities: [Quantity; 2],
}

impl Default for Remembered {
    fn default() -> Self {
        Self {
            view: ViewChoice::default(),
            slices: true,
            plots: true,
            quantities: [Quantity::Force, Quantity::Depth],
        }
    }
}

/// Most bytes of the file that are believed.
const MOST_BYTES: u64 = 1 << 16;

/// `viewer.json` in the user's folder of settings; `None` where there is none.
pub(crate) fn path() -> Option<PathBuf> {
    let named = |name: &str| {
        std::env::var_os(name)
            .filter(|v| !v.is_empty())
            .map(PathBuf::from)
    };
    let folder = named("XDG_CONFIG_HOME").or_else(|| Some(named("HOME")?.join(".config")))?;
    Some(folder.join("osteon").join("viewer.json"))
}

/// Reads the choices; the usual ones where there is no file, or one that makes no sense.
pub(crate) fn read(path: &Path) -> Remembered {
    let small = std::fs::metadata(path).is_ok_and(|m| m.len() <= MOST_BYTES);
    let text = small.then(|| std::fs::read_to_string(path).ok()).flatten();
    text.and_then(|t| serde_json::from_str(&t).ok())
        .unwrap_or_default()
}

/// Writes the choices, whole or not at all.
pub(crate) fn write(path: &Path, remembered: &Remembered) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let own = path.with_extension(format!("{}.new", std::process::id()));
    std::fs::write(&own, serde_json::to_string_pretty(remembered)? + "\n")?;
    std::fs::rename(&own, path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::method::Kind;

    #[test]
    fn what_was_written_is_read_and_nonsense_is_the_usual() {
        let folder = std::env::temp_dir().join(format!("osteon-memory-{}", std::process::id()));
        let path = folder.join("a/viewer.json");
        assert_eq!(read(&path), Remembered::default());
        let mut other = Remembered {
            slices: false,
            ..Remembered::default()
        };
        other.view.method = Kind::Splats;
        write(&path, &other).unwrap();
        assert_eq!(read(&path), other);
        for text in [
            "",
            "{",
            "[1]",
            "{\"view\": {\"method\": \"no such\"}}",
            "{\"slices\": 3}",
        ] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(read(&path), Remembered::default(), "{text}");
        }
        // a later version's field is no harm, a missing one is the usual
        std::fs::write(&path, "{\"plots\": false, \"new\": 1}").unwrap();
        assert!(!read(&path).plots && read(&path).slices);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
