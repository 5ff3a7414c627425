//! What is done to the disk, so that tests can do it to a worse one.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::xxh3_64;

use super::DatasetError;
use super::files::File;

/// Where a set is written to.
pub trait Disk: Sync {
    /// How many bytes may be written there.
    fn room(&self, folder: &Path) -> io::Result<u64>;

    /// Writes a file.
    fn write(&self, file: &Path, bytes: &[u8]) -> io::Result<()>;
}

/// The disk itself.
#[derive(Clone, Copy, Debug)]
pub struct Local;

impl Disk for Local {
    fn room(&self, folder: &Path) -> io::Result<u64> {
        let state = rustix::fs::statvfs(folder)?;
        Ok(state.f_bavail.saturating_mul(state.f_frsize))
    }

    fn write(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        fs::write(file, bytes)
    }
}

/// An error of the disk with what was tried.
pub(super) fn cannot(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DatasetError {
    move |source| match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            DatasetError::Full(path.to_owned())
        }
        _ => DatasetError::Io {
            doing,
            path: path.to_owned(),
            source,
        },
    }
}

/// What files a sequence has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Digests(BTreeMap<String, (u64, u64)>);

impl Digests {
    pub(super) fn add(&mut self, name: &str, bytes: &[u8]) {
        let digest = (bytes.len() as u64, xxh3_64(bytes));
        self.0.insert(name.to_owned(), digest);
    }

    pub(super) fn files(&self) -> u64 {
        self.0.len() as u64
    }

    pub(super) fn bytes(&self) -> u64 {
        self.0.values().map(|(bytes, _)| bytes).sum()
    }

    /// XXH3 of a line `NAME BYTES XXH3` for each file, in the order of their names.
    pub(super) fn xxh3(&self) -> String {
        let line = |(name, (bytes, digest)): (&String, &(u64, u64))| {
            format!("{name} {bytes} {digest:016x}\n")
        };
        let text: String = self.0.iter().map(line).collect();
        format!("{:016x}", xxh3_64(text.as_bytes()))
    }
}

/// A sequence on its way: removed again unless it becomes whole.
pub(super) struct Part<'a> {
    disk: &'a dyn Disk,
    folder: PathBuf,
    pub(super) digests: Digests,
    is_whole: bool,
}

impl<'a> Part<'a> {
    /// Starts `NAME.part`; one that an earlier run has left is thrown away.
    pub(super) fn create(disk: &'a dyn Disk, whole: &Path) -> Result<Self, DatasetError> {
        let mut folder = whole.as_os_str().to_owned();
        folder.push(".part");
        let folder = PathBuf::from(folder);
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(cannot("remove", &folder))?;
        }
        fs::create_dir_all(&folder).map_err(cannot("make", &folder))?;
        Ok(Self {
            disk,
            folder,
            digests: Digests::default(),
            is_whole: false,
        })
    }

    pub(super) fn write(&mut self, file: &File) -> Result<(), DatasetError> {
        self.digests.add(&file.name, &file.bytes);
        self.write_plain(&file.name, &file.bytes)
    }

    /// Writes the last file, of which there is no digest, and gives the sequence its name.
    pub(super) fn finish(
        mut self,
        whole: &Path,
        name: &str,
        bytes: &[u8],
    ) -> Result<(), DatasetError> {
        self.write_plain(name, bytes)?;
        fs::rename(&self.folder, whole).map_err(cannot("rename", &self.folder))?;
        self.is_whole = true;
        Ok(())
    }

    fn write_plain(&self, name: &str, bytes: &[u8]) -> Result<(), DatasetError> {
        let path = self.folder.join(name);
        if let Some(folder) = path.parent().filter(|folder| !folder.exists()) {
            fs::create_dir_all(folder).map_err(cannot("make", folder))?;
        }
        self.disk
            .write(&path, bytes)
            .map_err(cannot("write", &path))
    }
}

impl Drop for Part<'_> {
    fn drop(&mut self) {
        if !self.is_whole {
            // What cannot be removed now is thrown away by the next run.
            let _removed = fs::remove_dir_all(&self.folder);
        }
    }
}

/// Writes a file under another name first, so that a reader never sees half of it.
pub(super) fn replace(disk: &dyn Disk, path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let fresh = path.with_extension("new");
    disk.write(&fresh, bytes).map_err(cannot("write", &fresh))?;
    fs::rename(&fresh, path).map_err(cannot("write", path))
}
