//! Why nothing was imported: one line with what, where and the remedy.

use std::io;
use std::path::PathBuf;

/// Why an import was refused. Nothing is written then.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("{}: cannot be read ({error}); check the path and its permissions", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The scene cannot be written.
    #[error("{}: cannot be written ({error}); check the folder and the space left", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// The folder for the scene is there already.
    #[error("{}: is there already; give --out another folder, or --replace to put this scene in its place", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// No image was found.
    #[error("{}: no DICOM image among {files} files; give the folder with the scanner's slices", path.display())]
    NoImage {
        /// The folder.
        path: PathBuf,
        /// Files looked at.
        files: usize,
    },
    /// One slice's file cannot be used.
    #[error("{}{}: {problem}", path.display(), frame_text(*frame))]
    Slice {
        /// The slice's file.
        path: PathBuf,
        /// Frame of a multi-frame file, from 1.
        frame: Option<u32>,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The slices do not make a volume.
    #[error("{}: {problem}", path.display())]
    Input {
        /// The folder or file.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A NIfTI file could not be read.
    #[error(transparent)]
    Nifti(#[from] crate::scene::nifti::NiftiError),
    /// A text CT could not be read.
    #[error(transparent)]
    Text(#[from] crate::scene::text_ct::TextCtError),
    /// What was imported makes no scene.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
}

fn frame_text(frame: Option<u32>) -> String {
    frame.map_or(String::new(), |n| format!(" frame {n}"))
}
