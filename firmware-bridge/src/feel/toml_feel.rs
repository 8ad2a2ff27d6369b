//! Parameters from TOML: `firmware-bridge/feel/standard.toml` has all of them.

use super::FeelFileError;
use osteon_sim_core::feel::{FIELDS, Feel};
use std::io::Read as _;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

/// Longest file of parameters, bytes.
const MAX_BYTES: u64 = 1 << 16;
/// Longest piece of a file that a message repeats, characters.
const MAX_ECHO: usize = 60;

/// Reads a file of parameters.
pub(crate) fn load(path: &Path) -> Result<Feel, FeelFileError> {
    parse(path, &read(path)?)
}

fn read(path: &Path) -> Result<Vec<u8>, FeelFileError> {
    let fault = |reason: String| FeelFileError::Read {
        path: path.to_owned(),
        reason,
    };
    // asked first: opening a pipe would wait for its writer
    let about = std::fs::metadata(path).map_err(|e| fault(e.to_string()))?;
    if !about.is_file() || about.len() > MAX_BYTES {
        return Err(fault("no regular file of at most 64 KiB".to_owned()));
    }
    let mut bytes = Vec::new();
    std::fs::File::open(path)
        .and_then(|f| f.take(MAX_BYTES).read_to_end(&mut bytes))
        .map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// Parameters of a file's bytes over the defaults; `path` is for messages.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Feel, FeelFileError> {
    let text = std::str::from_utf8(bytes).map_err(|e| FeelFileError::Syntax {
        path: path.to_owned(),
        line: line(bytes, e.valid_up_to()),
        problem: "is not UTF-8 text; save the file as UTF-8".to_owned(),
    })?;
    let table = DeTable::parse(text).map_err(|e| FeelFileError::Syntax {
        path: path.to_owned(),
        line: line(bytes, e.span().map_or(0, |s| s.start)),
        problem: e.message().replace('\n', " "),
    })?;
    let mut reader = Reader {
        path,
        bytes,
        feel: Feel::default(),
        seen: Vec::new(),
    };
    for (key, value) in table.get_ref() {
        match value.get_ref() {
            DeValue::Table(inner) if is_table(key.get_ref()) => {
                for (name, value) in inner {
                    let full = format!("{}.{}", key.get_ref(), name.get_ref());
                    reader.set(&full, name, value.get_ref())?;
                }
            }
            other => reader.set(key.get_ref(), key, other)?,
        }
    }
    Ok(reader.feel)
}

/// Line, from 1, of a byte.
fn line(bytes: &[u8], at: usize) -> usize {
    let before = bytes.iter().take(at);
    before.filter(|b| **b == b'\n').count() + 1
}

/// Whether parameters lie in a table of this name.
fn is_table(name: &str) -> bool {
    FIELDS.iter().any(|f| {
        f.key
            .split_once('.')
            .is_some_and(|(table, _)| table == name)
    })
}

struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    feel: Feel,
    seen: Vec<String>,
}

impl Reader<'_> {
    fn set(
        &mut self,
        key: &str,
        at: &Spanned<DeString<'_>>,
        value: &DeValue<'_>,
    ) -> Result<(), FeelFileError> {
        let shown = echo(key);
        if !FIELDS.iter().any(|f| f.key == key) {
            return Err(self.fault(at, format!("{shown}: {}", unknown(key))));
        }
        if self.seen.iter().any(|k| k == key) {
            return Err(self.fault(at, format!("{shown}: given twice; keep one of the two")));
        }
        self.seen.push(key.to_owned());
        let Some(number) = number(value) else {
            let kind = value.type_str();
            return Err(self.fault(at, format!("{shown}: is of type {kind}; give a number")));
        };
        match self.feel.set(key, number) {
            Some(Err(e)) => Err(self.fault(at, format!("{e}; give a value in that range"))),
            Some(Ok(())) | None => Ok(()),
        }
    }

    fn fault(&self, at: &Spanned<DeString<'_>>, problem: String) -> FeelFileError {
        FeelFileError::Key {
            path: self.path.to_owned(),
            line: line(self.bytes, at.span().start),
            problem,
        }
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(v) => v.as_str().parse().ok(),
        DeValue::Integer(v) if v.radix() == 10 => v.as_str().parse().ok(),
        DeValue::Integer(v) => i64::from_str_radix(v.as_str(), v.radix())
            .ok()
            .map(|v| v as f64),
        _ => None,
    }
}

fn echo(key: &str) -> String {
    let short: String = key.chars().take(MAX_ECHO).collect();
    short.escape_debug().to_string()
}

/// What to say about a key that there is not.
fn unknown(key: &str) -> String {
    if is_table(key) {
        return format!(
            "is a table of parameters, not one; write [{key}] and its parameters below"
        );
    }
    format!(
        "no such parameter; the nearest is {} (firmware-bridge/feel/standard.toml has all)",
        nearest(key)
    )
}

/// The known key that is most like another one: of the same name in another table, or with the
/// fewest letters changed.
fn nearest(key: &str) -> &'static str {
    let key: String = key.chars().take(MAX_ECHO).collect();
    let name = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let unlike = |known: &str| {
        let other_name = name(known) != name(&key);
        (other_name, distance(known.as_bytes(), key.as_bytes()))
    };
    FIELDS
        .iter()
        .min_by_key(|f| unlike(f.key))
        .map_or("force_scale", |f| f.key)
}

/// Levenshtein distance: bytes to insert, drop or change.
fn distance(a: &[u8], b: &[u8]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
