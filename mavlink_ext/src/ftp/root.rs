//! The folder that is served, and nothing outside of it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

use super::FtpError;

/// A folder, to read only or to write as well.
#[derive(Clone, Debug)]
pub struct Root {
    folder: PathBuf,
    writable: bool,
}

impl From<io::Error> for FtpError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => Self::FileNotFound,
            ErrorKind::AlreadyExists => Self::FileExists,
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Self::FileProtected,
            _ => (error
                .raw_os_error()
                .and_then(|errno| u8::try_from(errno).ok()))
            .map_or(Self::Fail, Self::Errno),
        }
    }
}

impl Root {
    /// Serves a folder that exists.
    pub fn new(folder: &Path, writable: bool) -> io::Result<Self> {
        let folder = folder.canonicalize()?;
        if !folder.is_dir() {
            return Err(ErrorKind::NotADirectory.into());
        }
        Ok(Self { folder, writable })
    }

    /// Where a path of the protocol lies, which may begin with `/`. Refused if it leaves the folder, by `..` or by a
    /// symbolic link.
    fn locate(&self, path: &[u8]) -> Result<PathBuf, FtpError> {
        let text = std::str::from_utf8(path).map_err(|_not_text| FtpError::FileNotFound)?;
        let mut inside = PathBuf::new();
        for part in Path::new(text).components() {
            match part {
                Component::Normal(name) => inside.push(name),
                Component::RootDir | Component::CurDir => {}
                Component::ParentDir | Component::Prefix(_) => return Err(FtpError::FileProtected),
            }
        }
        let whole = self.folder.join(&inside);
        // What does not exist yet lies where its folder does; what exists, where it really is.
        let existing = match whole.symlink_metadata() {
            Ok(_) => whole.canonicalize()?,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let parent = whole.parent().ok_or(FtpError::FileNotFound)?;
                parent.canonicalize()?
            }
            Err(error) => return Err(error.into()),
        };
        if existing.starts_with(&self.folder) {
            Ok(whole)
        } else {
            Err(FtpError::FileProtected)
        }
    }

    fn locate_to_write(&self, path: &[u8]) -> Result<PathBuf, FtpError> {
        let whole = self.locate(path)?;
        if self.writable && whole != self.folder {
            Ok(whole)
        } else {
            Err(FtpError::FileProtected)
        }
    }

    /// Opens a file to read; its size.
    pub(super) fn open(&self, path: &[u8]) -> Result<(File, u32), FtpError> {
        let file = File::open(self.locate(path)?)?;
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Err(FtpError::FileNotFound);
        }
        let size = u32::try_from(metadata.len()).map_err(|_too_large| FtpError::Fail)?;
        Ok((file, size))
    }

    /// Opens a file to write, and empties it if it is there.
    pub(super) fn create(&self, path: &[u8]) -> Result<File, FtpError> {
        let whole = self.locate_to_write(path)?;
        let mut options = OpenOptions::new();
        Ok(options
            .write(true)
            .create(true)
            .truncate(true)
            .open(whole)?)
    }

    pub(super) fn truncate(&self, path: &[u8], size: u32) -> Result<(), FtpError> {
        let file = OpenOptions::new()
            .write(true)
            .open(self.locate_to_write(path)?)?;
        // Only shorter: a request of a few bytes must not fill the disk.
        let size = u64::from(size).min(file.metadata()?.len());
        Ok(file.set_len(size)?)
    }

    pub(super) fn remove(&self, path: &[u8]) -> Result<(), FtpError> {
        Ok(fs::remove_file(self.locate_to_write(path)?)?)
    }

    pub(super) fn create_folder(&self, path: &[u8]) -> Result<(), FtpError> {
        Ok(fs::create_dir(self.locate_to_write(path)?)?)
    }

    pub(super) fn remove_folder(&self, path: &[u8]) -> Result<(), FtpError> {
        Ok(fs::remove_dir(self.locate_to_write(path)?)?)
    }

    pub(super) fn rename(&self, from: &[u8], to: &[u8]) -> Result<(), FtpError> {
        let to = self.locate_to_write(to)?;
        if to.exists() {
            return Err(FtpError::FileExists);
        }
        Ok(fs::rename(self.locate_to_write(from)?, to)?)
    }

    /// The entries of a folder as the protocol writes them, sorted by name: `Dname`, or `Fname` and the size.
    pub(super) fn list(&self, path: &[u8]) -> Result<Vec<String>, FtpError> {
        let mut entries = Vec::new();
        for entry in fs::read_dir(self.locate(path)?)? {
            let entry = entry?;
            let Ok(name) = entry.file_name().into_string() else {
                continue; // A name that is no text cannot be asked for either.
            };
            let metadata = entry.metadata()?;
            if metadata.is_dir() {
                entries.push(format!("D{name}"));
            } else if metadata.is_file() {
                entries.push(format!("F{name}\t{}", metadata.len()));
            }
        }
        entries.sort();
        Ok(entries)
    }
}
