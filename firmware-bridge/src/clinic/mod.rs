//! The clinic: components, plans, sessions judged against them.

pub mod components;
pub(crate) mod guide;
mod picture;
pub mod plan;
pub mod plan_file;
pub mod prepare;
mod recorded;
pub mod report;
pub mod score;
pub mod session;
pub mod target;
pub mod task;

#[cfg(test)]
mod tests;

use std::path::PathBuf;

/// Why there is no plan, or no judgement: one line with what, where and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum ClinicError {
    /// A file that cannot be used.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A plan that cannot be.
    #[error("{0}")]
    Plan(String),
    /// The bone could not be loaded.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
}

/// Writes a file beside its place and renames it: never half of it.
pub fn write_whole(path: &std::path::Path, text: &str) -> Result<(), ClinicError> {
    use std::io::Write as _;
    let refuse = |e: std::io::Error| ClinicError::File {
        path: path.to_path_buf(),
        problem: format!("cannot be written ({e}); check the folder and the space left"),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let part = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let put = || {
        let mut file = std::fs::File::create(&part)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    put().map_err(|e| {
        drop(std::fs::remove_file(&part));
        refuse(e)
    })
}
