//! Keys for viewers on other machines: `osteon key new`, `show`, `trust`, and what reads them.
//!
//! Two files in a folder that only the user can enter: `identity` with the private key, `trusted` with
//! a line `PUBLIC-KEY NAME` for everybody who is let in, or connected to.

use anyhow::{Context as _, Result, bail};
use osteon_protocol::secure::{Identity, PublicKey};
use rustix::process::geteuid;
use std::fs::{self, DirBuilder, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// Longest name of a key, bytes.
const MAX_NAME: usize = 64;
/// Most keys that can be trusted.
const MAX_TRUSTED: usize = 256;

/// Make and show this user's key, say whose keys are trusted.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum KeyTask {
    /// Make this user's key; refused where there is one
    New(KeyArgs),
    /// Print this user's public key, for 'osteon key trust' on the other machine
    Show(KeyArgs),
    /// Let the owner of a public key connect, and connect to it
    Trust {
        /// Name for it, for people and for --peer: letters, digits, '-', '_', '.'
        name: String,
        /// Public key: 64 hexadecimal digits, as 'osteon key show' prints them there
        key: String,
        /// Where the keys are.
        #[command(flatten)]
        place: KeyArgs,
    },
}

/// Where the keys are.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct KeyArgs {
    /// Folder of the keys [default: osteon in the user's configuration folder]
    #[arg(long = "keys", value_name = "DIR")]
    pub keys: Option<PathBuf>,
}

impl KeyArgs {
    fn folder(&self) -> Result<PathBuf> {
        if let Some(folder) = &self.keys {
            return Ok(folder.clone());
        }
        let absolute = |name| {
            std::env::var_os(name)
                .map(PathBuf::from)
                .filter(|p| p.is_absolute())
        };
        let config =
            absolute("XDG_CONFIG_HOME").or_else(|| Some(absolute("HOME")?.join(".config")));
        let config = config.context("no folder for keys: HOME is not set; give --keys DIR")?;
        Ok(config.join("osteon"))
    }
}

/// One that is trusted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Trusted {
    /// Its name here.
    pub name: String,
    /// Its key.
    pub key: PublicKey,
}

/// Does what the command line asks.
pub fn run(task: &KeyTask) -> Result<()> {
    match task {
        KeyTask::New(place) => {
            let identity = new(&place.folder()?)?;
            say(&identity.public().to_hex());
        }
        KeyTask::Show(place) => say(&identity(place)?.public().to_hex()),
        KeyTask::Trust { name, key, place } => {
            trust(&place.folder()?, name, key)?;
            say(&format!("trusted from now on: {name}"));
        }
    }
    Ok(())
}

/// This user's key.
pub fn identity(place: &KeyArgs) -> Result<Identity> {
    let path = place.folder()?.join("identity");
    let text = read_private(&path)?.with_context(|| {
        format!(
            "no key at {}; make one with 'osteon key new'",
            path.display()
        )
    })?;
    Identity::from_secret_hex(text.trim()).with_context(|| {
        format!(
            "{}: not a key (64 hexadecimal digits); move it away and make one with 'osteon key new'",
            path.display()
        )
    })
}

/// Everybody who is trusted; nobody where there is no such file.
pub fn trusted(place: &KeyArgs) -> Result<Vec<Trusted>> {
    let path = place.folder()?.join("trusted");
    let text = read_private(&path)?.unwrap_or_default();
    let lines = text.lines().enumerate();
    let lines = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    lines
        .map(|(n, line)| {
            let parsed = line.split_once(' ').and_then(|(key, name)| {
                let key = PublicKey::from_hex(key)?;
                let name = name.trim().to_owned();
                is_name(&name).then_some(Trusted { name, key })
            });
            parsed.with_context(|| {
                format!(
                    "{}, line {}: not a public key of 64 hexadecimal digits, a blank and a name; correct or delete it",
                    path.display(),
                    n + 1
                )
            })
        })
        .collect()
}

/// The one to connect to: of that name, or the only one there is.
pub fn peer(place: &KeyArgs, name: Option<&str>) -> Result<Trusted> {
    let mut all = trusted(place)?;
    match name {
        Some(name) => all.into_iter().find(|t| t.name == name).with_context(|| {
            format!("--peer {name}: no such key is trusted; 'osteon key trust {name} KEY' first")
        }),
        None if all.len() == 1 => Ok(all.remove(0)),
        None if all.is_empty() => bail!(
            "whose is the other machine? Trust its key first: 'osteon key show' there, 'osteon key trust NAME KEY' here"
        ),
        None => bail!(
            "{} keys are trusted; say by --peer NAME which one is meant",
            all.len()
        ),
    }
}

fn new(folder: &Path) -> Result<Identity> {
    private_folder(folder)?;
    let path = folder.join("identity");
    let identity = Identity::generate().context("cannot make a key")?;
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&path);
    let mut file = match file {
        Ok(file) => file,
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => bail!(
            "{}: there is a key already, and others may trust it; move it away to make a new one",
            path.display()
        ),
        Err(e) => return Err(e).with_context(|| format!("{}: cannot write", path.display())),
    };
    writeln!(file, "{}", identity.secret_hex())
        .and_then(|()| file.sync_all())
        .with_context(|| format!("{}: cannot write", path.display()))?;
    Ok(identity)
}

fn trust(folder: &Path, name: &str, key: &str) -> Result<()> {
    let key = PublicKey::from_hex(key).context(
        "KEY: not a public key; give the 64 hexadecimal digits that 'osteon key show' prints there",
    )?;
    if !is_name(name) {
        bail!("NAME: 1 to {MAX_NAME} letters, digits, '-', '_' or '.'");
    }
    private_folder(folder)?;
    let place = KeyArgs {
        keys: Some(folder.to_owned()),
    };
    let known = trusted(&place)?;
    if let Some(other) = known.iter().find(|t| t.name == name || t.key == key) {
        if other.name == name && other.key == key {
            return Ok(());
        }
        bail!(
            "{}: '{}' is there already with {}; delete its line first",
            folder.join("trusted").display(),
            other.name,
            if other.key == key {
                "this key"
            } else {
                "another key"
            }
        );
    }
    if known.len() >= MAX_TRUSTED {
        bail!(
            "{}: {MAX_TRUSTED} keys are the most",
            folder.join("trusted").display()
        );
    }
    let path = folder.join("trusted");
    let file = OpenOptions::new()
        .append(true)
        .create(true)
        .mode(0o600)
        .open(&path);
    let mut file = file.with_context(|| format!("{}: cannot write", path.display()))?;
    // one write: a line is there whole or not at all
    file.write_all(format!("{} {name}\n", key.to_hex()).as_bytes())
        .with_context(|| format!("{}: cannot write", path.display()))
}

fn is_name(name: &str) -> bool {
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(fits)
}

fn private_folder(folder: &Path) -> Result<()> {
    if folder.exists() {
        return Ok(());
    }
    DirBuilder::new()
        .mode(0o700)
        .recursive(true)
        .create(folder)
        .with_context(|| format!("{}: cannot make the folder", folder.display()))
}

/// A file that nobody else may read or change; `None` where there is none.
fn read_private(path: &Path) -> Result<Option<String>> {
    let meta = match fs::metadata(path) {
        Ok(meta) => meta,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e).with_context(|| format!("{}: cannot look at it", path.display())),
    };
    if meta.uid() != geteuid().as_raw() || meta.mode() & 0o077 != 0 {
        bail!(
            "{}: must be yours and closed to everybody else; 'chmod 600' it, and make a new key if somebody may have read it",
            path.display()
        );
    }
    if !meta.is_file() || meta.len() > 64 * 1024 {
        bail!("{}: not a file of keys", path.display());
    }
    let text =
        fs::read_to_string(path).with_context(|| format!("{}: cannot read", path.display()))?;
    Ok(Some(text))
}

#[expect(clippy::print_stdout, reason = "what the command is asked for")]
fn say(text: &str) {
    println!("{text}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn place() -> (tempfile::TempDir, KeyArgs) {
        let dir = tempfile::tempdir().expect("a folder");
        let keys = Some(dir.path().join("keys"));
        (dir, KeyArgs { keys })
    }

    fn line(outcome: Result<impl Sized>) -> String {
        outcome.err().map(|e| format!("{e:#}")).expect("an error")
    }

    #[test]
    fn a_key_is_made_once_and_is_private() {
        let (_dir, place) = place();
        assert!(line(identity(&place)).contains("osteon key new"));
        let folder = place.folder().expect("a folder");
        let made = new(&folder).expect("a key");
        assert_eq!(identity(&place).expect("the key"), made);
        let mode = |p: &Path| fs::metadata(p).expect("there").permissions().mode() & 0o777;
        assert_eq!(
            (mode(&folder), mode(&folder.join("identity"))),
            (0o700, 0o600)
        );
        assert!(line(new(&folder)).contains("there is a key already"));
        assert_eq!(
            identity(&place).expect("the key"),
            made,
            "and it is the same"
        );
        // readable by others: refused, with the remedy
        let open = fs::Permissions::from_mode(0o640);
        fs::set_permissions(folder.join("identity"), open).expect("a mode");
        assert!(line(identity(&place)).contains("chmod 600"));
    }

    #[test]
    fn trust_is_added_line_by_line_and_read_back() {
        let (_dir, place) = place();
        let folder = place.folder().expect("a folder");
        assert_eq!(trusted(&place).expect("nobody"), []);
        assert!(line(peer(&place, None)).contains("osteon key trust"));
        let keys = [PublicKey([1; 32]), PublicKey([2; 32])];
        trust(&folder, "lab", &keys[0].to_hex()).expect("trusted");
        assert_eq!(peer(&place, None).expect("the only one").key, keys[0]);
        trust(&folder, "lab", &keys[0].to_hex()).expect("again is no harm");
        trust(&folder, "office.2", &keys[1].to_hex()).expect("trusted");
        assert_eq!(trusted(&place).expect("two").len(), 2);
        assert!(line(peer(&place, None)).contains("--peer"));
        assert_eq!(peer(&place, Some("office.2")).expect("it").key, keys[1]);
        assert!(line(peer(&place, Some("home"))).contains("home"));
        assert!(line(trust(&folder, "lab", &keys[1].to_hex())).contains("already"));
        for (name, key) in [("", "00"), ("a b", "00"), ("x\ny", "00"), ("fine", "00")] {
            assert!(trust(&folder, name, key).is_err());
        }
        let path = folder.join("trusted");
        for bad in ["zz lab\n", "# fine\n\nnonsense\n"] {
            fs::write(&path, bad).expect("written");
            let line = line(trusted(&place));
            assert!(line.contains("line ") && line.contains("trusted"), "{line}");
        }
    }
}
